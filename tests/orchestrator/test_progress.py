"""Long reading is seen on a terminal, after two seconds, and on nothing else."""

from contextlib import contextmanager
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from nrs_cosim.orchestrator.cli.progress import reading, stages
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.mcap.reader import Reader
from tests.command import nrs
from tests.scenarios import paper


def console(*, terminal):
    return Console(file=StringIO(), force_terminal=terminal, width=80, legacy_windows=False)


def shown(clock, parts, *, terminal=True):
    """Return what is printed while parts of a file are read, at times by a clock."""
    screen, times = console(terminal=terminal), iter(clock)
    with reading(screen, lambda: next(times)) as follow:
        watch = follow("folder/long [1].mcap")
        for part in parts:
            watch(part)
    return screen.file.getvalue()


def test_work_of_two_seconds_shows_a_progress_bar():
    result = shown([0.0, 1.0, 2.5, 3.0], [0.25, 0.5, 0.75])
    assert "reading long [1].mcap" in result
    assert "75%" in result


def test_a_finished_progress_bar_does_not_reappear():
    screen, times = console(terminal=True), iter([0.0, 9.0, 9.0])
    with reading(screen, lambda: next(times)) as follow:
        watch = follow("a.mcap")
    watch(0.5)
    assert not screen.file.getvalue()


@pytest.mark.parametrize(
    ("clock", "terminal"),
    [([0.0, 1.0, 1.9], True), ([0.0, 9.0, 99.0], False)],
    ids=["short", "pipe"],
)
def test_short_work_and_pipes_show_no_progress_bar(clock, terminal):
    assert not shown(clock, [0.5, 1.0], terminal=terminal)


def test_stages_are_shown_after_two_seconds():
    screen, now = console(terminal=True), [0.0]
    with stages(screen, lambda: now[0]) as begin:
        begin("equations")
        now[0] = 1.9
        begin("compiling [C]")
        soon = screen.file.getvalue()
        now[0] = 5.0
        begin("checking")
    shown = screen.file.getvalue()
    assert "equations" not in shown
    assert "compiling" not in soon
    assert "checking" in shown


def test_stages_are_not_shown_in_a_pipe():
    screen = console(terminal=False)
    with stages(screen, lambda: 9.0) as begin:
        begin("checking")
    assert not screen.file.getvalue()


def test_a_reader_reports_its_progress(tmp_path):
    path = run(paper(), tmp_path / "run.mcap").path
    parts = []
    with Reader(path, verify=True, watch=parts.append) as reader:
        opening = list(parts)
        for _ in range(2):
            parts.clear()
            chunks = sum(1 for _ in reader.batches())
            assert len(parts) == len(opening) == chunks > 2
            assert parts == opening == sorted(parts)
            assert 0 < parts[0] < parts[-1] <= 1
            assert parts[-1] > 0.9


def test_check_reports_each_stage(monkeypatch):
    result = []

    @contextmanager
    def listening(_screen):
        yield result.append

    monkeypatch.setattr("nrs_cosim.orchestrator.cli.progress.stages", listening)
    paper = Path(__file__).parents[2] / "scenarios" / "paper_first_order.toml"
    assert nrs("check", paper).returncode == 0
    assert result == [
        "opening the plants",
        "whether the estimates converge",
        "bounds of the steady state",
    ]
