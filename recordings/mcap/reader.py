"""Reading a recording: whole, never closed, cut or damaged.

The law: what cannot be vouched for is not shown, and what is not shown is named. The head must
carry its own seal, for it gives the messages their topics. A file whose checksums agree is taken
as it stands, which costs one pass over its bytes. In any other file each chunk is judged by
itself, and `damage` says what is missing. So all is known when a recording is open. No more than
a chunk at a time is in memory.
"""

from collections.abc import Callable, Collection, Iterable, Iterator
from hashlib import sha256
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import Self

import numpy as np
from mcap import records as mcap
from mcap.opcode import Opcode
from numpy.typing import NDArray

from nrs_cosim.bus.text import quoted
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.chunk import INDEXED, decoded_chunk
from nrs_cosim.recordings.mcap.columns import Columns, columns
from nrs_cosim.recordings.mcap.container import (
    BEGIN,
    END,
    MAGIC,
    PART,
    PROFILE,
    Channel,
    DamageError,
    Message,
    Schema,
    Status,
    begin_record,
    demand,
    end_record,
)
from nrs_cosim.recordings.mcap.contents import Contents
from nrs_cosim.recordings.mcap.digest import Digest, digest_differs
from nrs_cosim.recordings.mcap.layout import RecordFile, Span, find, parsed
from nrs_cosim.recordings.mcap.ordering import order, ranks
from nrs_cosim.recordings.metadata import About, EndRecord, parse, read_about

_UNFINISHED = "never closed: its writer was killed, or is still at work"


class Reader:
    """The recording at `path`, checked as it opens; a context manager.

    `watch` is told what part of the file has been read, chunk by chunk, in each pass through it.
    With `verify` the digest of an intact file is computed again from its messages, and a
    difference from the recorded one is a damage.

    Raises UnreadableError when there is no such file, when it is not a recording, or when its head
    is cut or damaged.
    """

    path: str | PathLike[str]
    library: str
    """What wrote it: "nrs-cosim" and a version."""
    schemas: tuple[Schema, ...]
    topics: dict[int, str]
    """Of each channel, by its number in the file."""
    channels: tuple[Channel, ...]
    metadata: dict[str, dict[str, str]]
    attachments: dict[str, tuple[str, bytes]]
    """Name to media type and content."""
    about: About | None
    """What is said of the run; None in a file that holds none."""
    end: dict[str, str]
    """All that was said at the end, with the `extra` of `Writer.finish`; empty when unfinished."""
    ending: EndRecord | None
    """The same, read; None when unfinished."""
    status: Status
    reason: str
    digest_here: str
    """That of the messages that are here."""
    computed: bool
    """Whether that was computed from them, or is what stands at the end of an intact file."""
    ticks: int
    """How many ticks after tick 0 are here; each is whole."""
    message_count: int
    damage: list[str]
    """What is missing or wrong, in words; empty when nothing is."""

    def __init__(
        self,
        path: str | PathLike[str],
        *,
        verify: bool = False,
        watch: Callable[[float], None] = lambda _part: None,
    ) -> None:
        self.path = path
        self._watch = watch
        self.damage = []
        self._like: NDArray[np.int64] | None = None
        self._contents: Contents | None = None
        try:
            self._file = Path(path).open("rb")  # noqa: SIM115 (closed by close)
        except OSError as error:
            raise UnreadableError(f"{path}: cannot be read: {error.strerror or error}") from error
        try:
            self._records = RecordFile(self._file)
            self._read_rest(self._read_head(), verify)
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise UnreadableError(
                    f"{path}: cannot be read: {error.strerror or error}"
                ) from error
            raise

    def batches(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[list[Message]]:
        """The messages in total order, a chunk at a time: on all topics or only `topics`, with
        start_ns <= log_time < end_ns.

        Raises UnreadableError when a chunk is no longer what it was at opening.
        """
        for found in self.columns(topics, start_ns, end_ns):
            yield found.messages(self.topics)

    def columns(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[Columns]:
        """The same messages as columns; only chunks that overlap with the range are read."""
        if self.is_closed:
            raise UnreadableError(f"{self.path}: is closed here; open it again")
        asked = None if topics is None else {*topics}
        wanted = [n for n, topic in self.topics.items() if asked is None or topic in asked]
        start = 0 if start_ns is None else start_ns
        end = 2**64 if end_ns is None else end_ns
        for span in self._chunks if wanted else ():
            if span.end < start or span.start >= end:
                continue
            try:
                found = self._columns(span)
            except (DamageError, OSError) as error:
                raise UnreadableError(
                    f"{self.path}: chunk at byte {span.offset}: {error}"
                ) from error
            if asked is not None:
                found = found.on(wanted)
            if span.start < start or span.end >= end:
                found = found.within(start, end)
            if len(found.time):
                yield found
            self._passed(span)

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[Message]:
        """The same messages, one at a time."""
        return chain.from_iterable(self.batches(topics, start_ns, end_ns))

    @property
    def digest(self) -> str | None:
        """That of the run; None where messages of it are missing, or may be."""
        end = self.ending
        whole = end and (end.messages, end.digest) == (self.message_count, self.digest_here)
        return self.digest_here if whole and PART not in self.end else None

    def expect_ticks(self, purpose: str) -> None:
        """Raise `UnreadableError` for a recording in which no tick is left."""
        if not self.message_count:
            why = "; ".join(self.damage) or self.reason
            raise UnreadableError(
                f"{self.path}: holds no tick, so that there is nothing to {purpose}: {why}"
            )

    @property
    def start_ns(self) -> int | None:
        """The log time of the first message, None if there is none."""
        return self._chunks[0].start if self._chunks else None

    @property
    def end_ns(self) -> int | None:
        """The log time of the last message, None if there is none."""
        return self._chunks[-1].end if self._chunks else None

    @property
    def is_closed(self) -> bool:
        """Whether the file is."""
        return self._file.closed

    def close(self) -> None:
        """Close the file; what is known of it stays."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read_head(self) -> int:
        """Read all that stands before the first chunk; the offset (bytes) of that."""
        magic = self._records.read(0, len(MAGIC))
        if magic != MAGIC:
            if Path(self.path).suffix.lower() == ".toml":
                raise UnreadableError(
                    f"{self.path}: is a scenario (TOML), not a recording; `nrs check` reads "
                    f"scenarios"
                )
            found = "is no MCAP file" if magic else "is empty"
            raise UnreadableError(f"{self.path}: {found}; give a recording of a run")
        seal = sha256(magic)
        records: list[tuple[int, bytes]] = []
        try:
            for kind, span in self._records.walk(len(MAGIC), self._records.size):
                record = self._records.read(span.offset, span.length)
                if not records:
                    self._read_header(kind, record)
                elif kind == Opcode.METADATA and record[13:].startswith(BEGIN.encode()):
                    demand(record == begin_record(seal.hexdigest()), "it is not as written")
                    self._sort_head(records)
                    return span.offset + span.length
                demand(kind != Opcode.CHUNK, "its seal is missing")
                seal.update(record)
                records.append((kind, record))
            raise DamageError("its seal is missing")  # noqa: TRY301
        except (DamageError, KeyError) as damage:
            raise UnreadableError(
                f"{self.path}: the head is cut or damaged: {damage}; without it no message can be "
                "trusted. Use another copy, or run the scenario again"
            ) from damage

    def _read_header(self, kind: int, record: bytes) -> None:
        demand(kind == Opcode.HEADER, "there is no header")
        header = parsed(mcap.Header.read, record)
        if header.profile != PROFILE:
            profile = f"profile {quoted(header.profile)}" if header.profile else "no profile"
            raise UnreadableError(
                f"{self.path}: is an MCAP file of {profile}, written by "
                f"{quoted(header.library)}; give a "
                f"recording of a run, which has profile {PROFILE!r}"
            )
        self.library = header.library

    def _sort_head(self, records: Iterable[tuple[int, bytes]]) -> None:
        self.metadata, self.attachments = {}, {}
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        alike: dict[tuple[tuple[str, str], ...], dict[str, str]] = {}  # thousands say the same
        for kind, record in records:
            if kind == Opcode.SCHEMA:
                schema = parsed(mcap.Schema.read, record)
                schemas[schema.id] = Schema(schema.name, schema.data)
            elif kind == Opcode.CHANNEL:
                channel = parsed(mcap.Channel.read, record)
                metadata = dict(channel.metadata)
                counted = metadata.pop("counted") == "true"
                metadata = alike.setdefault(tuple(metadata.items()), metadata)
                name = schemas[channel.schema_id].name
                channels[channel.id] = Channel(channel.topic, name, counted, metadata)
            elif kind == Opcode.METADATA:
                record_of = parsed(mcap.Metadata.read, record)
                self.metadata[record_of.name] = record_of.metadata
            elif kind == Opcode.ATTACHMENT:
                attachment = parsed(mcap.Attachment.read, record)
                self.attachments[attachment.name] = (attachment.media_type, attachment.data)
        self.schemas, self.channels = tuple(schemas.values()), tuple(channels.values())
        self.topics = {number: channel.topic for number, channel in channels.items()}
        counted = [channel.topic for channel in self.channels if channel.counted]
        self.about = read_about(self.path, self.metadata, self.attachments, counted)
        if self.about:
            self._contents = Contents(self.topics, self.about.run.robots)

    def _read_rest(self, after_head: int, verify: bool) -> None:
        """Read the end, and judge the chunks unless the checksums vouch for them."""
        layout = find(self._records, after_head)
        self.damage += layout.damage
        self._chunks = layout.chunks
        self.end = self._read_end(layout.end) if layout.end else {}
        self.ending = parse(self.path, END, EndRecord, self.end) if self.end else None
        self.computed = verify or not (layout.intact and self.ending)
        if self.ending and not self.computed:
            self.message_count, self.ticks = self.ending.messages, self.ending.ticks
            least, most = len(self._chunks), self._records.size // INDEXED
            if not least <= self.message_count <= most or self.ticks > self.message_count:
                raise UnreadableError(
                    f"{self.path}: {END}: messages: is {self.message_count} in {self.ticks} ticks, "
                    f"but {least} chunks have one each at least, a tick has one, and the file has "
                    f"room for {most}"
                )
            computed = self.ending.digest
        else:
            computed, gaps = self._judge()
            self.damage += gaps if self.damage or not layout.intact else []
        self.digest_here = computed
        self.status, self.reason = "unfinished", _UNFINISHED
        if not (ending := self.ending):
            return
        self.status, self.reason = ending.status, ending.reason
        if layout.intact and not self.damage and self.ticks != ending.ticks:
            raise UnreadableError(
                f"{self.path}: {END}: ticks: is {ending.ticks}, but there are {self.ticks}"
            )
        if self.message_count != ending.messages:
            self.damage.append(
                f"{self.message_count} of {ending.messages} messages are here; whole, the "
                f"recording has the digest {ending.digest}"
            )
        elif computed != ending.digest:
            self.damage.append(digest_differs(ending.digest))
        elif not layout.intact:
            self.damage.append("a checksum differs or is missing, yet every message is as written")

    def _read_end(self, span: Span) -> dict[str, str]:
        """What "nrs.end" says, nothing if it is not as written."""
        try:
            record = self._records.read(span.offset, span.length)
            fields = dict(parsed(mcap.Metadata.read, record).metadata)
            fields.pop("sha256", None)
            demand(record == end_record(fields), "it is not as written")
        except DamageError as damage:
            self.damage.append(f"the record of how the run ended is damaged: {damage}")
            return {}
        return fields

    def _judge(self) -> tuple[str, list[str]]:
        """Keep the chunks that are whole and in order, count what they hold; its digest, and which
        ticks are missing. A recovered recording lacks some though it is as it was written.
        """
        counted = {c.topic for c in self.channels if c.counted}
        digest = Digest({n: topic for n, topic in self.topics.items() if topic in counted})
        rank = ranks(self.topics)
        chunks, self._chunks = self._chunks, []
        self.message_count = self.ticks = 0
        last, k = (-1, -1), 0
        gaps: list[str] = []
        for span in chunks:
            try:
                messages = self._columns(span)
                begin, end = (
                    (int(messages.time[row]), int(rank[messages.channel[row]])) for row in (0, -1)
                )
                ordered = last < begin and (np.diff(order(messages, rank)) == 1).all()
                demand(bool(ordered), "its messages are out of order")
            except DamageError as damage:
                self.damage.append(
                    f"chunk at byte {span.offset}: {damage}; {span.length} bytes skipped"
                )
                continue
            self._passed(span)
            here = np.unique(messages.sequence)
            gaps += _gap(k, int(here[0]) - 1)
            k = int(here[-1])
            digest.update(messages)
            self.message_count += len(messages.channel)
            self.ticks += int(np.count_nonzero(here))
            last = end
            self._chunks.append(Span(span.offset, span.length, begin[0], end[0]))
        gaps += _gap(k, self.ending.ticks if self.ending else k)
        return digest.hexdigest(), gaps

    def _passed(self, span: Span) -> None:
        self._watch(min((span.offset + span.length) / self._records.size, 1.0))

    def _columns(self, span: Span) -> Columns:
        records = decoded_chunk(self._records.read(span.offset, span.length))
        found = columns(records, self.topics, self._like)
        self._like = found.start
        if self._contents:
            self._contents.expect(found)
        return found


def _gap(last: int, until: int) -> list[str]:
    """Say which ticks after the last one that was found are missing, if any."""
    if until > last + 1:
        return [f"ticks {last + 1} to {until} are missing"]
    return [f"tick {until} is missing"] if until > last else []
