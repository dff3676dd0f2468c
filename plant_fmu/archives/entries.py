"""An archive may come from a stranger: nothing in it is used before all of it has been looked at.

Its entries lie below the folder that it is unpacked to, are files or folders, and are stored or
deflated, as FMI has it (FMI 3.0, section 2.5). Their number and size have a limit, and each entry
is what its checksum says. What an entry declares as its size is all that is ever read of it.
"""

import stat
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import BinaryIO
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile, ZipInfo

from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.errors import FmuError

GIB = 1 << 30
MOST_BYTES = GIB
"""Of the archive, and of all that it unpacks to."""
MOST_ENTRIES = 100_000
BOMB_BYTES, BOMB_RATIO = 64 << 20, 200
"""More bytes than these, that many times the archive's, are no binaries and no data."""
_DAMAGE = (
    BadZipFile,
    struct.error,
    zlib.error,
    EOFError,
    OSError,
    ValueError,
    NotImplementedError,
    RuntimeError,
)
"""What zipfile raises for damaged archives; NotImplementedError for compressions it has not."""


@contextmanager
def opened_archive(file: BinaryIO, label: str) -> Iterator[ZipFile]:
    """Open an archive whose entries are fit to be read; `FmuError` with the cause when not."""
    try:
        archive = ZipFile(file)
    except _DAMAGE as error:
        raise FmuError(
            f"{label}: is not an FMU: it is not a zip archive, or a damaged one: {error}"
        ) from None
    with archive:
        # First what is declared, for testzip decompresses all of it.
        if fault := _fault(archive, file.seek(0, 2)):
            raise FmuError(f"{label}: is refused: {fault}")
        try:
            damaged = archive.testzip()
        except _DAMAGE as error:
            raise FmuError(f"{label}: is a damaged zip archive: {error}") from None
        if damaged is not None:
            raise FmuError(
                f"{label}: is a damaged zip archive: {quoted(damaged)} has a bad checksum"
            )
        yield archive


def unpack(file: BinaryIO, folder: Path, label: str) -> None:
    """Unpack an archive that `opened_archive` has let pass into an empty folder."""
    try:
        with ZipFile(file) as archive:
            archive.extractall(folder)
    except _DAMAGE as error:
        raise FmuError(f"{label}: cannot be unpacked: {error}") from None


def _fault(archive: ZipFile, size: int) -> str | None:
    """Return what is wrong with the entries as they are declared."""
    entries = archive.infolist()
    if len(entries) > MOST_ENTRIES:
        return f"it has {len(entries)} entries, more than {MOST_ENTRIES}"
    total = sum(entry.file_size for entry in entries)
    if total > MOST_BYTES:
        return f"it unpacks to {total / GIB:.1f} GiB, more than {MOST_BYTES / GIB:g} GiB"
    if total > max(BOMB_BYTES, BOMB_RATIO * size):
        return f"its {size} bytes unpack to {total}, more than {BOMB_RATIO} times as many"
    twice = [name for name, n in Counter(e.orig_filename for e in entries).items() if n > 1]
    if twice:
        return f"its entry {quoted(twice[0])} is there more than once"
    faults = ((entry, _entry_fault(entry)) for entry in entries)
    return next(
        (f"its entry {quoted(e.orig_filename)} {fault}" for e, fault in faults if fault), None
    )


def _entry_fault(entry: ZipInfo) -> str | None:
    name, mode = entry.orig_filename, entry.external_attr >> 16
    if name.startswith("/") or "\\" in name or ":" in name or "\0" in name:
        return "has a path that is not relative with forward slashes"
    if ".." in PurePosixPath(name).parts:
        return "has a path that leads out of the archive"
    if stat.S_IFMT(mode) not in {0, stat.S_IFREG, stat.S_IFDIR}:
        return "is neither a file nor a folder but a link or a device"
    if entry.compress_type not in {ZIP_STORED, ZIP_DEFLATED}:
        return "is compressed by another method than deflate"
    if entry.flag_bits & 1:
        return "is encrypted"
    return None
