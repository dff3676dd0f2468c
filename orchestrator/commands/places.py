"""A recording never destroys another file by accident, and a run that never began leaves none."""

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from itertools import chain, count
from pathlib import Path

from bus.errors import InputError
from recordings.container import MAGIC

DATA = Path("recordings/data")


@contextmanager
def place_for(output: Path | None, name: str) -> Iterator[Path]:
    """Yield where a recording goes: an output path, or a new name in `recordings/data`.

    Only a recording, or an empty file, is replaced; `InputError` else. A new name is taken at
    once, so that runs that begin together do not share it, and given back if nothing was written.
    """
    folder = DATA if output is None else output.parent
    make_folder(folder / name)
    try:
        path = _new(name) if output is None else output
        if output is not None and output.exists():
            expect_replaceable(output, "recording", MAGIC)
    except OSError as error:
        raise InputError(f"{output or folder}: cannot be written: {error.strerror}") from None
    try:
        yield path
    finally:
        if output is None and path.exists() and path.stat().st_size == 0:
            path.unlink()


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
        raise InputError(f"-o {output}: is the recording itself; give another name")


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
