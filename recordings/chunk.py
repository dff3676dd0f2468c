"""A chunk: the messages of whole ticks in total order, compressed, under one CRC.

    Chunk    start, end, size, CRC of the records, compression, the records
    MessageIndex    for each channel in it: (log_time, offset among the records) of its messages

Its records are messages and nothing else. Here alone is there work for each message or channel, so
it is done for all at once, as it is in `columns`, where messages are taken apart again; everything
else in a file is left to mcap's own record classes.
"""

import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from itertools import chain, pairwise

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from mcap import records as mcap
from mcap.opcode import Opcode
from numpy.typing import NDArray

from recordings.columns import HEAD, Columns
from recordings.container import LIMIT, RECORD, Compression, DamageError, demand, encoded
from recordings.digest import Message

_CHUNK = struct.Struct("<BQQQQII")  # opcode, length, start, end (ns), size, CRC, len(compression)
_INDEX = np.dtype([("kind", "u1"), ("length", "<u8"), ("channel", "<u2"), ("size", "<u4")])
_OFFSET = np.dtype([("channel", "<u2"), ("at", "<u8")])
_LENGTHS = struct.Struct("<QQQQI")  # start, end, offset and length of the chunk, size of _OFFSETs
_REST = struct.Struct("<QI")  # length of the message indexes, len(compression)
_SIZES = struct.Struct("<QQ")  # compressed, uncompressed
_ENTRY = 16  # bytes of a log_time and an offset
_COMPRESS: Mapping[Compression, Callable[[bytes], bytes]] = {
    "zstd": zstandard.compress,
    "lz4": lz4.frame.compress,
    "none": bytes,
}


def packed(messages: Sequence[Message], numbers: Mapping[str, int]) -> Columns:
    """The messages, at least one, as records; `numbers` gives each topic's channel."""
    times, topics, sequences, data = zip(*messages, strict=True)
    heads = np.empty(len(messages), HEAD)
    lengths = np.fromiter(map(len, data), np.int64, len(data))
    heads["kind"] = Opcode.MESSAGE
    heads["length"] = HEAD.itemsize - 9 + lengths
    heads["channel"] = [numbers[topic] for topic in topics]
    heads["sequence"] = sequences
    heads["time"] = np.array(times, np.uint64)
    heads["published"] = heads["time"]
    pairs = zip(heads.view(f"V{HEAD.itemsize}").tolist(), data, strict=True)
    stops = np.cumsum(HEAD.itemsize + lengths)
    return Columns(
        b"".join(chain.from_iterable(pairs)),
        heads["channel"],
        heads["sequence"],
        heads["time"],
        stops - lengths,
        stops,
    )


def closed(
    offset: int, messages: Columns, compression: Compression
) -> tuple[bytes, bytes, dict[int, int]]:
    """A chunk that will stand at `offset`, with its message indexes; its record for the summary;
    how many messages each channel has in it.
    """
    records = messages.data
    name = "" if compression == "none" else compression
    data = _COMPRESS[compression](records)
    start, end = int(messages.time[0]), int(messages.time[-1])
    chunk = encoded(mcap.Chunk(name, data, end, start, zlib.crc32(records), len(records)))
    channels, entries = _by_channel(messages)
    heads = np.zeros(len(channels), _INDEX)
    heads["kind"], heads["channel"] = Opcode.MESSAGE_INDEX, channels
    sizes = heads["size"] = np.array([len(those) for those in entries])
    heads["length"] = sizes + 6
    offsets = np.empty(len(channels), _OFFSET)
    ends = offset + len(chunk) + np.cumsum(_INDEX.itemsize + sizes)
    offsets["channel"], offsets["at"] = channels, ends - _INDEX.itemsize - sizes
    pairs = zip(heads.view(f"V{_INDEX.itemsize}").tolist(), entries, strict=True)
    index = b"".join(chain.from_iterable(pairs))
    lengths = _LENGTHS.pack(start, end, offset, len(chunk), offsets.nbytes)
    rest = _REST.pack(len(index), len(name)) + name.encode() + _SIZES.pack(len(data), len(records))
    body = b"".join([lengths, offsets.tobytes(), rest])
    summary = RECORD.pack(Opcode.CHUNK_INDEX, len(body)) + body
    counts = dict(zip(channels.tolist(), (sizes // _ENTRY).tolist(), strict=True))
    return chunk + index, summary, counts


def _by_channel(messages: Columns) -> tuple[NDArray[np.uint16], list[bytes]]:
    """The channels in the order of their first messages; (log_time, offset) of all of each."""
    order = np.argsort(messages.channel, kind="stable")
    grouped = messages.channel[order]
    starts = np.flatnonzero(np.concatenate([[True], grouped[1:] != grouped[:-1]]))
    offsets = (messages.start - HEAD.itemsize).astype(np.uint64)
    flat = np.stack([messages.time, offsets], axis=1)[order].tobytes()
    bounds = (_ENTRY * np.append(starts, len(order))).tolist()
    parts = [flat[start:stop] for start, stop in pairwise(bounds)]
    first = np.argsort(order[starts])
    return grouped[starts][first], [parts[i] for i in first.tolist()]


def opened(chunk: bytes) -> bytes:
    """The records of a chunk as it stands in the file, checked; DamageError when they cannot be."""
    demand(len(chunk) >= _CHUNK.size and chunk[0] == Opcode.CHUNK, "there is no chunk")
    _, length, _, _, size, crc, n = _CHUNK.unpack_from(chunk)
    demand(length == len(chunk) - RECORD.size and size <= LIMIT, "its size is not what it says")
    decompress = _DECOMPRESS.get(chunk[_CHUNK.size : _CHUNK.size + n])
    if decompress is None:
        raise DamageError("its compression is unknown")
    try:
        records = decompress(chunk[_CHUNK.size + n + 8 :], size)
    except (zstandard.ZstdError, RuntimeError) as error:
        raise DamageError(f"it does not decompress ({error})") from error
    demand(len(records) == size and zlib.crc32(records) == crc, "its checksum differs")
    return records


def _unzstd(data: bytes, size: int) -> bytes:
    demand(zstandard.frame_content_size(data) == size, "its size differs")
    return zstandard.decompress(data)


def _unlz4(data: bytes, size: int) -> bytes:
    return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size))


_DECOMPRESS: Mapping[bytes, Callable[[bytes, int], bytes]] = {
    b"zstd": _unzstd,
    b"lz4": _unlz4,
    b"": lambda data, _: data,
}
