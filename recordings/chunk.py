"""A chunk: the messages of whole ticks in total order, compressed, under one CRC.

    Chunk    start, end, size, CRC of the records, compression, the records
    MessageIndex    for each channel in it: (log_time, offset among the records) of its messages

Its records are messages and nothing else. Here alone is work done per message, so the records are
packed by hand here and taken apart by hand in `columns`; everything else in a file is left to
mcap's own record classes.
"""

import struct
import zlib
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap import records as mcap
from mcap.opcode import Opcode

from recordings.container import LIMIT, RECORD, Compression, DamageError, demand, encoded
from recordings.digest import Message

_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log and publish time (ns)
_CHUNK = struct.Struct("<BQQQQII")  # opcode, length, start, end (ns), size, CRC, len(compression)
_KIND = Opcode.MESSAGE.value
_COMPRESS: Mapping[Compression, Callable[[bytes], bytes]] = {
    "zstd": zstandard.compress,
    "lz4": lz4.frame.compress,
    "none": bytes,
}


def packed(messages: Sequence[Message], numbers: Mapping[str, int]) -> bytes:
    """The messages as records; `numbers` gives each topic's channel.

    Raises KeyError for a topic without one, struct.error for a number out of range.
    """
    pack = _MESSAGE.pack
    return b"".join(
        [
            part
            for time, topic, sequence, data in messages
            for part in (
                pack(_KIND, 22 + len(data), numbers[topic], sequence, time, time),
                data,
            )
        ]
    )


def closed(
    offset: int,
    messages: Sequence[Message],
    records: bytes,
    numbers: Mapping[str, int],
    compression: Compression,
) -> tuple[bytes, bytes, dict[int, int]]:
    """A chunk that will stand at `offset`, with its message indexes; its record for the summary;
    how many messages each channel has in it.
    """
    entries: defaultdict[int, list[int]] = defaultdict(list)
    at = 0
    for time, topic, _, data in messages:
        entries[numbers[topic]] += (time, at)
        at += _MESSAGE.size + len(data)
    indexes = [
        struct.pack(f"<BQHI{n}Q", Opcode.MESSAGE_INDEX, 6 + 8 * n, channel, 8 * n, *flat)
        for channel, flat in entries.items()
        for n in (len(flat),)
    ]
    name = "" if compression == "none" else compression
    data = _COMPRESS[compression](records)
    start, end = messages[0][0], messages[-1][0]
    chunk = encoded(mcap.Chunk(name, data, end, start, zlib.crc32(records), len(records)))
    offsets: dict[int, int] = {}
    after = offset + len(chunk)
    for channel, index in zip(entries, indexes, strict=True):
        offsets[channel] = after
        after += len(index)
    summary = mcap.ChunkIndex(
        chunk_length=len(chunk),
        chunk_start_offset=offset,
        compression=name,
        compressed_size=len(data),
        message_end_time=end,
        message_index_length=after - offset - len(chunk),
        message_index_offsets=offsets,
        message_start_time=start,
        uncompressed_size=len(records),
    )
    counts = {channel: len(flat) // 2 for channel, flat in entries.items()}
    return b"".join([chunk, *indexes]), encoded(summary), counts


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
