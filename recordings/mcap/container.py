"""The container: one MCAP file, sealed at both ends.

    magic, Header (profile "nrs"), Schemas, Channels, Metadata, Attachments    the head
    Metadata "nrs.begin"    SHA-256 over every byte before it
    Chunk, its MessageIndexes, Chunk, ...    whole ticks, each chunk with its CRC
    Metadata "nrs.end"    status, reason, digest, ticks, messages, SHA-256 over these
    DataEnd    CRC over every byte before it
    the summary section, Footer (CRC over the summary), magic

MCAP itself protects neither names, nor channels, nor metadata; the two seals do. The head is on the
disk before the first tick, so that a file cut at any later point still says what it is. Nothing but
chunks and their indexes stands between "nrs.begin" and "nrs.end".
"""

import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from struct import Struct
from typing import Literal

from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

PROFILE = "nrs"
MAGIC = b"\x89MCAP0\r\n"
BEGIN, END = "nrs.begin", "nrs.end"
END_FIELDS = frozenset({"status", "reason", "digest", "ticks", "messages", "sha256"})
PART = "part_of"
"""Is said at the end of what was recovered of a run: the digest of all of it, empty if unknown."""
LIMIT = 2**30
"""No chunk, decompressed or not, and no record of the head is longer: 1 GiB."""
MOST_ATTACHED = LIMIT - 2**16
"""Bytes of an attachment, beside which its record has a name."""
FREE = 2**23
"""Whatever decompresses to so much is read: twice the largest chunk that mcap's tools write."""
RATIO = 256
"""Beyond that, so many times what stands in the file. LZ4 never comes to it, and runs do not."""

MOST_CHANNELS = 2**16 - 1
"""MCAP numbers them by u16, and 0 is none."""

RECORD = Struct("<BQ")
"""How every record begins: opcode, length of what follows."""
FOOTER = Struct("<BQQQ")
"""A Footer up to its CRC: opcode, length, start of the summary, start of its offsets."""
CRC = Struct("<I")

Message = tuple[int, str, int, bytes]
"""(log_time in integer ns, topic, sequence, data): `sorted` gives the total order."""

Compression = Literal["zstd", "lz4", "none"]
Closing = Literal["completed", "failed", "interrupted"]
Status = Closing | Literal["unfinished"]


class DamageError(Exception):
    """Why a stretch of a file cannot be read: caught where it is known what is lost by it."""


def demand(holds: bool, otherwise: str) -> None:
    """Raise DamageError when what a sound file has does not hold."""
    if not holds:
        raise DamageError(otherwise)


def in_proportion(size: int, stored: int) -> bool:
    """Return whether `stored` bytes of a file may stand for `size` in memory."""
    return size <= max(FREE, RATIO * stored)


@dataclass(frozen=True, slots=True)
class Schema:
    """The protobuf type `name`, in full, and the serialized FileDescriptorSet that defines it."""

    name: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic, the name of its schema, and whether its messages enter the digest."""

    topic: str
    schema_name: str
    counted: bool = True
    metadata: Mapping[str, str] = field(default_factory=dict)
    """What readers are shown of it beside that: joints' names, units."""


def encoded(*records: mcap.McapRecord) -> bytes:
    """The records as they stand in the file, one after the other."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def begin_record(seal: str) -> bytes:
    """The record that ends the head, whose bytes so far have the SHA-256 `seal`."""
    return encoded(mcap.Metadata(BEGIN, {"sha256": seal}))


def end_record(fields: Mapping[str, str]) -> bytes:
    """The record that says how the run ended, sealed by the SHA-256 of itself without its seal."""
    seal = sha256(encoded(mcap.Metadata(END, dict(fields)))).hexdigest()
    return encoded(mcap.Metadata(END, {**fields, "sha256": seal}))


def head(
    version: str,
    channels: Sequence[Channel],
    schemas: Iterable[Schema],
    metadata: Mapping[str, Mapping[str, str]],
    attachments: Mapping[str, tuple[str, bytes]],
) -> tuple[bytes, list[mcap.McapRecord]]:
    """The bytes of a file up to its first chunk, and what of it the summary repeats or indexes.

    Channel i (from 0) has the number i + 1. Raises ValueError when two channels share a topic, a
    channel's schema is missing, a metadata name is the container's own, or a record is too long.
    """
    numbered = {schema.name: (number, schema) for number, schema in enumerate(schemas, 1)}
    if len({channel.topic for channel in channels}) < len(channels):
        raise ValueError("two channels share a topic")
    if missing := {channel.schema_name for channel in channels} - numbered.keys():
        raise ValueError(f"no schema of the name {', '.join(sorted(missing))}")
    if taken := {BEGIN, END} & metadata.keys():
        raise ValueError(f"metadata {', '.join(sorted(taken))}: the container's own name")
    records: list[mcap.McapRecord] = [
        mcap.Schema(number, schema.data, "protobuf", schema.name)
        for number, schema in numbered.values()
    ]
    for number, channel in enumerate(channels, 1):
        counted = {**channel.metadata, "counted": "true" if channel.counted else "false"}
        schema_id, _ = numbered[channel.schema_name]
        records.append(mcap.Channel(number, channel.topic, "protobuf", counted, schema_id))
    summary = list(records)
    records += [mcap.Metadata(name, dict(fields)) for name, fields in metadata.items()]
    records += [mcap.Attachment(0, 0, name, *content) for name, content in attachments.items()]

    parts = [MAGIC + encoded(mcap.Header(PROFILE, f"nrs-cosim {version}"))]
    at = len(parts[0])
    for record in records:
        parts.append(encoded(record))
        length = len(parts[-1])
        if length > LIMIT:
            raise ValueError(f"a {type(record).__name__} of {length} bytes exceeds {LIMIT}")
        if isinstance(record, mcap.Metadata):
            summary.append(mcap.MetadataIndex(at, length, record.name))
        elif isinstance(record, mcap.Attachment):
            kind, size = record.media_type, len(record.data)
            summary.append(mcap.AttachmentIndex(at, length, 0, 0, size, record.name, kind))
        at += length
    data = b"".join(parts)
    begin = begin_record(sha256(data).hexdigest())
    return data + begin, [*summary, mcap.MetadataIndex(at, len(begin), BEGIN)]


def tail(
    *,
    offset: int,
    crc: int,
    fields: Mapping[str, str],
    summary: Sequence[mcap.McapRecord],
    statistics: mcap.Statistics,
    chunk_indexes: Iterable[bytes],
) -> bytes:
    """The bytes of a file after its last chunk, which ends at `offset`; `crc` covers all so far.

    `fields` are those of "nrs.end", `summary` comes from `head`, and `statistics` know the
    messages and the chunks; what else they count is taken from the summary.
    """
    end = end_record(fields)
    return end + closing(
        offset=offset + len(end),
        crc=zlib.crc32(end, crc),
        summary=[*summary, mcap.MetadataIndex(offset, len(end), END)],
        statistics=statistics,
        chunk_indexes=chunk_indexes,
    )


def closing(
    *,
    offset: int,
    crc: int,
    summary: Sequence[mcap.McapRecord],
    statistics: mcap.Statistics,
    chunk_indexes: Iterable[bytes],
) -> bytes:
    """The bytes of any MCAP file after its data, which end at `offset` with a checksum `crc`."""
    data_end = encoded(mcap.DataEnd(crc))
    kinds: dict[type[mcap.McapRecord], list[mcap.McapRecord]] = {
        kind: [record for record in summary if isinstance(record, kind)]
        for kind in (mcap.Schema, mcap.Channel, mcap.AttachmentIndex, mcap.MetadataIndex)
    }
    statistics = replace(
        statistics,
        schema_count=len(kinds[mcap.Schema]),
        channel_count=len(kinds[mcap.Channel]),
        attachment_count=len(kinds[mcap.AttachmentIndex]),
        metadata_count=len(kinds[mcap.MetadataIndex]),
    )
    groups = {
        Opcode.SCHEMA: encoded(*kinds[mcap.Schema]),
        Opcode.CHANNEL: encoded(*kinds[mcap.Channel]),
        Opcode.STATISTICS: encoded(statistics),
        Opcode.CHUNK_INDEX: b"".join(chunk_indexes),
        Opcode.ATTACHMENT_INDEX: encoded(*kinds[mcap.AttachmentIndex]),
        Opcode.METADATA_INDEX: encoded(*kinds[mcap.MetadataIndex]),
    }
    summary_start = at = offset + len(data_end)
    offsets = []
    for opcode, group in groups.items():
        if group:
            offsets.append(mcap.SummaryOffset(opcode, at, len(group)))
        at += len(group)
    section = b"".join([*groups.values(), encoded(*offsets)])
    footer = FOOTER.pack(Opcode.FOOTER, 20, summary_start, at)
    summary_crc = CRC.pack(zlib.crc32(footer, zlib.crc32(section)))
    return b"".join([data_end, section, footer, summary_crc, MAGIC])
