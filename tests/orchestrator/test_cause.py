"""Why a run ended early is told to programs as fields, and is the same wherever its robots ran."""

import json
import re
import shutil
import subprocess
import sys

import pytest

from nrs_cosim.bus.errors import Cause, RunError
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.command import nrs
from tests.plant_fmu.faulty_fmu import built, three_robots
from tests.recordings.made_up_runs import create, tick
from tests.scenarios import SHORT, paper, write

DIVERGING = {"algorithm.alpha": 1.5, "run.divergence_limit": 1000}
QUANTITIES = {"estimated position", "estimated velocity", "q", "qd", "tau"}


def cause_of(path):
    """Return what `nrs info --json` tells of it."""
    done = nrs("info", path, "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    return result["cause"], result


def test_a_completed_run_has_no_cause(tmp_path):
    run(paper(SHORT), tmp_path / "run.mcap")
    assert cause_of(tmp_path / "run.mcap")[0] is None


@pytest.mark.parametrize("workers", cases([1, 2], [2]))
def test_the_cause_of_divergence_has_tick_robot_and_quantity(tmp_path, workers):
    write(tmp_path / "s.toml", DIVERGING)
    path = tmp_path / "run.mcap"
    done = nrs("run", tmp_path / "s.toml", "-o", path, "--workers", workers)
    assert done.returncode == 1
    cause, result = cause_of(path)
    assert cause["kind"] == "diverged"
    assert cause["tick"] == result["ticks"] + 1
    assert (cause["tick"] - 1) * 10**8 < cause["time_ns"] <= cause["tick"] * 10**8
    assert cause["quantity"] in QUANTITIES
    said = f"diverged at t = {cause['time_ns'] / 1e9:g} s: robot {cause['robot']}'s "
    assert result["reason"].startswith(said + cause["quantity"])


@pytest.mark.parametrize("isolate", cases([True, False], [True]))
def test_the_cause_of_a_plant_failure_has_robot_and_time(tmp_path, isolate):
    shutil.copy(built(tmp_path), tmp_path / "faulty.fmu")
    write(tmp_path / "s.toml", base=three_robots("error", isolate=isolate))
    done = nrs("run", tmp_path / "s.toml", "-o", tmp_path / "run.mcap")
    assert done.returncode == 1, done.stderr
    cause, result = cause_of(tmp_path / "run.mcap")
    at = re.search(r"at t = ([\d.]+) s", result["reason"])
    assert (cause["kind"], cause["robot"], cause["quantity"]) == ("plant", 2, None)
    assert cause["time_ns"] == round(float(at[1]) * 1e9)
    assert cause["tick"] == result["ticks"] + 1


def test_the_cause_of_an_interrupt_has_the_last_tick(tmp_path):
    def watch(time_ns):
        if time_ns >= 5 * 10**8:
            raise Interrupted

    outcome = run(paper(), tmp_path / "run.mcap", watch=watch)
    with Reader(outcome.path) as reader:
        ticks = reader.ticks
    expected = {"tick": ticks, "time_ns": ticks * 10**8, "robot": None, "quantity": None}
    assert cause_of(outcome.path)[0] == {"kind": "interrupted", **expected}


def test_a_full_disk_is_recorded_as_the_cause_where_there_is_room(tmp_path):
    """The limit of a file's size lies in the middle of a chunk."""
    write(tmp_path / "s.toml")
    path = tmp_path / "run.mcap"
    script = (
        "import resource, sys; from nrs_cosim.orchestrator.__main__ import main;"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000));"
        f"sys.argv = ['nrs', 'run', {str(tmp_path / 's.toml')!r}, '-o', {str(path)!r}]; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stderr
    cause, result = cause_of(path)
    assert (result["status"], cause["kind"]) == ("failed", "disk")
    assert cause["tick"] == result["ticks"] + 1 > 1


@pytest.mark.parametrize(
    ("error", "cause"),
    [
        (KeyboardInterrupt(), ("interrupted", "interrupted")),
        (RunError("gone", Cause("worker", 3)), ("failed", "worker")),
        (ValueError("odd"), ("failed", "other")),
    ],
    ids=["a second interrupt", "an error of the run", "any other"],
)
def test_a_writer_left_by_an_exception_records_it_as_the_cause(tmp_path, error, cause):
    path = tmp_path / "a.mcap"
    writer = create(path, 2, 2, 3, ())
    writer.write(tick(0, 2, 2))
    writer.__exit__(type(error), error, None)
    with Reader(path) as reader:
        assert (reader.status, reader.ending.cause.kind) == cause
