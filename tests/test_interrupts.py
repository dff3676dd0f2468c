"""Ctrl-C wherever Python runs: the recording is closed, the caller learns of it, nobody is left."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from jupyter_client.manager import start_new_kernel

import nrs_cosim as nrs
from tests.cluster.local_workers import expect_ended, workers_of
from tests.guard import GUARD

ROOT = Path(__file__).parents[1]
PAPER = ROOT / "scenarios/paper_first_order.toml"
API = (ROOT / "docs/api.md").read_text("utf-8")
HOURS = '"run.duration": 36000.0'

BEGIN = f"""
import asyncio, sys, threading
import nrs_cosim as nrs
scenario = nrs.Scenario.load({str(PAPER)!r}).replace({{{HOURS}}})
"""
SCRIPT = """
try:
    nrs.run(scenario, "cut.mcap", workers=2)
except KeyboardInterrupt:
    print("stopped")
"""
COROUTINE = """
async def main():
    nrs.run(scenario, "cut.mcap", workers=2)

try:
    asyncio.run(main())
except KeyboardInterrupt:
    print("stopped")
"""
THREAD = """
def task():
    try:
        nrs.run(scenario, "cut.mcap", workers=2)
    except KeyboardInterrupt:
        print("stopped")

thread = threading.Thread(target=task)
thread.start()
thread.join()
"""


def interrupted(folder: Path, program: str, workers: int) -> tuple[int, str, str]:
    """Run a program until its recording grows, interrupt it, and return status and output."""
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    with process:
        grows(folder / "cut.mcap", process)
        pids = workers_of(process.pid).values()
        assert len(pids) == workers
        process.send_signal(signal.SIGINT)
        printed, errors = process.communicate(timeout=GUARD)
    expect_ended(pids)
    with nrs.Recording(folder / "cut.mcap") as recording:
        assert (recording.status, recording.damage) == ("interrupted", [])
        assert recording.reason.startswith("stopped by the user after t = ")
        assert recording.ticks > 0
    return process.returncode, printed, errors


def grows(path: Path, process: subprocess.Popen[str]) -> None:
    while not path.exists() or path.stat().st_size < 100_000:
        assert process.poll() is None, process.communicate()


@pytest.mark.parametrize("program", [SCRIPT, COROUTINE], ids=["script", "coroutine"])
def test_in_the_main_thread_it_reaches_the_caller(tmp_path, program):
    assert interrupted(tmp_path, BEGIN + program, 2) == (0, "stopped\n", "")


def test_that_ends_the_main_thread_ends_a_run_in_another(tmp_path):
    status, _, errors = interrupted(tmp_path, BEGIN + THREAD, 2)
    assert status == -signal.SIGINT
    assert errors.count("Traceback") == 1
    assert errors.splitlines()[-1] == "KeyboardInterrupt"


@pytest.mark.parametrize(
    ("daemon", "duration", "ending"),
    [(True, 36000.0, "interrupted"), (False, 5.0, "completed")],
    ids=["daemon", "thread"],
)
def test_after_the_main_thread_a_thread_continues_and_a_daemon_ends(
    tmp_path, daemon, duration, ending
):
    program = f"""{BEGIN}
reached = threading.Event()

def task():
    some = scenario.replace({{"run.duration": {duration}}})
    nrs.run(some, "cut.mcap", progress=lambda t, _: t >= 1.0 and reached.set())

threading.Thread(target=task, daemon={daemon}).start()
reached.wait()
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "")
    with nrs.Recording(tmp_path / "cut.mcap") as recording:
        assert (recording.status, recording.damage) == (ending, [])
        assert recording.ticks == 50 or daemon


def test_a_cancelled_task_ends_its_run_as_the_document_shows(tmp_path):
    (program,) = re.findall(r"```python\n(import asyncio.*?)```", API, re.DOTALL)
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    program = program.replace("loop.mcap", "cut.mcap").replace('"run.duration": 5.0', HOURS)
    assert HOURS in program
    status, printed, errors = interrupted(tmp_path, program, 0)
    assert (status, printed) == (-signal.SIGINT, "")
    assert errors.splitlines()[-1] == "KeyboardInterrupt"
    assert "never retrieved" not in errors
    assert "ignored" not in errors


def test_in_a_notebook_its_button_interrupts_the_cell(tmp_path):
    manager, client = start_new_kernel(cwd=str(tmp_path))
    try:
        cell = client.execute(f'{BEGIN}nrs.run(scenario, "cut.mcap", workers=2)')
        path = tmp_path / "cut.mcap"
        while not path.exists() or path.stat().st_size < 100_000:
            assert manager.is_alive()
        pids = workers_of(manager.provisioner.pid).values()
        assert len(pids) == 2
        manager.interrupt_kernel()
        reply = client.get_shell_msg(timeout=GUARD)
        while reply["parent_header"]["msg_id"] != cell:  # what it is asked as it starts
            reply = client.get_shell_msg(timeout=GUARD)
        assert (reply["content"]["status"], reply["content"]["ename"]) == (
            "error", "KeyboardInterrupt",
        )  # fmt: skip
        expect_ended(pids)
        again = client.execute("1 + 1", reply=True, timeout=GUARD)
        assert again["content"]["status"] == "ok"
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)
    with nrs.Recording(path) as recording:
        assert (recording.status, recording.damage) == ("interrupted", [])


def test_an_exception_of_the_progress_callback_ends_the_run_and_is_raised(tmp_path):
    class EnoughError(Exception):
        pass

    def progress(t: float, _duration: float) -> None:
        if t >= 1.0:
            raise EnoughError(t)

    path = tmp_path / "run.mcap"
    scenario = nrs.Scenario.load(PAPER)
    with pytest.raises(EnoughError, match=r"1\.0"):
        nrs.run(scenario, path, progress=progress)
    with nrs.Recording(path) as recording:
        assert (recording.status, recording.damage) == ("interrupted", [])
        assert recording.ticks == 9
        with nrs.resume(recording) as whole:
            assert whole.digest.startswith("5433c658")
    before = set(Path(os.environ.get("TMPDIR", "/tmp")).glob("nrs-run-*"))
    with pytest.raises(EnoughError):
        nrs.run(scenario, progress=progress)
    assert set(Path(os.environ.get("TMPDIR", "/tmp")).glob("nrs-run-*")) <= before


def test_a_first_signal_while_a_run_is_set_up_ends_it_and_a_second_always_does(tmp_path):
    scenario = nrs.Scenario.load(PAPER)

    def setting_up(*_):
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError("the signal came later")

    path = tmp_path / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("nrs_cosim.api.run.run_experiment", lambda *_a, **_k: setting_up())
        with pytest.raises(KeyboardInterrupt, match="before the run began"):
            nrs.run(scenario, path)
    assert not path.exists()

    def progress(t: float, _duration: float) -> None:
        if t >= 1.0:
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt, match="twice, so at once"):
        nrs.run(scenario, path, progress=progress)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_process_that_ignores_ctrl_c_continues():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        short = nrs.Scenario.load(PAPER).replace({"run.duration": 2.0})
        with nrs.run(short, progress=lambda *_: os.kill(os.getpid(), signal.SIGINT)) as recording:
            assert recording.status == "completed"
    finally:
        signal.signal(signal.SIGINT, before)
