"""A process of ours ends with what it started and with its parent, and it is said how it ended."""

import os
import select
import signal
import subprocess
import sys
import tempfile
from contextlib import contextmanager

import pytest

from nrs_cosim.plant_fmu.processes import (
    PRINTED,
    describe_ending,
    end_group,
    last_words,
    printed_tail,
    start_python,
    wait_group,
)
from tests.guard import GUARD

ACTS = """
import ctypes, os, signal, subprocess, sys, tempfile
from nrs_cosim.plant_fmu.processes import follow_parent
def main():
    exec(sys.argv[1], globals())
"""
"""A module that does as its argument says."""
STARTS = """
import signal, subprocess, sys
from nrs_cosim.plant_fmu.processes import start_python
start_python("acts", sys.argv[1], stderr=subprocess.DEVNULL, pass_fds=[int(sys.argv[2])])
signal.pause()
"""
"""A parent that starts the module on its first argument, and waits to be killed."""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Return a folder that modules are imported from, with one that does as it is told."""
    (tmp_path / "acts.py").write_text(ACTS, "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


@pytest.fixture
def act(place):
    """Return a function that does something in a process; what that prints is in a file."""
    started = []

    def start(code, **more):
        with (place / "printed").open("wb") as printed:
            process = start_python("acts", code, stdout=printed, stderr=printed, **more)
        started.append(process)
        return process

    yield start
    for process in started:
        end_group(process)


@contextmanager
def held():
    """Yield the end of a pipe that processes hold open, and what waits for a word or their end."""
    ours, theirs = os.pipe()
    poll = select.poll()
    poll.register(ours, select.POLLIN)

    def read():
        assert poll.poll(GUARD * 1000)
        return os.read(ours, 100)

    os.set_inheritable(theirs, True)
    try:
        yield theirs, read
    finally:
        os.close(ours)


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("sys.exit(3)", "exited with status 3"),
        ("pass", "exited with status 0"),
        ("os.abort()", "aborted (SIGABRT)"),
        ("ctypes.string_at(0)", "crashed with SIGSEGV"),
        ("os.kill(os.getpid(), signal.SIGFPE)", "crashed with SIGFPE"),
        ("os.kill(os.getpid(), signal.SIGKILL)", "was killed (SIGKILL)"),
        ("os.kill(os.getpid(), signal.SIGTERM)", "was killed (SIGTERM)"),
        ("os.kill(os.getpid(), signal.SIGHUP)", "was killed (SIGHUP)"),
    ],
)
def test_the_end_of_a_process_is_described(act, code, said):
    process = act(code)
    assert describe_ending(process.wait(GUARD)) == said
    assert describe_ending(end_group(process)) == said, "its own end counts, not ours"


@pytest.mark.skipif(sys.platform != "linux", reason="real-time signals")
def test_a_signal_without_a_name_is_given_by_number(act):
    number = signal.SIGRTMIN + 1
    process = act(f"os.kill(os.getpid(), {number})")
    assert describe_ending(process.wait(GUARD)) == f"was killed (signal {number})"


def test_a_process_that_runs_has_no_status_and_one_that_is_ended_has(act):
    process = act("signal.pause()")
    assert wait_group(process) is None
    assert describe_ending(end_group(process)) == "was killed (SIGKILL)"
    assert wait_group(process) == -signal.SIGKILL


def test_the_last_output_of_a_killed_process_is_kept(act, place):
    lines = "for i in range(5): sys.stdout.write(f'line {i}\\n')"
    act(f"{lines}\nsys.stdout.write('half'); os.kill(os.getpid(), signal.SIGKILL)").wait(GUARD)
    assert last_words(printed_tail(place / "printed")) == "; it printed: line 3 / line 4 / half"


@pytest.mark.skipif(sys.platform != "linux", reason="what C prints goes out by the line on Linux")
def test_output_of_c_code_is_kept_when_the_process_is_killed(act, place):
    prints = "follow_parent()\nctypes.CDLL(None).printf(b'from C\\n')"
    act(f"{prints}\nos.kill(os.getpid(), signal.SIGKILL)").wait(GUARD)
    assert last_words(printed_tail(place / "printed")) == "; it printed: from C"


def test_the_last_output_is_three_escaped_lines_joined_into_one(tmp_path):
    assert last_words(b"") == last_words(b" \n\t\n") == ""
    assert last_words(b"a\n\nb\r\nc\n d \n") == "; it printed: b / c / d"
    assert last_words(b"\x1b[2Jgone\xff") == "; it printed: [2Jgone\ufffd"
    path = tmp_path / "much"
    path.write_bytes(b"x" * PRINTED + b"\n" + b"y" * (PRINTED - 1) + b"\n")
    assert printed_tail(path) == b"y" * (PRINTED - 1) + b"\n"
    assert printed_tail(tmp_path / "none") == b""


@pytest.mark.parametrize("how", ["polled", "ended while it runs", "ended after its end"])
def test_children_of_a_process_end_with_it(act, how):
    """The one it started holds a pipe, and would for ever."""
    with held() as (theirs, read):
        other = "subprocess.Popen([sys.executable, '-c', 'import signal; signal.pause()'], "
        other += f"pass_fds=[{theirs}])"
        after = "signal.pause()" if how == "ended while it runs" else "os._exit(0)"
        process = act(f"{other}\nos.write({theirs}, b'started')\n{after}", pass_fds=[theirs])
        os.close(theirs)
        assert read() == b"started"
        if how != "ended while it runs":
            os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        assert (wait_group if how == "polled" else end_group)(process) is not None
        assert read() == b"", "somebody holds the pipe still"


@pytest.mark.skipif(sys.platform != "linux", reason="Linux ends a process with its parent")
def test_a_process_ends_with_its_parent(place):
    with held() as (theirs, read):
        code = f"follow_parent(); os.write({theirs}, b'here'); signal.pause()"
        parent = subprocess.Popen(
            [sys.executable, "-c", STARTS, code, str(theirs)],
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(place), *sys.path])},
            pass_fds=[theirs],
        )
        os.close(theirs)
        assert read() == b"here"
        parent.kill()
        parent.wait(GUARD)
        assert read() == b"", "it lives on"


@pytest.mark.skipif(sys.platform != "linux", reason="Linux ends a process with its parent")
def test_a_process_whose_parent_ended_first_ends_too(act, place):
    another = "os.environ['NRS_PARENT'] = str(os.getpid())"
    process = act(f"{another}\nfollow_parent()\nprint('went on')")
    assert process.wait(GUARD) == 1
    assert printed_tail(place / "printed") == b""


def test_a_process_imports_from_its_parents_path_and_not_its_folder(act, place, monkeypatch):
    folder = place / "elsewhere"
    folder.mkdir()
    for name in ("nrs_cosim", "tempfile", "acts"):
        (folder / f"{name}.py").write_text("raise SystemExit('not this one')", "utf-8")
    monkeypatch.chdir(folder)
    assert act("pass").wait(GUARD) == 0, printed_tail(place / "printed")


def test_temporary_files_of_a_process_go_to_the_given_folder(act, place):
    assert act("print(tempfile.gettempdir())", temporary=place).wait(GUARD) == 0
    assert printed_tail(place / "printed").decode().strip() == str(place)
    assert act("print(tempfile.gettempdir())").wait(GUARD) == 0
    assert printed_tail(place / "printed").decode().strip() == tempfile.gettempdir()


def test_a_process_that_cannot_start_is_an_os_error(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nonexistent/python")
    with pytest.raises(FileNotFoundError):
        start_python("acts", stderr=subprocess.DEVNULL)
