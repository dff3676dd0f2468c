"""Messages arranged by `arrangement.c`, to the same bytes as NumPy arranges them.

Whoever can compile it hands it to the writer.
"""

import sys
from collections.abc import Iterable, Iterator
from ctypes import CDLL, Structure, byref, c_size_t, c_void_p
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.recordings.mcap.arrangement import Arrange, Arranging
from nrs_cosim.recordings.mcap.chunk import INDEX, INDEXED, OFFSET, ChunkRecords
from nrs_cosim.recordings.mcap.columns import HEAD, Bytes, Columns
from nrs_cosim.recordings.mcap.digest import FIXED, Digest
from nrs_cosim.recordings.mcap.ordering import Rank

SOURCE = Path(__file__).with_suffix(".c")
_KEY_WORDS = 3
"""u64: time, place, row."""


class _Messages(Structure):
    _fields_ = (
        ("n", c_size_t),
        *((name, c_void_p) for name in ("data", "channel", "sequence", "time", "start", "stop")),
    )


class _Channels(Structure):
    kept: Any
    """What the addresses are of."""
    _names = ("rank", "prefixes", "prefix", "prefix_size", "count", "cursor")
    _fields_ = tuple((name, c_void_p) for name in _names)


class _Made(Structure):
    _places = ("keys", "used", "records", "index", "offsets", "stream")
    _fields_ = (
        *((name, c_void_p) for name in _places),
        *((name, c_size_t) for name in ("n_used", "index_size", "stream_size")),
    )


def arranging_by(library: Path) -> Arranging:
    """Return how native code arranges messages, whose library is there; OSError where it is not."""
    if sys.byteorder != "little":
        raise OSError("the byte order is not that of files")
    arrange = CDLL(str(library)).arrange
    arrange.argtypes, arrange.restype = [c_void_p] * 3, None
    return lambda rank, digest: _arrange_by(arrange, rank, digest)


def _arrange_by(native: Any, rank: Rank, digest: Digest) -> Arrange:
    prefixes = np.frombuffer(digest.prefixes, np.uint8)
    count, cursor = np.zeros((2, len(rank)), np.uint64)
    kept = rank, prefixes, digest.starts, digest.lengths, count, cursor
    channels = _Channels(*_addresses(kept))
    channels.kept = kept
    longest = int(digest.lengths.max()) + FIXED.itemsize

    def arrange(messages: Columns) -> tuple[ChunkRecords, Bytes]:
        n, most = len(messages.channel), min(len(messages.channel), len(rank))
        columns = (
            np.frombuffer(messages.data, np.uint8),
            np.ascontiguousarray(messages.channel, np.uint16),
            np.ascontiguousarray(messages.sequence, np.uint32),
            np.ascontiguousarray(messages.time, np.uint64),
            np.ascontiguousarray(messages.start, np.int64),
            np.ascontiguousarray(messages.stop, np.int64),
        )
        size = int((messages.stop - messages.start).sum())
        keys, used = np.empty(2 * _KEY_WORDS * n, np.uint64), np.empty(most, np.uint16)
        offsets = np.empty(most, OFFSET)
        records, index, stream = (
            np.empty(room, np.uint8)
            for room in (
                size + n * HEAD.itemsize,
                most * INDEX.itemsize + n * INDEXED,
                size + n * longest,
            )
        )
        arrays = keys, used, records, index, offsets, stream
        made = _Made(*_addresses(arrays))
        native(byref(_Messages(n, *_addresses(columns))), byref(channels), byref(made))
        times = columns[3]
        return ChunkRecords(
            records.data,
            index[: made.index_size].data,
            offsets[: made.n_used],
            int(times.min()),
            int(times.max()),
        ), stream[: made.stream_size].data

    return arrange


def _addresses(arrays: Iterable[NDArray[Any]]) -> Iterator[int]:
    return (array.ctypes.data for array in arrays)
