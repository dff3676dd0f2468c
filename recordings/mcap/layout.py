"""Where things stand in a file: by its summary if that is intact, else by walking from record to
record. Neither reads a message, neither believes a length beyond the end of the file, and neither
finds a byte in two chunks.
"""

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import BinaryIO, TypeVar

from mcap import records as mcap
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode

from nrs_cosim.recordings.mcap.container import (
    CRC,
    END,
    FOOTER,
    LIMIT,
    MAGIC,
    RECORD,
    DamageError,
    demand,
)

_CHUNK_INDEX = struct.Struct("<BQQQQQ")  # opcode, length, start, end (ns), offset, length of chunk
_DATA_END = struct.Struct("<BQI")
_BLOCK = 2**20
_Record = TypeVar("_Record")


@dataclass(frozen=True, slots=True)
class Span:
    """Where a record stands (bytes); of a chunk, the times of its first and last message (ns)."""

    offset: int
    length: int
    start: int = 0
    end: int = 0


@dataclass(slots=True)
class Layout:
    """The chunks, "nrs.end" if there is one, and what was in the way of finding them.

    `intact` when the checksums of the summary and of all data before it agree.
    """

    chunks: list[Span] = field(default_factory=list)
    end: Span | None = None
    intact: bool = False
    damage: list[str] = field(default_factory=list)


class RecordFile:
    """A file as a row of records; `size` (bytes) is that at opening."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.size = file.seek(0, 2)

    def read(self, at: int, length: int) -> bytes:
        """The bytes at `at`, fewer at the end of the file; DamageError beyond 1 GiB."""
        demand(length <= LIMIT, f"the record at byte {at} has {length} bytes, more than {LIMIT}")
        self._file.seek(at)
        return self._file.read(length)

    def walk(self, at: int, stop: int) -> Iterator[tuple[int, Span]]:
        """Opcode and span of every record from `at` to `stop`; DamageError if one goes beyond."""
        while at < stop:
            start = self.read(at, RECORD.size)
            opcode, length = RECORD.unpack(start) if len(start) == RECORD.size else (0, stop)
            after = at + RECORD.size + length
            demand(
                after <= stop,
                f"the file ends inside a record: the last {stop - at} bytes, from byte {at} on, "
                "cannot be read",
            )
            yield opcode, Span(at, after - at)
            at = after

    def crc(self, start: int, stop: int) -> int:
        """The CRC-32 of a stretch."""
        crc = 0
        self._file.seek(start)
        while start < stop and (block := self._file.read(min(_BLOCK, stop - start))):
            crc = zlib.crc32(block, crc)
            start += len(block)
        return crc


def parsed(read: Callable[[ReadDataStream], _Record], record: bytes) -> _Record:
    """The record by mcap's reader of its kind; DamageError if it is ill-formed."""
    try:
        return read(ReadDataStream(BytesIO(record[RECORD.size :])))
    except (struct.error, EndOfFile, UnicodeDecodeError) as error:
        raise DamageError(f"a record is ill-formed ({error})") from error


def find(file: RecordFile, after_head: int) -> Layout:
    """What stands after the head."""
    try:
        return _indexed(file, after_head)
    except (DamageError, struct.error):
        return _scanned(file, after_head)


def _indexed(file: RecordFile, after_head: int) -> Layout:
    """By the summary; DamageError or struct.error if it is not intact."""
    crc_at = file.size - len(MAGIC) - CRC.size
    footer_at = crc_at - FOOTER.size
    demand(footer_at > 0 and file.read(crc_at + CRC.size, len(MAGIC)) == MAGIC, "no end")
    kind, _, start, _ = FOOTER.unpack(file.read(footer_at, FOOTER.size))
    demand(kind == Opcode.FOOTER and _DATA_END.size <= start <= footer_at, "no footer")
    (crc,) = CRC.unpack(file.read(crc_at, CRC.size))
    demand(crc == file.crc(start, crc_at), "the summary's checksum differs")
    layout, free = Layout(), after_head
    for kind, span in file.walk(start, footer_at):
        if kind == Opcode.CHUNK_INDEX:
            _, _, *times, at, length = _CHUNK_INDEX.unpack(
                file.read(span.offset, _CHUNK_INDEX.size)
            )
            demand(free <= at and at + length <= start, "the summary's chunks are none")
            free = at + length
            layout.chunks.append(Span(at, length, *times))
        elif kind == Opcode.METADATA_INDEX:
            index = parsed(mcap.MetadataIndex.read, file.read(span.offset, span.length))
            if index.name == END:
                layout.end = Span(index.offset, index.length)
    data_end = start - _DATA_END.size
    expected = _DATA_END.pack(Opcode.DATA_END, CRC.size, file.crc(0, data_end))
    layout.intact = file.read(data_end, _DATA_END.size) == expected
    return layout


def _scanned(file: RecordFile, after_head: int) -> Layout:
    """By walking to the end of the data, or as far as it goes."""
    layout = Layout()
    skipped_to = -1
    try:
        for kind, span in file.walk(after_head, file.size):
            if kind == Opcode.CHUNK:
                layout.chunks.append(span)
            elif kind == Opcode.METADATA:
                layout.end = span
            elif kind == Opcode.DATA_END and span.length == _DATA_END.size:
                break
            elif kind != Opcode.MESSAGE_INDEX or not _is_index(file, span):
                if skipped_to != span.offset:
                    layout.damage.append(f"from byte {span.offset} on: unknown records, skipped")
                skipped_to = span.offset + span.length
    except DamageError as damage:
        layout.damage.append(str(damage))
    return layout


def _is_index(file: RecordFile, span: Span) -> bool:
    """Whether a message index has the length that it says: a chunk in its guise has not."""
    entries = file.read(span.offset + 11, 4)
    return span.length >= 15 and struct.unpack("<I", entries)[0] == span.length - 15
