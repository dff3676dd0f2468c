"""A study on a Dask cluster: a real scheduler and workers, as processes, are used and killed."""

import json
import os
import shutil
import signal
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

import nrs_cosim as nrs
from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.errors import EngineGoneError
from nrs_cosim.orchestrator.study.axes import axis_of
from nrs_cosim.orchestrator.study.engines import dask_engine, local_engine
from nrs_cosim.orchestrator.study.plan import StudyPlan
from nrs_cosim.orchestrator.study.store import StudyStore
from nrs_cosim.orchestrator.study.study import sweep_into
from tests.command import nrs as nrs_command
from tests.guard import GUARD
from tests.network.authority import Authority
from tests.plant_fmu.faulty_fmu import FAULTS, built, three_robots
from tests.scenarios import PAPER, example, write

distributed = pytest.importorskip("distributed", reason="the extra `dask` is not installed")
DASK = Path(sys.executable).with_name("dask")
OVER = "algorithm.alpha=0.5,0.7,0.9,1.1,1.2,1.5"


def started(stack, folder, *arguments, **environment):
    """Start a part of Dask in a session of its own, which ends with the stack."""
    process = subprocess.Popen(
        [DASK, *arguments], cwd=folder, env={**os.environ, **environment}, text=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip

    def end():
        for number in (signal.SIGTERM, signal.SIGKILL):
            try:
                os.killpg(process.pid, number)
                process.communicate(timeout=GUARD if number == signal.SIGTERM else None)
            except ProcessLookupError:
                break

    stack.callback(end)
    return process


def announced(process):
    """Return the address that a scheduler says it is at."""
    for line in process.stderr:
        if "Scheduler at:" in line:
            return line.split()[-1]
    raise AssertionError("the scheduler ended")


@contextmanager
def cluster(folder, *options, scheme="tcp", **environment):
    """Yield a scheduler on this machine, its address, and a worker of two processes."""
    with ExitStack() as stack:
        scheduler = started(
            stack, folder, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
            "--protocol", scheme, *options,
        )  # fmt: skip
        address = announced(scheduler)
        worker = started(
            stack, folder, "worker", address, "--nworkers", "2", "--nthreads", "1",
            "--no-dashboard", "--death-timeout", "10", "--local-directory", str(folder / "dask"),
            *options, **environment,
        )  # fmt: skip
        # Else a pipe that nobody reads would stop them.
        for process in (scheduler, worker):
            stack.enter_context(drained(process))
        yield scheduler, address


@contextmanager
def drained(process):
    """Read what a process says, to no end, in a process of its own."""
    reader = subprocess.Popen(["cat"], stdin=process.stderr, stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        reader.kill()
        reader.wait(timeout=GUARD)


def plan():
    """Return a study of six gains."""
    return StudyPlan({PAPER: example(PAPER, {"run.duration": 2.0})}, [axis_of("", OVER)])


def table(folder, engine, follow=lambda _progress, _row: None):
    """Run the study on an engine; return its digest."""
    folder.mkdir(exist_ok=True)
    with StudyStore(folder) as store:
        sweep_into(store, plan(), engine, follow)
    return nrs.Study(folder).digest


def reason_of_an_fmu(folder, engine):
    """Return why a point with an FMU that is not bundled, whatever is in it, fails on an engine."""
    (folder / "strange.fmu").write_bytes(b"native code")
    (folder / "strange").mkdir()
    base = example(three_robots(fmu="strange.fmu"), folder=folder, name="strange")
    with StudyStore(folder / "strange") as store:
        sweep_into(store, StudyPlan({"strange": base}, [], sent=True), engine)
        (row,) = store.rows()
    assert (row.status, row.cause_kind) == ("failed", "input")
    return row.reason


def test_the_table_is_that_of_this_process_whoever_is_killed(tmp_path):
    killed = []
    serial = table(tmp_path / "serial", local_engine(0))
    scenario = nrs.Study(tmp_path / "serial").scenario(nrs.Study(tmp_path / "serial").rows[0].key)
    with cluster(tmp_path) as (scheduler, address):

        def kill_worker(progress, row):
            if row and progress.done == 2:
                killed.append(row.pid)
                os.kill(row.pid, signal.SIGKILL)

        assert table(tmp_path / "a", dask_engine(address), kill_worker) == serial
        assert killed

        with distributed.Client(address, set_as_default=False) as client:
            lent = nrs.sweep(scenario, {}, executor=client.get_executor(pure=False))
        assert {row.digest for row in lent.rows} <= {
            row.digest for row in nrs.Study(tmp_path / "serial").rows
        }

        assert "worker runs no FMU that is sent to it; start it with NRS_ALLOW_FMUS=1" in (
            reason_of_an_fmu(tmp_path, dask_engine(address))
        )

        def kill_scheduler(progress, _row):
            if progress.done == 2:
                os.killpg(scheduler.pid, signal.SIGKILL)

        with pytest.raises(EngineGoneError, match="the same command resumes"):
            table(tmp_path / "b", dask_engine(address), kill_scheduler)
    assert 2 <= len(nrs.Study(tmp_path / "b").rows) < 6
    assert table(tmp_path / "b", local_engine(0)) == serial


def test_an_fmu_is_sent_over_tls_and_runs_isolated_where_that_is_allowed(tmp_path):
    mine = Authority(tmp_path / "ca").issue("lab")
    options = ("--tls-ca-file", mine.ca, "--tls-cert", mine.certificate, "--tls-key", mine.key)
    shutil.copy(built(tmp_path), tmp_path / "faulty.fmu")
    write(tmp_path / "s.toml", base=three_robots())
    environment = {"NRS_CACHE": str(tmp_path / "cache"), "NRS_ALLOW_FMUS": "1"}
    study = tmp_path / "study"
    over = f"plant.parameters.fault={FAULTS.index('none')},{FAULTS.index('segfault')}"
    with cluster(tmp_path, *map(str, options), scheme="tls", **environment) as (_, address):
        assert address.startswith("tls://")
        done = nrs_command(
            "sweep", tmp_path / "s.toml", "-o", study, "--dask", address, "--over", over,
            "--tls-ca", mine.ca, "--tls-certificate", mine.certificate, "--tls-key", mine.key,
        )  # fmt: skip
    assert done.returncode == 1, done.stderr
    rows = {json.loads(row.point)[over.partition("=")[0]]: row for row in nrs.Study(study).rows}
    healthy, broken = (rows[FAULTS.index(fault)] for fault in ("none", "segfault"))
    assert healthy.status == "converged"
    assert (broken.status, broken.cause_kind, broken.tries) == ("failed", "plant", 1)
    assert broken.reason in " ".join(done.stderr.split())
    assert list((tmp_path / "cache").rglob("by-sha256/*.fmu"))


def test_an_address_that_nobody_is_at_is_told(monkeypatch):
    monkeypatch.setattr("nrs_cosim.orchestrator.study.engines.PATIENCE", 0.5)
    with pytest.raises(InputError, match="no scheduler answers"):
        dask_engine("tcp://127.0.0.1:1")
    with pytest.raises(InputError, match="expected tls://HOST:PORT"):
        dask_engine("lab.example:8786")
