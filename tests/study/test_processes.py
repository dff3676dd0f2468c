"""Processes run points, are killed, hang and are interrupted, and no row is lost or changed."""

import json
import os
import select
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import nrs_cosim as nrs
from nrs_cosim.orchestrator.study.axes import axis_of
from nrs_cosim.orchestrator.study.engines import local_engine
from nrs_cosim.orchestrator.study.plan import StudyPlan
from nrs_cosim.orchestrator.study.store import StudyStore
from nrs_cosim.orchestrator.study.study import sweep_into
from tests.cases import cases
from tests.guard import GUARD, VAIN
from tests.plant_fmu.faulty_fmu import FAULTS, built, three_robots
from tests.scenarios import PAPER, PAPER_FILE, example, paper, write

OVER = "algorithm.alpha=0.5,0.7,0.9,1.1,1.2,1.5"
PROGRAM = Path(sys.executable).with_name("nrs")


@pytest.fixture(scope="module")
def serial():
    """Return the digest of the study's table, with all in this process."""
    scenario = nrs.Scenario.load(PAPER_FILE).replace({"run.duration": 2.0})
    return nrs.sweep(scenario, {"algorithm.alpha": OVER.partition("=")[2]}, jobs=0).digest


def plan():
    """Return the same study."""
    base = example(PAPER, {"run.duration": 2.0})
    return StudyPlan({PAPER: base}, [axis_of("", OVER)])


def test_a_killed_process_is_replaced_and_the_table_is_the_same(tmp_path, serial):
    killed = set()

    def follow(progress, row):
        if row and progress.done in {2, 4} and row.pid not in killed:
            killed.add(row.pid)
            os.kill(row.pid, signal.SIGKILL)

    store = StudyStore(tmp_path)
    with store:
        sweep_into(store, plan(), local_engine(2), follow)
    study = nrs.Study(tmp_path)
    assert killed
    assert {row.status for row in study.rows} == {"converged", "diverged"}
    assert study.digest == serial


def test_a_point_that_ends_its_process_is_crashed_and_the_others_are_not(tmp_path):
    shutil.copy(built(tmp_path), tmp_path / "faulty.fmu")
    base = example(three_robots(isolate=False), folder=tmp_path, name="faulty")
    faults = [FAULTS.index(name) for name in ("none", "segfault", "error")]
    axis = axis_of("", f"plant.parameters.fault={','.join(map(str, faults))}")
    with StudyStore(tmp_path) as store:
        sweep_into(store, StudyPlan({"faulty": base}, [axis]), local_engine(2))
        found = {json.loads(row.point)["plant.parameters.fault"]: row for row in store.rows()}
    assert [found[fault].status for fault in faults] == ["converged", "crashed", "failed"]
    assert (found[faults[1]].cause_kind, found[faults[1]].tries) == ("worker", 2)


def test_a_call_that_does_not_return_is_ended_and_is_a_timeout(tmp_path):
    shutil.copy(built(tmp_path), tmp_path / "faulty.fmu")
    base = example(three_robots(isolate=False), folder=tmp_path, name="faulty")
    axis = axis_of("", f"plant.parameters.fault={FAULTS.index('hang')}")
    with StudyStore(tmp_path) as store:
        sweep_into(store, StudyPlan({"faulty": base}, [axis], limit=VAIN), local_engine(1))
        (row,) = store.rows()
    assert (row.status, row.cause_kind) == ("timeout", "deadline")


def test_a_run_that_takes_too_long_ends_at_its_next_output_time(tmp_path):
    base = paper({"run.duration": 1e5})
    with StudyStore(tmp_path) as store:
        sweep_into(store, StudyPlan({"paper": base}, [], limit=VAIN), local_engine(0))
        (row,) = store.rows()
    assert (row.status, row.cause_kind) == ("timeout", "deadline")
    assert 0 < row.ticks < row.ticks_planned


def begun(folder):
    """Start the study as a command of a session of its own; return it after two rows."""
    write(folder / "paper_first_order.toml", {"run.duration": 2.0})
    process = subprocess.Popen(
        [
            PROGRAM, "sweep", "paper_first_order.toml", "--over", OVER, "-o", "study",
            "--jobs", "2", "--json",
        ],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip
    lines = [json.loads(process.stdout.readline()) for _ in range(3)]
    return process, [line["row"] for line in lines if "row" in line]


def is_gone(pid):
    """Wait for the end of a process."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([descriptor], [], [], GUARD)[0])
    finally:
        os.close(descriptor)


def resumed(folder):
    """Run the same command again to its end; return the study."""
    done = subprocess.run(
        [PROGRAM, "sweep", "paper_first_order.toml", "--over", OVER, "-o", "study", "--jobs", "0"],
        cwd=folder, capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return nrs.Study(folder / "study")


def test_a_killed_study_leaves_no_process_and_goes_on_where_it_was(tmp_path, serial):
    process, rows = begun(tmp_path)
    process.kill()
    process.communicate(timeout=GUARD)
    assert all(is_gone(row["pid"]) for row in rows)
    kept = {row.key: row.started for row in nrs.Study(tmp_path / "study").rows}
    assert {row["key"] for row in rows} <= kept.keys()
    study = resumed(tmp_path)
    assert study.digest == serial
    assert {row.key: row.started for row in study.rows if row.key in kept} == kept


def test_ctrl_c_ends_a_study_quietly_and_keeps_its_rows(tmp_path, serial):
    process, rows = begun(tmp_path)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=GUARD)
    assert process.returncode == 130, errors
    assert errors.decode() == "interrupted: all rows are kept; the same command goes on\n"
    assert all(is_gone(row["pid"]) for row in rows)
    assert {row["key"] for row in rows} <= {row.key for row in nrs.Study(tmp_path / "study").rows}
    assert resumed(tmp_path).digest == serial


@pytest.mark.parametrize(
    ("place", "call", "times", "rows"),
    cases(
        [
            ("read", 1, 1, 0), ("read", 7, 1, 3), ("read", 7, 2, 2), ("rolled", 1, 1, 4),
            ("rolled", 1, 2, 4), ("cut", 1, 2, 4),
        ],
        [("read", 7, 2, 2), ("rolled", 1, 2, 4)],
    ),
)  # fmt: skip
def test_ctrl_c_while_points_are_read_or_rows_are_rolled_keeps_them(
    tmp_path, place, call, times, rows
):
    write(tmp_path / "s.toml", {"run.duration": 0.5})
    over = "algorithm.alpha=0.5,0.7,0.9,1.1"
    done = subprocess.run(
        [sys.executable, "-m", "tests.study.interrupted", place, str(call), str(times), "sweep",
         tmp_path / "s.toml", "--over", over, "-o", tmp_path / "study", "--jobs", "0", "--json"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 130, done.stderr
    assert done.stderr == "interrupted: all rows are kept; the same command goes on\n"
    said = [json.loads(line)["row"]["key"] for line in done.stdout.splitlines() if "row" in line]
    kept = [row.key for row in StudyStore(tmp_path / "study").rows()]
    assert kept == said
    assert len(kept) == rows
