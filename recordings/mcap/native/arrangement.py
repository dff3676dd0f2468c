"""Messages arranged by `arrangement.c`, to the same bytes as NumPy arranges them.

Whoever can compile it hands it to the writer.
"""

import sys
from collections.abc import Sequence
from ctypes import CDLL, Structure, byref, c_char_p, c_size_t, c_uint64, c_void_p
from pathlib import Path
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.recordings.mcap.arrangement import Arrange, Arranged, Arranging
from nrs_cosim.recordings.mcap.chunk import INDEX, INDEXED, OFFSET, ChunkRecords
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.digest import Digest
from nrs_cosim.recordings.mcap.ordering import Rank

SOURCE = Path(__file__).with_suffix(".c")
_COLUMNS = ("channel", "sequence", "time", "start", "stop")
_PART = Struct("=12q")
"""Count, address of the data, and of each column its address and stride."""
_MESSAGE_BYTES = 32
_ROOM = (
    *("messages", "spare", "sequences", "cursors", "counts", "used"),
    *("records", "index", "offsets", "stream"),
)


class _Channels(Structure):
    kept: Any
    """What the addresses are of."""
    _names = ("rank", "prefixes", "prefix", "prefix_size")
    _fields_ = (("n", c_size_t), *((name, c_void_p) for name in _names))


class _Addresses(Structure):
    _fields_ = tuple((name, c_void_p) for name in _ROOM)


class _Made(Structure):
    _sizes = ("n_used", "records_size", "index_size", "stream_size", "ticks")
    _fields_ = (
        *((name, c_size_t) for name in _sizes),
        *((name, c_uint64) for name in ("first", "last")),
    )


class _Room:
    """Arrays that are used again, with anything in them."""

    def __init__(self) -> None:
        self.addresses = _Addresses()
        self._arrays = {name: np.empty(0, np.uint8) for name in _ROOM}

    def expect(self, **sizes: int) -> None:
        """Have room for so many bytes, by name; where it grows, what was there is lost."""
        for name, size in sizes.items():
            if len(self._arrays[name]) < size:
                self._arrays[name] = array = np.empty(size + size // 4, np.uint8)
                setattr(self.addresses, name, array.ctypes.data)

    def of(self, name: str, size: int) -> NDArray[np.uint8]:
        """Return the first bytes of one."""
        return self._arrays[name][:size]


def arranging_by(library: Path) -> Arranging:
    """Return how native code arranges messages, whose library is there; OSError where it is not."""
    if sys.byteorder != "little":
        raise OSError("the byte order is not that of files")
    dll = CDLL(str(library))
    dll.gather.argtypes = [c_char_p, c_size_t, *[c_void_p] * 3]
    dll.arrange.argtypes = [c_size_t, *[c_void_p] * 3]
    dll.gather.restype = dll.arrange.restype = None
    return lambda rank, digest: _arrange_by(dll, rank, digest)


def _arrange_by(native: CDLL, rank: Rank, digest: Digest) -> Arrange:
    gather, arrange = native.gather, native.arrange
    prefixes = np.frombuffer(digest.prefixes, np.uint8)
    kept = rank, prefixes, digest.starts, digest.lengths
    channels = _Channels(len(rank), *(array.ctypes.data for array in kept))
    channels.kept = kept
    room, made = _Room(), _Made()
    into = byref(channels), byref(room.addresses), byref(made)
    by_channel = 8 * len(rank)
    room.expect(cursors=by_channel, counts=by_channel, used=2 * len(rank))

    def arranged(parts: Sequence[Columns]) -> Arranged:
        n, most = sum(len(part.channel) for part in parts), OFFSET.itemsize * len(rank)
        size = _MESSAGE_BYTES * n
        room.expect(messages=size, spare=size, sequences=4 * n)
        gather(b"".join(map(_part, parts)), len(parts), *into)
        room.expect(records=made.records_size, stream=made.stream_size)
        room.expect(index=INDEX.itemsize * len(rank) + INDEXED * n, offsets=most)
        arrange(n, *into)
        records = ChunkRecords(
            room.of("records", made.records_size).data,
            room.of("index", made.index_size).data,
            room.of("offsets", OFFSET.itemsize * made.n_used).view(OFFSET),
            made.first,
            made.last,
        )
        counts = room.of("counts", by_channel).view(np.int64)
        return Arranged(records, room.of("stream", made.stream_size).data, counts, made.ticks)

    return arranged


def _part(of: Columns) -> bytes:
    numbers = [len(of.channel), np.frombuffer(of.data, np.uint8).ctypes.data]
    for name in _COLUMNS:
        column: NDArray[Any] = getattr(of, name)
        numbers += column.ctypes.data, column.strides[0]
    return _PART.pack(*numbers)
