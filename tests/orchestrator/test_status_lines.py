"""In a pipe long work is told in lines: after two seconds, at each change, every ten seconds."""

from io import StringIO
from queue import Queue
from threading import Event

import pytest
from rich.console import Console

from nrs_cosim.bus.clock import Clock
from nrs_cosim.orchestrator.cli import progress as lines
from nrs_cosim.orchestrator.cli import terminal_study
from nrs_cosim.orchestrator.cli.progress import (
    EVERY,
    PATIENCE,
    reading,
    running,
    stages,
    status_lines,
)
from nrs_cosim.orchestrator.study.study import StudyProgress
from tests.guard import GUARD


class Clockwork(Event):
    """An end that is waited for in wall time that passes when the test says so."""

    made = None

    def __init__(self):
        super().__init__()
        self.waited, self.passes = Queue(), Queue()
        type(self).made = self

    def wait(self, delay):
        self.waited.put(delay)
        return self.passes.get(timeout=GUARD)

    def set(self):
        super().set()
        self.passes.put(True)

    def pass_by(self):
        """Let the time pass that is waited for; return it, once what follows is printed."""
        delay = self.waited.get(timeout=GUARD)
        self.passes.put(False)
        following = self.waited.get(timeout=GUARD)
        self.waited.put(following)
        return delay


@pytest.fixture
def pipe(monkeypatch):
    monkeypatch.setattr(lines, "Event", Clockwork)
    monkeypatch.delenv("NRS_PROGRESS")
    return Console(file=StringIO(), force_terminal=False, width=80)


def printed(pipe):
    return pipe.file.getvalue().splitlines()


def test_nothing_is_printed_of_what_is_soon_done(pipe):
    with status_lines(pipe, lambda: "a") as changed:
        changed()
    assert printed(pipe) == []


def test_lines_come_after_two_seconds_then_at_each_change_and_every_ten_seconds(pipe):
    now, seconds = "a [b]", 50.0
    with status_lines(pipe, lambda: now, now=lambda: seconds) as changed:
        assert Clockwork.made.pass_by() == PATIENCE
        assert printed(pipe) == ["progress: a [b]"]
        now = "c"
        changed()
        assert printed(pipe)[1:] == ["progress: c"]
        seconds += EVERY
        assert Clockwork.made.pass_by() == EVERY
        assert printed(pipe)[2:] == ["progress: c … 10 s"]  # nothing is repeated as it was
    assert len(printed(pipe)) == 3


def test_a_status_that_is_empty_is_not_printed(pipe):
    with status_lines(pipe, lambda: ""):
        Clockwork.made.pass_by()
    assert printed(pipe) == []


def test_a_run_tells_its_simulated_time(pipe):
    clock = Clock((500_000_000,), 1, 8)
    with running(pipe, clock) as reach:
        Clockwork.made.pass_by()
        reach(1.5)
        Clockwork.made.pass_by()
    assert printed(pipe) == ["progress: starting", "progress: t = 1.5 of 4 s"]


def test_reading_tells_the_file_and_its_part(pipe):
    with reading(pipe) as follow:
        watch = follow("folder/long [1].mcap")
        watch(0.25)
        Clockwork.made.pass_by()
    assert printed(pipe) == ["progress: reading long [1].mcap, 25%"]


def test_stages_are_told_by_name(pipe):
    with stages(pipe) as begin:
        begin("equations")
        Clockwork.made.pass_by()
        begin("compiling [C]")
    assert printed(pipe) == ["progress: equations", "progress: compiling [C]"]


def test_nothing_is_printed_where_progress_is_off(pipe, monkeypatch):
    monkeypatch.setenv("NRS_PROGRESS", "off")
    Clockwork.made = None
    with status_lines(pipe, lambda: "a") as changed:
        changed()
    assert (printed(pipe), Clockwork.made) == ([], None)


def test_the_time_that_a_study_has_left_runs_down_and_is_not_told_once_it_is_over(
    pipe, monkeypatch
):
    seconds = 0.0
    monkeypatch.setattr(terminal_study, "monotonic", lambda: seconds)
    with terminal_study._following(pipe, as_json=False) as follow:
        for done in (1, 2, 3):
            seconds += 20.0
            follow(StudyProgress(4, done, ticks=100 * done, ticks_left=400 - 100 * done), None)
        for _ in range(3):
            Clockwork.made.pass_by()
            seconds += 15.0
    line = "progress: 3 of 4 points"
    first, second, third = printed(pipe)
    assert [first, second] == [f"{line}, about 20 s left", f"{line}, about 5 s left"]
    assert third == line
