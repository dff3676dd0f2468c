"""A recording never destroys another file by accident, and a run that never began leaves none.

One file has one writer, who holds its lock: the operating system's own (flock), on the very file
that is written, so that who is killed holds none and leaves nothing behind. A file system without
locks is told of once, and goes without.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from itertools import chain, count
from pathlib import Path

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.terminal import say
from nrs_cosim.recordings.mcap.container import MAGIC

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


DATA = Path("recordings/data")
PART = ".part"
"""Ends the name of what is to take the place of a recording, until it is complete."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a recording goes: what is written, and whose place it takes when it is complete."""

    written: Path
    final: Path

    def settle(self, complete: bool) -> Path:
        """Return where the recording is from now on: a complete one is in the place of the old.

        It is on the disk before it is; one that is not complete stays beside it.
        """
        if self.written == self.final or not complete:
            return self.written
        with self.written.open("rb") as file:
            os.fsync(file.fileno())
        self.written.replace(self.final.resolve())
        return self.final


@contextmanager
def place_for(output: Path | None, name: str, *, force: bool = False) -> Iterator[Place]:
    """Yield where a recording goes: an output path, or a new name in `recordings/data`.

    It is locked meanwhile. `InputError` where another process writes there; for a recording that is
    there unless `force` says that it may be replaced; and for any other file that is not empty. A
    new name is taken at once, so that runs that begin together do not share it, and given back if
    nothing was written.
    """
    folder = DATA if output is None else output.parent
    make_folder(folder / name)
    with ExitStack() as stack:
        try:
            final = _new(name) if output is None else output
            was_there = output is not None and output.exists()
            expect_replaceable(final, "recording", MAGIC)
            whole = final.resolve()  # where a link leads to
            stack.enter_context(locked(final))
            expect_replaceable(final, "recording", MAGIC)  # what another has finished meanwhile
            is_held = final.stat().st_size > 0
            if is_held and not force:
                raise InputError(
                    f"{output}: is there already; give another name, or --force to replace it "
                    "(force=True in Python)"
                )
            written = stack.enter_context(_part_of(whole)) if is_held else final
        except OSError as error:
            raise InputError(f"{output or folder}: cannot be written: {error.strerror}") from None
        try:
            yield Place(written, final)
        finally:
            if not (was_there and written == final):
                _give_back(written)


def expect_replaceable(path: Path, kind: str, *begins: bytes) -> None:
    """Raise `InputError` for a path that has a file of another kind, which begins otherwise."""
    expect_folder(path.parent)
    if not path.exists():
        return
    if not path.is_file():
        raise InputError(f"{path}: is no regular file; give another name for the {kind}")
    with path.open("rb") as file:
        begin = file.read(max(map(len, begins)))
    if begin and not begin.lower().startswith(tuple(b.lower() for b in begins)):
        raise InputError(f"{path}: exists and is no {kind}; give another name")


def expect_folder(folder: Path) -> None:
    """Raise `InputError` for a folder that can be none, since a file is in its place."""
    there = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    if there.exists() and not there.is_dir():
        raise InputError(f"{there}: is a file and not a folder; give another place")


def make_folder(output: Path) -> None:
    """Make the folder of a file that is to be written; `InputError` where there can be none."""
    expect_folder(output.parent)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be written: {error.strerror}") from None


def expect_another(output: Path | None, recording: Path) -> None:
    """Raise `InputError` for an output that is the very recording that is read."""
    if output is not None and output.exists() and output.samefile(recording):
        raise InputError(f"{output}: is the recording itself; give another name")


def _new(name: str) -> Path:
    stem = f"{name}-{datetime.now():%Y%m%d-%H%M%S}"
    names = chain([f"{stem}.mcap"], (f"{stem}-{number}.mcap" for number in count(2)))
    return next(path for path in map(DATA.joinpath, names) if _taken(path))


def _taken(path: Path) -> bool:
    """Take a name, unless somebody has it."""
    try:
        path.touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def unfinished(path: Path) -> Path:
    """Return what was to take the place of a recording and did not, if there is such."""
    part = path.with_name(path.name + PART)
    return part if part.exists() else path


@contextmanager
def _part_of(whole: Path) -> Iterator[Path]:
    """Yield a new file beside a recording, locked; what an earlier run left there is kept."""
    parts = (f"{PART}{number}" for number in count(2))
    names = (whole.with_name(whole.name + part) for part in chain([PART], parts))
    part = next(path for path in names if _taken(path))
    with locked(part):
        yield part


def _give_back(path: Path) -> None:
    """Remove a file that was made for a recording, if nothing was written into it.

    Where the path is a link, the link is the user's, and the file that it leads to was made.
    """
    if path.exists() and path.stat().st_size == 0:
        path.resolve().unlink()
