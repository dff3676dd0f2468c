"""A temporary folder is locked as long as its process lives; one that nobody holds is removed.

A process that is killed removes nothing, but the kernel ends its locks.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from shutil import rmtree
from tempfile import gettempdir, mkdtemp

_PREFIX = "nrs-own-"


@contextmanager
def own_folder(within: str | None = None) -> Iterator[Path]:
    """Yield a folder that ends with the context; first those of processes that were killed end.

    It is in the folder for temporary files unless another is given.
    """
    place = within or gettempdir()
    for left in Path(place).glob(f"{_PREFIX}*"):
        with suppress(OSError):  # somebody holds it, or it is another user's, or gone
            lock = _lock(left, fcntl.LOCK_EX | fcntl.LOCK_NB)
            rmtree(left, ignore_errors=True)
            os.close(lock)
    folder, lock = _made(place)
    try:
        yield folder
    finally:
        rmtree(folder, ignore_errors=True)
        os.close(lock)


def _made(place: str) -> tuple[Path, int]:
    """Return a new folder and its lock; another process may remove it before it is locked."""
    while True:
        folder = Path(mkdtemp(prefix=_PREFIX, dir=place))
        with suppress(FileNotFoundError):
            lock = _lock(folder, fcntl.LOCK_EX)
            if folder.exists():
                return folder, lock
            os.close(lock)


def _lock(folder: Path, how: int) -> int:
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        if os.fstat(lock).st_uid != os.getuid():
            raise PermissionError
        fcntl.flock(lock, how)
    except OSError:
        os.close(lock)
        raise
    return lock
