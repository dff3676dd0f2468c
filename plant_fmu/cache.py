"""What is in the cache is this user's, in a folder of theirs, and still what was put there.

Code from the cache is run, so it is believed no more than any input: nobody but the user owns its
folder or may write there, and its bytes have the digest that stands beside it, or in its name. What
is not whole is as if not there, and is made again. A file and its digest are on the disk before
they have their names, so no crash leaves half of one.

FMUs are kept by content too, under their digest: whoever has only a scenario's text and a digest
finds the FMU of that digest.
"""

import hashlib
import os
import re
import stat
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import NamedTemporaryFile

from nrs_cosim.plant_fmu.errors import FmuError

_DIGEST = ".sha256"
_SHA256 = re.compile("[0-9a-f]{64}")
_ADVICE = "set NRS_CACHE to another folder"


def cache_folder() -> Path:
    """Return where built FMUs are kept: it need not exist yet. `FmuError` where there is no place.

    It is $NRS_CACHE, or `nrs-cosim` in the user's cache folder. $XDG_CACHE_HOME counts where it is
    absolute, as the XDG Base Directory Specification has it.
    """
    if override := os.environ.get("NRS_CACHE"):
        return Path(override).absolute()
    if sys.platform == "win32":
        variable, default = "LOCALAPPDATA", ("AppData", "Local")
    elif sys.platform == "darwin":
        variable, default = "", ("Library", "Caches")
    else:
        variable, default = "XDG_CACHE_HOME", (".cache",)
    chosen = os.environ.get(variable, "")
    if Path(chosen).is_absolute():
        return Path(chosen) / "nrs-cosim"
    try:
        home = Path.home()
    except RuntimeError:
        home = Path()
    if not home.is_absolute():
        raise FmuError(
            "no place to keep built FMUs: this user has no home folder; set NRS_CACHE to a folder"
        )
    return home.joinpath(*default, "nrs-cosim")


def stored(name: str, sha256: str | None = None) -> Path | None:
    """Return where a file of the cache is, if it is there with a digest, else the one beside it.

    `FmuError` where another user could have put it there.
    """
    path = cache_folder() / name
    if not _expect_private(path.parent):
        return None
    digest = sha256 or _read(path.with_name(path.name + _DIGEST)).decode("ascii", "replace")
    data = _read(path)
    return path if data and hashlib.sha256(data).hexdigest() == digest else None


def keep(name: str, data: bytes, sha256: str | None = None) -> Path:
    """Keep a file in the cache, whole for whoever reads it; with its digest unless that is given.

    `FmuError` where it cannot be kept, or another user could change it.
    """
    path = cache_folder() / name
    for folder in (cache_folder(), path.parent):
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise _not_kept(path, error) from error
        _expect_private(folder)
    try:
        _replace(path, data)
        if sha256 is None:
            digest = hashlib.sha256(data).hexdigest().encode()
            _replace(path.with_name(path.name + _DIGEST), digest)
    except OSError as error:
        raise _not_kept(path, error) from error
    return path


def names(pattern: str) -> Iterator[str]:
    """Yield the names of the files of a pattern, whole or not."""
    for path in cache_folder().glob(pattern):
        yield path.name


def _expect_private(folder: Path) -> bool:
    """Return whether a folder is there; `FmuError` where another user may write into it."""
    try:
        about = folder.stat()
    except OSError:
        return False
    if about.st_uid != os.geteuid():
        raise FmuError(
            f"{folder}: belongs to another user (uid {about.st_uid}), who could put code there "
            "that would be run; set NRS_CACHE to a folder of your own"
        )
    if about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise FmuError(
            f"{folder}: other users may write there (mode {stat.S_IMODE(about.st_mode):o}), and "
            f"put code there that would be run; chmod go-w it, or {_ADVICE}"
        )
    return True


def _read(path: Path) -> bytes:
    """Return the bytes of a regular file that is this user's alone to write; none otherwise."""
    try:
        # Neither a link is followed, nor a FIFO waited for, that somebody put there.
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            about = os.fstat(file.fileno())
            shared = about.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
            if not stat.S_ISREG(about.st_mode) or about.st_uid != os.geteuid() or shared:
                return b""
            return file.read()
    except OSError:
        return b""


def _replace(path: Path, data: bytes) -> None:
    with NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
        part = Path(file.name)
        try:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)


def _not_kept(path: Path, error: OSError) -> FmuError:
    return FmuError(f"{path.parent}: cannot keep an FMU there: {error.strerror}; {_ADVICE}")


def stored_fmu(sha256: str) -> Path | None:
    """Return where the FMU of a digest is kept, if it is; `FmuError` as in `stored`."""
    return stored(_name(sha256), sha256) if _SHA256.fullmatch(sha256) else None


def keep_fmu(data: bytes, sha256: str) -> Path:
    """Keep an FMU's bytes; `FmuError` where they have another digest, or cannot be kept."""
    if (got := hashlib.sha256(data).hexdigest()) != sha256:
        raise FmuError(f"an FMU was to have sha256 {sha256}, but its bytes have {got}")
    return stored_fmu(sha256) or keep(_name(sha256), data, sha256)


def _name(sha256: str) -> str:
    return f"by-sha256/{sha256}.fmu"
