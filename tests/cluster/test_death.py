"""Workers die, stop and fail, and the run goes on to the same bits, or says who, how and when."""

import os
import random
import re
import shutil
import signal

import pytest

from nrs_cosim.orchestrator.cluster import launcher
from nrs_cosim.orchestrator.cluster.local_worker import LocalWorker
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.cluster.local_workers import LocalRun, digest, lossy, story, workers_of
from tests.guard import LIMIT
from tests.plant_fmu.faulty_fmu import built, fault_of, three_robots
from tests.plant_fmu.rewritten_fmus import rewritten
from tests.scenarios import example, paper

pytestmark = pytest.mark.usefixtures("nothing_is_left")

TICKS = 300
WINDOW = 64  # how many ticks a worker may be ahead of the last that is closed


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the recording of the run in one process."""
    path = tmp_path_factory.mktemp("whole") / "1.mcap"
    run(lossy(), path)
    return path


@pytest.mark.parametrize("workers", cases([2, 6], [2]))
def test_any_worker_may_die_at_any_tick(tmp_path, whole, workers):
    """Four deaths a run, drawn by a seed."""
    draw = random.Random(workers)
    spread = LocalRun(lossy(), workers)
    for k in draw.sample(range(1, TICKS - WINDOW), 4):
        spread.kill(k, draw.randint(1, workers))
    outcome = spread.run(tmp_path / "n.mcap")
    assert (outcome.status, outcome.reason, outcome.ticks) == ("completed", "", TICKS)
    assert outcome.restarts == 4
    assert len([result for result in spread.said if "was killed (SIGKILL)" in result]) == 4
    assert story(outcome.path) == story(whole)
    assert digest(outcome.path) == digest(whole)


def test_workers_die_together_again_and_at_the_end(tmp_path, whole):
    spread = LocalRun(lossy(), 3).kill(0, 2).kill(50, 1, 3).kill(50 + 1, 1).kill(TICKS - 1, 2)
    outcome = spread.run(tmp_path / "n.mcap")
    assert (outcome.status, outcome.reason) == ("completed", "")
    assert outcome.restarts in {4, 5}  # the last may have done its part already
    assert digest(outcome.path) == digest(whole)


def test_a_worker_that_dies_after_the_last_tick_is_not_replaced(tmp_path, whole):
    outcome = LocalRun(lossy(), 3).kill(TICKS, 1, 2, 3).run(tmp_path / "n.mcap")
    assert (outcome.status, outcome.reason, outcome.restarts) == ("completed", "", 0)
    assert digest(outcome.path) == digest(whole)


def test_a_worker_that_dies_before_it_is_ready_is_restarted(tmp_path, whole, monkeypatch):
    """The first two that are started, and the third while the second begins anew."""

    class Doomed(LocalWorker):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            if len(killed) < 3:
                os.kill(self.pid, signal.SIGKILL)
                killed.append(self.pid)

    killed = []
    monkeypatch.setattr(launcher, "LocalWorker", Doomed)
    spread = LocalRun(lossy(), 2)
    outcome = spread.run(tmp_path / "n.mcap")
    assert (outcome.status, outcome.reason, outcome.restarts) == ("completed", "", 0)
    assert len(spread.said) == len(killed) == 3
    assert digest(outcome.path) == digest(whole)


def without_states(folder):
    """Write an FMU that cannot say what state it is in, to be run in the worker's own process."""
    return rewritten(
        folder / "forgetful.fmu",
        3,
        lambda text: text.replace('canSerializeFMUState="true"', ""),
    )


FORGETFUL = {"robots": [{"id": 3, "plant": {"fmu": "forgetful.fmu", "isolate": False}}]}


def test_a_plant_without_checkpoints_is_restored_by_replaying_from_the_start(tmp_path):
    """Further back than what the recorder has at hand, so that the recording is read again."""
    without_states(tmp_path)
    file = lossy(FORGETFUL, folder=tmp_path)
    run(file, tmp_path / "1.mcap")
    outcome = LocalRun(file, 3).kill(100, 3).kill(220, 2).run(tmp_path / "3.mcap")
    assert (outcome.status, outcome.reason, outcome.restarts) == ("completed", "", 2)
    assert digest(outcome.path) == digest(tmp_path / "1.mcap")
    with Reader(outcome.path) as reader:
        result = {m[1] for m in reader.messages() if m[1].endswith("/checkpoint")}
    assert result == {f"/robot_{robot}/checkpoint" for robot in (1, 2, 5, 6)}


def test_without_restart_a_death_ends_the_run(tmp_path):
    outcome = LocalRun(lossy(), 3, restart=False).kill(70, 2).run(tmp_path / "n.mcap")
    assert (outcome.status, outcome.restarts) == ("failed", 0)
    k = outcome.ticks
    assert 70 <= k <= 70 + WINDOW
    assert outcome.reason == f"worker local-2 (robots 3-4) was killed (SIGKILL), after tick {k}"
    with Reader(outcome.path) as reader:
        assert (reader.status, reader.reason, reader.ticks) == ("failed", outcome.reason, k)
        assert (reader.ending.cause.kind, reader.ending.cause.tick) == ("worker", k + 1)


def test_a_stopped_worker_is_waited_for(tmp_path, whole):
    """Until it is continued, by whoever looks again and again."""
    looks = []

    def look(_time):
        looks.append(1)
        if len(looks) == 4:
            os.kill(stopped.pop(), signal.SIGCONT)

    def stop():
        stopped.append(workers_of()["local-2"])
        os.kill(stopped[0], signal.SIGSTOP)
        spread.look = look

    stopped, spread = [], LocalRun(lossy(), 3)
    outcome = spread.at(60, stop).run(tmp_path / "n.mcap")
    assert (outcome.status, outcome.reason, outcome.restarts) == ("completed", "", 0)
    assert stopped == []
    assert digest(outcome.path) == digest(whole)


def test_a_worker_silent_beyond_the_deadline_is_named_with_the_tick(tmp_path):
    """Robots 3 and 4 receive from 1, it from 2 and 3; robots 5 and 6 receive from 2 to 4."""
    spread = LocalRun(lossy(), 3).kill(60, 2, by=signal.SIGSTOP)
    outcome = spread.run(tmp_path / "n.mcap", deadline=LIMIT)
    assert outcome.status == "failed"
    k = outcome.ticks + 1
    assert outcome.reason.startswith(f"tick {k} did not close in {LIMIT:g} s of silence: ")
    said = rf"sent samples up to tick ({k - 1}|{k}) and"
    with Reader(outcome.path) as reader:
        assert (reader.ending.cause.kind, reader.ending.cause.tick) == (
            "deadline",
            reader.ticks + 1,
        )
    silent, *others = sorted(outcome.reason.partition(": ")[2].split("; "), key=len, reverse=True)
    name = "robots 3-4 on worker local-2"
    assert re.fullmatch(f"{name} {said} wait for none: computing, or stopped", silent)
    for other in others:
        assert re.fullmatch(
            f"robots (1-2|5-6) on worker local-[13] {said} lack those of local-2", other
        )


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_a_worker_that_always_dies_at_a_tick_ends_the_run(tmp_path):
    """Its FMU crashes in its own process, at 0.55 s, in tick 6.

    A process that crashes takes with it what it has put and its session has not sent: it is closed
    up to tick 5 or an earlier one, and it is lost four times after that.
    """
    shutil.copy(built(tmp_path), tmp_path / "faulty.fmu")
    spread = LocalRun(example(three_robots("segfault", isolate=False), folder=tmp_path), 2)
    outcome = spread.run(tmp_path / "n.mcap")
    assert outcome.status == "failed"
    k = outcome.ticks
    assert 0 <= k <= 5
    result = (
        rf"worker local-2 \(robots 2-3\) crashed with SIGSEGV; .*, after tick {k}, for the 4th time"
    )
    assert re.match(result, outcome.reason), outcome.reason
    assert [line for line in spread.said if "it is started again" not in line] == []
    assert len(spread.said) == outcome.restarts
    assert all(re.search(rf"after tick {k};", line) for line in spread.said[-3:])


def test_a_deleted_fmu_ends_the_run(tmp_path):
    """A worker that is started again opens its FMUs anew."""
    path = without_states(tmp_path)
    spread = LocalRun(lossy(FORGETFUL, folder=tmp_path), 2)
    outcome = spread.at(100, path.unlink).kill(100, 1).run(tmp_path / "n.mcap")
    assert outcome.status == "failed"
    assert outcome.reason == (
        "robots[0].plant: forgetful.fmu: is gone, or is no more what it was when the run began"
    )


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_a_plant_that_refuses_a_step_fails_the_run_as_in_one_process(tmp_path):
    shutil.copy(built(tmp_path), tmp_path / "faulty.fmu")
    file = example(three_robots("error", isolate=False), folder=tmp_path)
    one, n = run(file, tmp_path / "1.mcap"), LocalRun(file, 2).run(tmp_path / "2.mcap")
    assert (n.status, n.reason, n.ticks) == (one.status, one.reason, one.ticks)
    assert (one.status, one.ticks) == ("failed", 5)
    assert story(n.path) == story(one.path)


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_a_failure_is_reported_even_while_another_worker_hangs(tmp_path):
    shutil.copy(built(tmp_path), tmp_path / "faulty.fmu")
    robots = three_robots("error", isolate=False)
    one = run(example(robots, folder=tmp_path), tmp_path / "1.mcap")
    hangs = {"fmu": "faulty.fmu", "isolate": False, "parameters": fault_of("hang")}
    robots["robots"].append({"id": 3, "plant": hangs})
    spread = LocalRun(example(robots, folder=tmp_path), 3)
    outcome = spread.run(tmp_path / "3.mcap", deadline=LIMIT)
    assert (outcome.status, outcome.reason, outcome.ticks) == ("failed", one.reason, 5)


def test_a_dead_worker_is_replaced_while_the_pace_delays_a_tick(tmp_path, whole):
    class Held:
        asked = 1.0

        def start(self, time_ns):
            pass

        def wait(self, time_ns, ask):
            if time_ns == 5_000_000_000:
                os.kill(workers_of()["local-1"], signal.SIGKILL)
                while not spread.said:
                    ask()

    spread = LocalRun(lossy(), 2)
    outcome = spread.run(tmp_path / "n.mcap", pace=Held())
    assert (outcome.status, outcome.restarts) == ("completed", 1)
    assert digest(outcome.path) == digest(whole)


@pytest.mark.parametrize("worst", cases(["position", "qd"], ["qd"]))
def test_of_many_failures_the_one_of_a_single_process_run_is_reported(tmp_path, worst):
    """At t = 0 robots on all workers are beyond the limit, each in another quantity."""
    beyond = {"position": 5, "velocity": 3, "q": 2, "qd": 1} if worst == "position" else {"qd": 4}
    initial = {
        f"initial.{name}": [[2e3 * (i == robot)] * 2 for i in range(1, 7)]
        for name, robot in beyond.items()
    }
    file = paper(initial, {"run.divergence_limit": 1000.0})
    one, n = run(file, tmp_path / "1.mcap"), LocalRun(file, 3).run(tmp_path / "3.mcap")
    assert f"t = 0 s: robot {beyond[worst]}'s" in one.reason
    assert (n.status, n.reason, n.ticks) == (one.status, one.reason, one.ticks)


def test_a_diverging_run_reports_the_same_reason_on_workers(tmp_path):
    file = paper({"algorithm.alpha": 1.18, "algorithm.beta": 1.18, "run.divergence_limit": 1000})
    one, n = run(file, tmp_path / "1.mcap"), LocalRun(file, 3).run(tmp_path / "3.mcap")
    assert (n.status, n.reason, n.ticks) == (one.status, one.reason, one.ticks)
    assert one.ticks > 10
    assert story(n.path) == story(one.path)
