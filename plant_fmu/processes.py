"""A Python process that this one starts, and the words for how it ended.

It imports what this process would, and nothing that happens to lie where it starts. It is a process
group of its own: Ctrl-C in the terminal is its parent's to decide on, and whatever it started ends
with it. What it prints is not held back, so a process that is killed has said its last words.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Collection
from contextlib import suppress
from ctypes import CDLL, c_void_p
from pathlib import Path
from typing import IO

PRINTED = 2000
"""Bytes of what a process printed that are kept, the last ones."""
_PARENT = "NRS_PARENT"
"""By which a process that is started here knows who started it."""
_MAIN = """
import atexit, gc, importlib, sys
gc.disable()
main = importlib.import_module(sys.argv.pop(1)).main
gc.freeze(); gc.enable(); atexit.register(gc.freeze)
main()
"""
"""What imports make stays to the end, and is never searched for cycles: a quarter of a start."""
_CRASHES = ("SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV", "SIGSYS", "SIGTRAP")
"""Signals of a process's own doing; the others are somebody else's."""


def start_python(
    module: str,
    *arguments: str,
    stderr: int | IO[bytes] | None,
    stdin: int = subprocess.DEVNULL,
    stdout: int | IO[bytes] = subprocess.DEVNULL,
    temporary: Path | None = None,
    pass_fds: Collection[int] = (),
) -> subprocess.Popen[bytes]:
    """Start the `main` of a module; its temporary files go to a folder where one is given.

    Its pipes are not buffered; with None it has this process's standard error. `OSError` when it
    cannot start.
    """
    path = os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)
    environment = {**os.environ, "PYTHONPATH": path, _PARENT: str(os.getpid())}
    if temporary is not None:
        environment["TMPDIR"] = str(temporary)
    return subprocess.Popen(
        [sys.executable, "-P", "-u", "-c", _MAIN, module, *arguments],
        bufsize=0,
        stdin=stdin,
        stdout=stdout,
        stderr=stderr,
        env=environment,
        pass_fds=pass_fds,
        start_new_session=True,
    )


def follow_parent() -> None:
    """Let Linux end this process, which `start_python` started, with the thread that did it.

    What C prints then goes out by the line, as what Python prints does.
    """
    if sys.platform != "linux":
        return
    libc = CDLL(None)
    set_death_signal, line_buffered = 1, 1
    libc.prctl(set_death_signal, signal.SIGKILL)
    # A parent that ended before that sends no signal, but this process has another one by now.
    if os.getppid() != int(os.environ[_PARENT]):
        os._exit(1)
    libc.setvbuf(c_void_p.in_dll(libc, "stdout"), None, line_buffered, 0)


def wait_group(process: subprocess.Popen[bytes], seconds: float = 0.0) -> int | None:
    """Return the status of a process that ends by itself in time, and end what it started."""
    if process.returncode is None:
        if seconds:
            with suppress(subprocess.TimeoutExpired):
                process.wait(seconds)
        if process.poll() is not None:
            # At once: when the last of a group is gone, its id may become another's.
            _kill(process.pid)
    return process.returncode


def end_group(process: subprocess.Popen[bytes]) -> int:
    """Kill a process and what it started, and return its status; its own where it had ended."""
    if process.returncode is None:
        # Before it is waited for: as long as it is not, its id is no other's.
        _kill(process.pid)
    return process.wait()


def _kill(group: int) -> None:
    with suppress(ProcessLookupError, PermissionError):  # of macOS, when all of it have ended
        os.killpg(group, signal.SIGKILL)


def describe_ending(status: int) -> str:
    """Say how a process ended: with a status of its own, or by which signal."""
    if status >= 0:
        return f"exited with status {status}"
    names = {number.value: number.name for number in signal.Signals}
    name = names.get(-status, f"signal {-status}")  # real-time signals have no name
    if name == "SIGABRT":
        return "aborted (SIGABRT)"
    return f"crashed with {name}" if name in _CRASHES else f"was killed ({name})"


def printed_tail(path: Path) -> bytes:
    """Return the end of what a process printed into a file; nothing where that is gone."""
    with suppress(OSError), path.open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - PRINTED))
        return file.read()
    return b""


def last_words(printed: bytes) -> str:
    """Return the last three lines that a process printed, as the end of a sentence."""
    lines = printed[-PRINTED:].decode(errors="replace").split("\n")
    plain = ("".join(c if c.isprintable() else " " for c in line).strip() for line in lines)
    last = " / ".join([line for line in plain if line][-3:])
    return f"; it printed: {last}" if last else ""
