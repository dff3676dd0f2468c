"""A run that was cut, stopped or failed goes on, on any number of workers, to the same bits."""

import os
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from nrs_cosim.orchestrator.engine.run import past_of, run
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.cluster.local_workers import (
    LocalRun,
    digest,
    expect_ended,
    lossy,
    mixed,
    story,
    workers_of,
)
from tests.command import nrs
from tests.guard import GUARD
from tests.plant_fmu.rewritten_fmus import rewritten

pytestmark = pytest.mark.usefixtures("nothing_is_left")

NRS = [sys.executable, "-m", "nrs_cosim.orchestrator"]
LOSSY = lossy()
SAYS = ["run", "robots", "plants", "driven", "ticks", "messages", "estimates", "tracking"]

DRIVER = """
import os, signal, sys
from pathlib import Path
from nrs_cosim.orchestrator.cluster.launcher import local_workers
from nrs_cosim.orchestrator.cluster.supervision import WorkerPolicy
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.orchestrator.engine.run import past_of, run
from nrs_cosim.orchestrator.engine.in_process import in_process
from nrs_cosim.orchestrator.scenario.file import read_scenario
from tests.cluster.local_workers import workers_of

scenario, recording, workers, k, number = sys.argv[1:]
file = read_scenario(Path(scenario))
t = file.clock.t(int(k))

def watch(time_ns):
    if time_ns >= t:
        print(*workers_of().values(), flush=True)
        os.kill(os.getpid(), int(number))

policy = WorkerPolicy(True, 60.0, print)
launch = local_workers(file, int(workers), policy) if workers != "1" else in_process(file)
run(file, Path(recording), launch, watch=watch)
"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the recording of the run in one process."""
    path = tmp_path_factory.mktemp("whole") / "1.mcap"
    run(LOSSY, path)
    return path


@pytest.fixture
def toml(tmp_path):
    path = tmp_path / "lossy.toml"
    path.write_text(LOSSY.text, "utf-8")
    return path


@pytest.mark.parametrize(
    ("before", "k", "after"),
    cases([(3, 47, 2), (2, 130, 1), (1, 203, 3)], [(3, 47, 2)]),
)
def test_a_killed_run_is_resumed_with_another_number_of_workers(
    tmp_path, toml, whole, before, k, after
):
    cut, path = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    arguments = map(str, (toml, cut, before, k, signal.SIGKILL.value))
    with TemporaryDirectory() as folder:  # what a killed process leaves
        killed = subprocess.run(
            [sys.executable, "-c", DRIVER, *arguments],
            check=False,
            capture_output=True,
            text=True,
            env={**os.environ, "TMPDIR": folder},
        )
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    workers = [int(pid) for pid in killed.stdout.splitlines()[-1].split()]
    assert len(workers) == (before if before > 1 else 0)
    expect_ended(workers)
    with Reader(cut) as reader:
        assert reader.status == "unfinished"
    done = nrs("resume", cut, "-o", path, "--workers", after)
    assert done.returncode == 0, done.stderr
    assert story(path) == story(whole)
    assert digest(path) == digest(whole)


def interrupted(file, path, k, workers=2):
    """Return the recording of a run that its user stopped after tick k."""

    def stop():
        raise Interrupted

    outcome = LocalRun(file, workers).at(k, stop).run(path)
    assert (outcome.status, outcome.ticks) == ("interrupted", k)
    return path


def resumed(file, cut, path, workers=1):
    """Resume a recording, and return the outcome."""
    with Reader(cut) as reader:
        past = past_of(reader)
        return (
            LocalRun(file, workers).run(path, past=past)
            if workers > 1
            else run(file, path, past=past)
        )


def test_an_interrupted_run_is_resumed_twice(tmp_path, whole):
    cut = interrupted(LOSSY, tmp_path / "a.mcap", 77)
    with Reader(cut) as reader:
        expected = ("interrupted", "stopped by the user after t = 7.7 s")
        assert (reader.status, reader.reason) == expected

    def stop(time_ns):
        if time_ns >= 15_000_000_000:
            raise Interrupted

    with Reader(cut) as reader:
        again = run(LOSSY, tmp_path / "b.mcap", watch=stop, past=past_of(reader))
    assert again.status == "interrupted"
    assert 77 < again.ticks <= 150
    outcome = resumed(LOSSY, again.path, tmp_path / "c.mcap", 2)
    assert (outcome.status, outcome.ticks) == ("completed", 300)
    assert digest(outcome.path) == digest(whole)


@pytest.mark.parametrize("workers", cases([1, 2], [2]))
def test_plants_of_all_kinds_are_resumed(tmp_path, workers):
    file = mixed()
    run(file, tmp_path / "whole.mcap")
    cut = interrupted(file, tmp_path / "cut.mcap", 13, 3)
    outcome = resumed(file, cut, tmp_path / "again.mcap", workers)
    assert story(outcome.path) == story(tmp_path / "whole.mcap")
    assert digest(outcome.path) == digest(tmp_path / "whole.mcap")


def test_a_run_ended_by_a_full_disk_is_resumed(tmp_path, toml, whole):
    cut, path = tmp_path / "cut.mcap", tmp_path / "again.mcap"
    room = 350_000

    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    failed = subprocess.run(
        [*NRS, "run", toml, "-o", cut, "--workers", "2"],
        check=False,
        capture_output=True,
        text=True,
        preexec_fn=limited,
    )
    assert failed.returncode == 1, failed.stderr
    assert "cannot be written: File too large" in failed.stderr
    assert "Traceback" not in failed.stderr
    with Reader(cut) as reader:
        assert 0 < reader.ticks < 300
    done = nrs("resume", cut, "-o", path)
    assert done.returncode == 0, done.stderr
    assert digest(path) == digest(whole)


def test_ticks_after_damage_are_run_again(tmp_path, whole):
    damaged, path = tmp_path / "damaged.mcap", tmp_path / "again.mcap"
    data = bytearray(whole.read_bytes())
    data[len(data) // 2] ^= 1
    damaged.write_bytes(data)
    with Reader(damaged) as reader:
        assert (reader.status, len(reader.damage) > 0) == ("completed", True)
    done = nrs("resume", damaged, "-o", path)
    assert done.returncode == 0, done.stderr
    (kept,) = re.findall(r"\nticks +300 of 300, t = 30 s in .*; (\d+) are the earlier", done.stdout)
    assert 0 < int(kept) < 300
    assert digest(path) == digest(whole)


def test_a_recording_without_a_tick_is_resumed(tmp_path, whole):
    cut, path = tmp_path / "cut.mcap", tmp_path / "again.mcap"
    data = whole.read_bytes()
    with Reader(whole) as reader:
        head = reader._chunks[0].offset
    cut.write_bytes(data[: head + 100])
    with Reader(cut) as reader:
        assert (reader.status, reader.ticks, reader.message_count) == ("unfinished", 0, 0)
    outcome = resumed(LOSSY, cut, path)
    assert (outcome.status, digest(path)) == ("completed", digest(whole))


def test_recordings_that_cannot_be_resumed_are_refused(tmp_path, whole):
    other = tmp_path / "no.mcap"
    other.write_text("no recording")
    done = nrs("resume", whole)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"error: {whole}: is completed: there is nothing to resume\n"
    done = nrs("resume", other)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {other}: is no MCAP file; give a recording of a run")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-1000])
    before = cut.read_bytes()
    link = tmp_path / "link.mcap"
    link.symlink_to(cut)
    for same in (cut, link):
        done = nrs("resume", cut, "-o", same)
        assert done.returncode == 2
        assert done.stderr.startswith(f"error: {same}: is the recording to resume; give another")
    assert cut.read_bytes() == before


def test_resume_finds_fmus_in_the_scenarios_folder_and_refuses_changed_ones(tmp_path, monkeypatch):
    """The run was started with the scenario's name relative to the folder of that time."""
    rewritten(tmp_path / "arm.fmu", 3, lambda text: text)
    plant = {"plant.fmu": "arm.fmu", "plant.isolate": False}
    with monkeypatch.context() as place:
        place.chdir(tmp_path)
        file = lossy(plant, {"run.duration": 3.0}, folder=Path())
        cut = interrupted(file, tmp_path / "cut.mcap", 20)
    done = nrs("resume", cut, "-o", tmp_path / "whole.mcap")
    assert done.returncode == 0, done.stderr
    rewritten(tmp_path / "arm.fmu", 3, lambda text: text.replace("planar", "Planar") + " ")
    done = nrs("resume", cut, "-o", tmp_path / "again.mcap")
    assert done.returncode == 2
    result = (
        f"error: plant: {tmp_path}/arm.fmu is not the FMU that the recording was made with: its"
    )
    assert done.stderr.startswith(result)
    assert not (tmp_path / "again.mcap").exists()


def test_ctrl_c_while_workers_run_closes_the_recording(tmp_path, toml):
    toml.write_text(lossy({"run.duration": 30000.0}).text, "utf-8")
    path = tmp_path / "cut.mcap"
    command = [*NRS, "run", toml, "-o", path, "--workers", "2"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        while not path.exists() or path.stat().st_size < 100_000:
            assert process.poll() is None
        workers = workers_of(process.pid).values()
        assert len(workers) == 2
        process.send_signal(signal.SIGINT)
        printed, errors = process.communicate(timeout=GUARD)
    assert process.returncode == 130, errors
    assert b"Traceback" not in errors
    assert b"interrupted, stopped by the user after t = " in printed
    expect_ended(workers)
    with Reader(path) as reader:
        assert (reader.status, reader.damage) == ("interrupted", [])


def test_ctrl_c_before_workers_are_ready_leaves_nothing(tmp_path, toml):
    path = tmp_path / "none.mcap"
    command = [*NRS, "run", toml, "-o", path, "--workers", "3"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        while len(workers := workers_of(process.pid).values()) < 3:
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        printed, errors = process.communicate(timeout=GUARD)
    assert (process.returncode, printed) == (130, b"")
    assert errors == b"interrupted: before the run began; nothing is recorded\n"
    assert not path.exists()
    expect_ended(workers)
