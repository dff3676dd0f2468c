"""An FMU that crashes, hangs or refuses ends its own process, and the run with an error.

The FMU of these tests does so on request. Every process that loads it holds a FIFO open, so that
its end is an event that is waited for, and tells its id there.
"""

import json
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from zipfile import ZipFile

import numpy as np
import pytest

from nrs_cosim.orchestrator.engine.plants import Group, open_fleet
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.scenario.tables.fmus import Plant
from nrs_cosim.plant_fmu.archives.archive import find_archive, open_archive
from nrs_cosim.plant_fmu.bundled import builder
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError, StepError
from nrs_cosim.plant_fmu.isolation import worker_process
from nrs_cosim.plant_fmu.isolation.isolated import IsolatedPlants
from nrs_cosim.plant_fmu.isolation.progress import SIZE, Announced, Progress
from nrs_cosim.plant_fmu.isolation.worker_process import FmuProcess, StuckError
from nrs_cosim.plant_fmu.plants import Body, Disturbance
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.command import nrs
from tests.guard import GUARD, LIMIT
from tests.plant_fmu.faulty_fmu import fault_of, three_robots
from tests.scenarios import example, write

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

NRS = [sys.executable, "-c", "from nrs_cosim.orchestrator.cli.main import main; main()"]
LATE = f"the FMU did not return within {LIMIT:g} s (plant.deadline)"
BEFORE_THE_RUN, NEVER = -1.0, 3600.0


class Life:
    """The FIFO in which processes tell that they live, and hold open until they end."""

    def __init__(self, path):
        os.mkfifo(path)
        self._end = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        self._poll = select.poll()
        self._poll.register(self._end, select.POLLIN)

    def until(self, word):
        """Return all words up to the one that is waited for; with None, up to the last end."""
        received = b""
        while word is None or word.encode() not in received:
            assert self._poll.poll(60_000), (
                f"waited for {word or 'the end'} in vain after {received}"
            )
            said = os.read(self._end, 4096)
            if not said:
                break
            received += said
        return received.decode().split()

    def close(self):
        os.close(self._end)


@pytest.fixture
def life(tmp_path, monkeypatch):
    opened = Life(tmp_path / "life")
    monkeypatch.setenv("FAULTY_LIFE", str(tmp_path / "life"))
    yield opened
    opened.close()


@pytest.fixture
def place(faulty, tmp_path, monkeypatch):
    """Return a folder with the FMU, below which all temporary files come to lie."""
    shutil.copy(faulty, tmp_path / "faulty.fmu")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    return tmp_path


@pytest.fixture
def start(place):
    """Return a function that starts the command on a scenario; it records into run.mcap."""
    with ExitStack() as stack:

        def started(scenario):
            write(place / "s.toml", base=scenario)
            command = subprocess.Popen(
                [*NRS, "run", "s.toml", "-o", "run.mcap"],
                cwd=place,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            stack.callback(command.wait)
            stack.callback(command.kill)
            return command

        yield started


@pytest.fixture
def run_here(place, monkeypatch):
    """Return a function that runs the command on a scenario; the FMU has a process of its own."""
    monkeypatch.setattr(tempfile, "tempdir", str(place / "temporary"))

    def ran(scenario):
        write(place / "s.toml", base=scenario)
        return nrs("run", "s.toml", "-o", "run.mcap", cwd=place)

    return ran


def nothing_left(place, words):
    """Assert that every process that told its id has been waited for, and no file remains."""
    pids = [int(word) for word in words if word.isdigit()]
    assert pids
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    assert list((place / "temporary").iterdir()) == []


@pytest.mark.parametrize(
    ("fault", "at", "cause"),
    [
        ("segfault", "0.5", "the FMU crashed with SIGSEGV, in step; it printed: fault 1 is due"),
        ("abort", "0.5", "the FMU aborted (SIGABRT), in step; it printed: fault 2 is due"),
        ("exit", "0.5", "the FMU exited with status 7, in step; it printed: fault 3 is due"),
        (
            "hang",
            "0.5",
            f"{LATE}, in step; it printed: fault 4",
        ),
        ("discard", "0.5", "a step of 0.1 s ended with Discard"),
        ("error", "0.5", "a step of 0.1 s ended with Error"),
        ("fatal", "0.5", "a step of 0.1 s ended with Fatal"),
        ("nan", "0.6", "its outputs are not finite: [nan, "),
        ("end", "0.5", "a step of 0.1 s ended with the wish to end the simulation"),
        ("early", "0.5", "a step of 0.1 s ended with an early return, which was not allowed"),
        ("no status", "0.5", "a step of 0.1 s ended with status -1, unknown to FMI"),
    ],
)
def test_a_fault_names_robot_fmu_time_and_cause(run_here, place, life, fault, at, cause):
    deadline = {"deadline": LIMIT} if fault == "hang" else {}
    done = run_here(three_robots(fault, **deadline))
    assert done.returncode == 1
    expected = f"robot 2 (faulty.fmu) at t = {at} s: {cause}"
    assert f"failed: {expected}" in done.stderr
    assert "Traceback" not in done.stderr
    nothing_left(place, life.until(None))
    result = json.loads(nrs("info", place / "run.mcap", "--json").stdout)
    assert (result["status"], result["ticks"], result["damage"]) == ("failed", 5, [])
    assert result["messages"] == 3 * 6 + 4 * 5
    assert result["reason"].startswith(expected)
    assert "failed" in done.stdout


def test_a_crash_is_named_without_a_compiler(run_here, tmp_path, life, monkeypatch):
    monkeypatch.setenv("CC", "none-such")
    monkeypatch.setenv("NRS_CACHE", str(tmp_path / "nothing"))
    errors = run_here(three_robots("segfault")).stderr
    assert "robot 2 (faulty.fmu) at t = 0.5 s: the FMU crashed with SIGSEGV, in step" in errors
    assert life.until(None)


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("segfault", "the FMU crashed with SIGSEGV, in exit initialization; it printed: fault 1"),
        (
            "hang",
            f"{LATE}, in exit initialization",
        ),
        ("fatal", "initialisation of robot 2 ended with Fatal"),
    ],
)
def test_a_fault_before_the_run_is_bad_input(run_here, place, life, fault, cause):
    done = run_here(three_robots(fault, at=BEFORE_THE_RUN, deadline=LIMIT))
    assert done.returncode == 2
    assert cause in done.stderr
    assert done.stderr.startswith("error: s.toml: plant: faulty.fmu: ")
    assert "robot 2" in done.stderr
    nothing_left(place, life.until(None))
    assert not (place / "run.mcap").exists()


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("segfault", "the FMU crashed with SIGSEGV, in step; it printed: fault 1 is due; that was "
         "before the run, while its stability or the error of a held torque was measured"),
        ("discard", "a step of 0.005 s ended with Discard; that was before the run, while the "
         "error of a held torque was measured for robot 2"),
    ],
)  # fmt: skip
def test_a_fault_in_a_trial_says_that_it_was_before_the_run(run_here, place, life, fault, cause):
    done = run_here(three_robots(fault, at=0.05, control="hold"))
    assert done.returncode == 2
    assert done.stderr.startswith("error: s.toml: plant: ")
    assert f"{cause}: nothing is recorded" in done.stderr
    nothing_left(place, life.until(None))
    assert not (place / "run.mcap").exists()


@pytest.mark.parametrize(
    "cause", ["the FMU crashed with SIGSEGV, in step", "a step of 0.005 s ended with Discard"]
)
def test_the_time_of_a_fault_is_that_of_the_step_within_the_tick(run_here, cause):
    fault = "segfault" if "SIGSEGV" in cause else "discard"
    errors = run_here(three_robots(fault, at=0.5575, control="hold")).stderr
    assert f"robot 2 (faulty.fmu) at t = 0.555 s: {cause}" in errors


def test_a_library_that_crashes_on_loading_is_bad_input(run_here, place, life, monkeypatch):
    monkeypatch.setenv("FAULTY_LOAD", "crash")
    done = run_here(three_robots())
    assert done.returncode == 2
    result = "plant: faulty.fmu: robots 1-3: the FMU aborted (SIGABRT), in loading"
    assert done.stderr == f"error: s.toml: {result}\n"
    nothing_left(place, life.until(None))
    assert not (place / "run.mcap").exists()


@pytest.mark.parametrize("needs", [True, False])
def test_a_crash_before_the_run_names_the_tool_the_fmu_needs(faulty, monkeypatch, needs):
    monkeypatch.setenv("FAULTY_LOAD", "crash")
    archive = open_archive(faulty, "faulty.fmu")
    archive.description.coSimulation.needsExecutionTool = needs
    with ExitStack() as stack, pytest.raises(FmuError) as error:
        IsolatedPlants(stack, archive, bodies(1), {}, Driving(), 10.0)
    advice = "; it needs nrs-cosim on this machine (needsExecutionTool)" if needs else ""
    cause = "faulty.fmu: robot 1: the FMU aborted (SIGABRT), in loading"
    assert str(error.value) == cause + advice


@pytest.mark.skipif(sys.platform != "linux", reason="Linux ends a process with its parent")
def test_a_killed_parent_leaves_no_fmu_process(start, life):
    command = start(three_robots("hang", deadline=NEVER))
    words = life.until("hangs")
    command.kill()
    command.communicate(timeout=GUARD)
    assert command.returncode == -signal.SIGKILL
    assert [word for word in words if word.isdigit()] != [str(command.pid)]
    assert life.until(None) == [], "somebody else spoke"


def test_without_isolation_the_fmu_runs_in_the_process_of_the_command(start, life):
    command = start(three_robots("exit", isolate=False))
    command.communicate(timeout=GUARD)
    assert command.returncode == 7
    assert life.until(None) == [str(command.pid)]


def foreign(path, fmi):
    """Write a bundled arm whose bytes are nobody's: with a comment in its archive."""
    shutil.copy(build("two_link_arm", fmi), path)
    with ZipFile(path, "a") as archive:
        archive.comment = b"not ours"


@pytest.mark.parametrize("fmi", [2, 3])
def test_isolation_changes_no_bit(tmp_path, fmi):
    foreign(tmp_path / "arm.fmu", fmi)
    assert not open_archive(tmp_path / "arm.fmu").ours
    digests = []
    for isolate in (True, False):
        arms = three_robots(fmu="arm.fmu", isolate=isolate)
        path = tmp_path / f"{isolate}.mcap"
        file = example(arms, {"run.output_step": 0.05}, folder=tmp_path)
        assert run(file, path).status == "completed"
        with Reader(path, verify=True) as reader:
            digests.append(reader.digest)
    assert digests[0] == digests[1]


def test_only_fmus_built_here_are_trusted(faulty, tmp_path):
    assert find_archive("two_link_arm", Path()).ours
    for fmi in (2, 3):
        builder.write("planar_robot", fmi, tmp_path / "copy.fmu")
        assert find_archive("copy.fmu", tmp_path).ours
    assert not open_archive(faulty).ours


def bodies(n, **parameters):
    """Return n robots at rest."""
    zero, none = np.zeros(2), np.zeros((2, 0))
    still = Disturbance(zero, zero, none, none, none)
    return [
        Body(robot, parameters, np.eye(2), np.eye(2), still, zero, zero, zero, zero)
        for robot in range(1, n + 1)
    ]


def test_a_once_per_process_fmu_gets_a_process_for_each_robot(faulty, life):
    archive = open_archive(faulty)
    with ExitStack() as stack:
        together = IsolatedPlants(stack, archive, bodies(3), {}, Driving(), 10.0)
        archive.description.coSimulation.canBeInstantiatedOnlyOncePerProcess = True
        apart = IsolatedPlants(stack, archive, bodies(3), {}, Driving(), 10.0)
        references = np.arange(6.0).reshape(3, 2)
        for plants in (together, apart):
            plants.hold(references, references)
            for k in range(3):
                plants.advance(k * 0.1, 0.1)
        assert np.array_equal(apart.q, together.q)
        assert len(np.unique(apart.q)) == 6
        assert np.array_equal(apart.tau, together.tau)
    assert len(set(life.until(None))) == 1 + 3


def test_a_checkpoint_moves_between_processes_and_partitions(faulty):
    archive, driving = open_archive(faulty), Driving()
    references = np.random.default_rng(5).uniform(-1, 1, (3, 4, 3, 2))
    of = bodies(3)

    def isolated(rows):
        return IsolatedPlants(stack, archive, of[rows], {}, driving, 10.0)

    def here(rows):
        return open_plants(stack, archive, of[rows], {}, driving)

    def one_each(rows):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("nrs_cosim.plant_fmu.archives.archive.Archive.once_per_process", True)
            return isolated(rows)

    def play(plants, rows, ticks):
        states = []
        for k in ticks:
            plants.hold(*references[:, k, rows])
            plants.advance(k * 0.1, 0.1)
            states.append(np.stack([plants.q, plants.qd, plants.tau]))
        return np.array(states)

    every = slice(3)
    with ExitStack() as stack:
        onwards = play(here(every), every, range(4))[2:]
        for opens in (here, isolated, one_each):
            plants = opens(every)
            play(plants, every, range(2))
            saved = plants.save()
            for opened, rows in (
                (here, slice(1)), (isolated, slice(1, 3)), (isolated, every), (one_each, every),
            ):  # fmt: skip
                other = opened(rows)
                other.hold(*references[:, 0, rows])
                other.restore(saved[rows])
                assert np.array_equal(other.q, plants.q[rows])
                assert np.array_equal(play(other, rows, range(2, 4)), onwards[:, :, rows])


def test_a_checkpoint_refused_by_an_fmu_process_gives_the_reason(faulty):
    archive, of = open_archive(faulty), bodies(2)
    with ExitStack() as stack:
        other = open_plants(stack, open_archive(build("planar_robot")), of, {}, Driving())
        plants = IsolatedPlants(stack, archive, of, {}, Driving(), 10.0)
        with pytest.raises(FmuError, match="given to robot 1 is of an FMU with sha256"):
            plants.restore(other.save())


def test_once_per_process_needs_isolation(place, monkeypatch):
    monkeypatch.setattr("nrs_cosim.plant_fmu.archives.archive.Archive.once_per_process", True)
    file = example(three_robots(isolate=False), folder=place)
    with pytest.raises(FmuError, match=r"only once per process, but 3 robots have it"):
        run(file, place / "run.mcap")


def test_once_per_process_is_counted_over_all_groups(place, monkeypatch):
    monkeypatch.setattr("nrs_cosim.plant_fmu.archives.archive.Archive.once_per_process", True)
    plants = [Plant(fmu="faulty.fmu", isolate=False, deadline=s) for s in (1.0, 2.0)]
    archive = open_archive(place / "faulty.fmu")
    groups = [Group(f"plant {row}", plant, archive, [row]) for row, plant in enumerate(plants)]
    with ExitStack() as stack, pytest.raises(FmuError, match=r"plant 1: .* but 2 robots have it"):
        open_fleet(stack, groups, bodies(2))


@pytest.mark.parametrize(
    ("fmu", "asked", "threads"),
    [("planar_robot", False, 3), ("faulty", False, 1), ("faulty", True, 3)],
)
def test_several_threads_step_fmus_of_ours_and_others_that_are_said_to_bear_it(
    faulty, fmu, asked, threads
):
    archive = open_archive(faulty) if fmu == "faulty" else open_archive(build(fmu))
    plant = Plant(fmu=fmu, threads=asked, isolate=False)
    with ExitStack() as stack:
        fleet = open_fleet(stack, [Group("plant", plant, archive, [0, 1])], bodies(2), threads=3)
        (plants,) = fleet.plants
        assert plants.instances.rounds.threads == threads


def test_a_killed_fmu_process_is_reported_with_its_robots(faulty, life):
    with ExitStack() as stack:
        plants = IsolatedPlants(stack, open_archive(faulty), bodies(2), {}, Driving(), 10.0)
        (pid,) = life.until("\n")
        os.kill(int(pid), signal.SIGKILL)
        with pytest.raises(StepError, match=r"robots 1-2 .* at t = 0 s: the FMU was killed \(SIG"):
            plants.advance(0.0, 0.1)


def test_an_fmu_process_that_ends_while_saving_is_a_failed_step(faulty, life):
    with ExitStack() as stack:
        plants = IsolatedPlants(stack, open_archive(faulty), bodies(2), {}, Driving(), 10.0)
        (pid,) = life.until("\n")
        plants.advance(0.0, 0.1)
        os.kill(int(pid), signal.SIGKILL)
        with pytest.raises(StepError, match=r"robots 1-2 .* at t = 0\.1 s: the FMU was killed"):
            plants.save()


def test_a_wrong_parameter_is_reported_as_without_isolation(faulty):
    with ExitStack() as stack, pytest.raises(FmuError, match="has no parameter 'mm'"):
        IsolatedPlants(stack, open_archive(faulty), bodies(1, mm=1.0), {}, Driving(), 10.0)


ENDINGS = {
    "segfault": "the FMU crashed with SIGSEGV, in step",
    "exit": "the FMU exited with status 7, in step",
    "hang": f"{LATE}, in step",
    "abort": "the FMU aborted (SIGABRT), in step",
    "error": "a step of 0.1 s ended with Error",
}


@pytest.mark.parametrize("fault", cases(list(ENDINGS), ["segfault"]))
def test_the_robot_whose_fmu_fails_is_named_of_those_that_threads_step(faulty, fault):
    robots = bodies(40)
    robots[29] = replace(robots[29], parameters=fault_of(fault, 0.15))
    archive = open_archive(faulty, "faulty.fmu")
    deadline = LIMIT if fault == "hang" else 10.0
    with ExitStack() as stack:
        plants = IsolatedPlants(stack, archive, robots, {}, Driving(), deadline, threads=3)
        alone = open_plants(stack, archive, bodies(40), {}, Driving())
        for of in (plants, alone):
            of.hold(*np.random.default_rng(4).uniform(-1, 1, (2, 40, 2)))
            of.advance(0.0, 0.1)
        assert plants.q.tobytes() == alone.q.tobytes()
        with pytest.raises(StepError) as error:
            plants.advance(0.1, 0.1)
    assert str(error.value).startswith(f"robot 30 (faulty.fmu) at t = 0.1 s: {ENDINGS[fault]}")


def test_progress_is_the_last_call_that_a_thread_announced():
    shared = memoryview(bytearray(2 * SIZE))
    writer, reader = Progress(shared), Progress(shared)
    other = Announced(0, "", "", False)
    assert reader.last == [other, other]
    writer.enter("", "loading")
    assert reader.last == [Announced(1, "", "loading", False), other]
    writer.enter("robot 12", "step")
    assert reader.last == [Announced(2, "robot 12", "step", False), other]
    writer.rest()
    assert reader.last == [Announced(2, "", "", False), other]


def test_where_the_process_ended_was_among_all_calls_unless_a_thread_says_so():
    shared = memoryview(bytearray(3 * SIZE))
    slots = [Progress(shared[at : at + SIZE]) for at in (0, SIZE, 2 * SIZE)]
    slots[1].enter("robot 3", "step")
    slots[2].enter("robot 11", "get")
    culprits = Progress(shared).culprits
    assert [call.who for call in culprits()] == ["robot 3", "robot 11"]
    shared[3 * SIZE - 1] = 1
    assert [call.who for call in culprits()] == ["robot 11"]


def test_a_call_that_hangs_is_ended_after_one_deadline(monkeypatch):
    """It begins just after it was asked for, when the last that is known is another."""
    worker, now = object.__new__(FmuProcess), [0.0]
    calls = [Announced(7, "", "", False), Announced(8, "robot 1", "do step", False)]

    def poll(milliseconds):
        worker._progress.last = calls[1:]
        now[0] += milliseconds / 1000
        return []

    worker._since, worker._deadline, worker._robots = {}, 2.0, [1]
    worker._progress = SimpleNamespace(last=calls[:1])
    worker._poll = SimpleNamespace(poll=poll)
    monkeypatch.setattr(worker_process, "monotonic", lambda: now[0])
    with pytest.raises(StuckError, match=r"did not return within 2 s \(plant\.deadline\)"):
        worker._receive()
    assert 2.0 <= now[0] <= 2.0 * (1 + 1 / 8)
