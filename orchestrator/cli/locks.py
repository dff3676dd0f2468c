"""One file has one writer: who writes it holds its lock, and who is killed holds none.

The lock is the operating system's own (flock), on the very file that is written, so that nothing
is left behind. A file system without locks is told of once, and goes without.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.terminal import say

LOCKS = Path("/proc/locks")
"""Where Linux says who holds which."""


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock of the file at a path, which is made if it is not there.

    Raises `InputError` that names who has it. A file that another one took the place of, between
    when it was opened and when it was locked, is let go, and the other one is locked.
    """
    with ExitStack() as stack:
        while True:
            file = stack.enter_context(path.open("ab"))
            _lock(file.fileno(), path)
            if path.exists() and os.path.samestat(os.fstat(file.fileno()), path.stat()):
                break
            stack.pop_all().close()
        yield


def expect_unlocked(path: Path) -> None:
    """Raise `InputError` for a file that is being written."""
    if path.is_file():
        with path.open("rb") as file:
            _lock(file.fileno(), path)


def _lock(descriptor: int, path: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(
            f"{path}: is being written by {_holder(descriptor)}; wait for its end, or give another "
            "name"
        ) from None
    except OSError as error:
        say("yellow", "lock", f"{path}: {error.strerror}: nothing keeps others from writing it")


def _holder(descriptor: int) -> str:
    """Name the process that holds the lock of a file, where the system tells."""
    stat = os.fstat(descriptor)
    place = f"{os.major(stat.st_dev):02x}:{os.minor(stat.st_dev):02x}:{stat.st_ino}"
    with suppress(OSError):
        for line in LOCKS.read_text("ascii").splitlines():
            fields = line.split()
            if fields[1] == "FLOCK" and fields[5] == place:
                return f"process {fields[4]}"
    return "another process"
