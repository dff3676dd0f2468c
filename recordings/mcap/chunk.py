"""A chunk: the messages of whole ticks in total order, compressed, under one CRC.

    Chunk    start, end, size, CRC of the records, compression, the records
    MessageIndex    for each channel in it: (log_time, offset among the records) of its messages

Its records are messages and nothing else. What it decompresses to is in proportion to what stands
in the file, so that a small file takes little memory whatever it says: a reader believes no more,
and a writer compresses no further. Here alone is there work for each message or channel, so
it is done for all at once, as it is in `columns`, where messages are taken apart again; everything
else in a file is left to mcap's own record classes.
"""

import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from mcap.opcode import Opcode
from numpy.typing import NDArray

from nrs_cosim.recordings.mcap.columns import HEAD, Bytes, Columns, put_rows, windows
from nrs_cosim.recordings.mcap.container import (
    LIMIT,
    RECORD,
    Compression,
    DamageError,
    demand,
    in_proportion,
)

_CHUNK = struct.Struct("<BQQQQII")  # opcode, length, start, end (ns), size, CRC, len(compression)
INDEX = np.dtype([("kind", "u1"), ("length", "<u8"), ("channel", "<u2"), ("size", "<u4")])
OFFSET = np.dtype([("channel", "<u2"), ("at", "<u8")])
_LENGTHS = struct.Struct("<QQQQI")  # start, end, offset and length of the chunk, size of OFFSETs
_REST = struct.Struct("<QI")  # length of the message indexes, len(compression)
_SIZE = struct.Struct("<Q")  # compressed
_SIZES = struct.Struct("<QQ")  # compressed, uncompressed
_ENTRY = np.dtype([("time", "<u8"), ("at", "<u8")])
INDEXED = _ENTRY.itemsize
"""Bytes that a message takes in a file at least: its place in an index, which is not compressed."""
_ZSTD = 2
"""The level: the next takes two thirds longer for a fortieth less, the one below adds a sixth."""
_COMPRESS: Mapping[Compression, Callable[..., bytes]] = {
    "zstd": partial(zstandard.compress, level=_ZSTD),
    "lz4": lz4.frame.compress,
    "none": bytes,
}


@dataclass(frozen=True, slots=True, eq=False)
class ChunkRecords:
    """Messages, at least one, as they stand in a chunk, and the indexes that stand behind it."""

    data: Bytes
    index: Bytes
    """The message indexes, one after the other, in the order of the channels' first messages."""
    offsets: NDArray[np.void]
    """(channels,) of OFFSET: where each of these begins, from the first on."""
    start: int
    """ns: log_time of the first message."""
    end: int
    """ns: of the last."""


def packed(messages: Columns) -> ChunkRecords:
    """The messages, at least one, in their order, as records."""
    heads = np.empty(len(messages.channel), HEAD)
    sizes = messages.stop - messages.start
    heads["kind"] = Opcode.MESSAGE
    heads["length"] = HEAD.itemsize - 9 + sizes
    heads["channel"], heads["sequence"] = messages.channel, messages.sequence
    heads["time"] = heads["published"] = messages.time
    stops = np.cumsum(HEAD.itemsize + sizes)
    starts = stops - sizes
    data = np.empty(int(stops[-1]), np.uint8).data
    windows(data, HEAD.itemsize)[starts - HEAD.itemsize] = heads.view(f"V{HEAD.itemsize}")
    put_rows(data, starts, messages.data, messages.start, sizes)
    records = Columns(data, messages.channel, messages.sequence, messages.time, starts, stops)
    return ChunkRecords(data, *_index(records), int(messages.time[0]), int(messages.time[-1]))


def encoded_chunk(offset: int, made: ChunkRecords, compression: Compression) -> tuple[bytes, bytes]:
    """A chunk of records that will stand at `offset`, with its message indexes; its record for the
    summary.
    """
    records, start, end = made.data, made.start, made.end
    data = _COMPRESS[compression](records)
    if not in_proportion(len(records), len(data)):
        compression = "lz4"  # which makes at most 255 bytes one
        data = _COMPRESS[compression](records)
    name = b"" if compression == "none" else compression.encode()
    size = _CHUNK.size + len(name) + _SIZE.size + len(data)
    fixed = start, end, len(records), zlib.crc32(records), len(name)
    head = _CHUNK.pack(Opcode.CHUNK, size - RECORD.size, *fixed) + name + _SIZE.pack(len(data))
    offsets = made.offsets.copy()
    offsets["at"] += offset + size
    lengths = _LENGTHS.pack(start, end, offset, size, offsets.nbytes)
    rest = _REST.pack(len(made.index), len(name)) + name + _SIZES.pack(len(data), len(records))
    body = b"".join([lengths, offsets.tobytes(), rest])
    summary = RECORD.pack(Opcode.CHUNK_INDEX, len(body)) + body
    return b"".join([head, data, made.index]), summary


def _index(messages: Columns) -> tuple[memoryview, NDArray[np.void]]:
    """The message indexes of records, and where each begins; see `ChunkRecords`."""
    channels, first, which = np.unique(messages.channel, return_index=True, return_inverse=True)
    by_first = np.argsort(first)
    place = np.empty(len(channels), np.uint16)
    place[by_first] = np.arange(len(channels))
    order = np.argsort(place[which], kind="stable")
    counts = np.bincount(place[which], minlength=len(channels))
    heads = np.empty(len(channels), INDEX)
    heads["kind"], heads["channel"] = Opcode.MESSAGE_INDEX, channels[by_first]
    heads["size"] = _ENTRY.itemsize * counts
    heads["length"] = heads["size"] + 6
    entries = np.empty(len(order), _ENTRY)
    entries["time"], entries["at"] = messages.time[order], messages.start[order] - HEAD.itemsize
    lengths = INDEX.itemsize + _ENTRY.itemsize * counts
    begins = np.cumsum(lengths) - lengths
    index = np.empty(int(lengths.sum()), np.uint8).data
    windows(index, INDEX.itemsize)[begins] = heads.view(f"V{INDEX.itemsize}")
    rest = INDEX.itemsize * np.repeat(np.arange(1, len(channels) + 1), counts)
    at = rest + _ENTRY.itemsize * np.arange(len(order))
    windows(index, _ENTRY.itemsize)[at] = entries.view(f"V{_ENTRY.itemsize}")
    offsets = np.empty(len(channels), OFFSET)
    offsets["channel"], offsets["at"] = heads["channel"], begins
    return index, offsets


def decoded_chunk(chunk: bytes) -> bytes:
    """The records of a chunk as it stands in the file, checked; DamageError when they cannot be."""
    demand(len(chunk) >= _CHUNK.size and chunk[0] == Opcode.CHUNK, "there is no chunk")
    _, length, _, _, size, crc, n = _CHUNK.unpack_from(chunk)
    demand(length == len(chunk) - RECORD.size and size <= LIMIT, "its size is not as declared")
    decompress = _DECOMPRESS.get(chunk[_CHUNK.size : _CHUNK.size + n])
    if decompress is None:
        raise DamageError("its compression is unknown")
    data = memoryview(chunk)[_CHUNK.size + n + 8 :]
    demand(
        in_proportion(size, len(data)),
        f"it is refused, for its {len(data)} bytes decompress to {size}",
    )
    try:
        records = decompress(data, size)
    except (zstandard.ZstdError, RuntimeError) as error:
        raise DamageError(f"it does not decompress ({error})") from error
    demand(len(records) == size and zlib.crc32(records) == crc, "its checksum differs")
    return records


def _unzstd(data: memoryview, size: int) -> bytes:
    demand(zstandard.frame_content_size(data) == size, "its size differs")
    return zstandard.decompress(data)


def _unlz4(data: memoryview, size: int) -> bytes:
    return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size))


_DECOMPRESS: Mapping[bytes, Callable[[memoryview, int], bytes]] = {
    b"zstd": _unzstd,
    b"lz4": _unlz4,
    b"": lambda data, _: bytes(data),
}
