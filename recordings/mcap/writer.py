"""Writing a recording: ticks in, chunks out.

The law: a tick is written whole or not at all, in total order, and never before an earlier one. A
chunk closes at the end of a tick, when it is large or old enough; only then does it reach the
file, in one piece. Where chunks close changes neither the digest nor a message. All that the file
holds is one value, replaced at once when a chunk is on the disk: no interruption tears it, and a
chunk that the disk refuses is taken back.

Chunks are made and written by a thread of the writer's, while the next one fills; that one closes
only when its predecessor is in the file.
"""

import json
import time
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Self, get_args

import numpy as np
from mcap import records as mcap
from numpy.typing import NDArray

from nrs_cosim.bus.errors import Cause, RunError
from nrs_cosim.bus.text import quoted, storable
from nrs_cosim.recordings.errors import UncreatableError, UnwritableError
from nrs_cosim.recordings.mcap.arrangement import Arranging, by_numpy
from nrs_cosim.recordings.mcap.chunk import encoded_chunk
from nrs_cosim.recordings.mcap.columns import HEAD, Columns
from nrs_cosim.recordings.mcap.container import (
    END_FIELDS,
    LIMIT,
    Channel,
    Closing,
    Compression,
    Message,
    Schema,
    head,
    tail,
)
from nrs_cosim.recordings.mcap.digest import Digest
from nrs_cosim.recordings.mcap.ordering import columns_of, ranks
from nrs_cosim.recordings.metadata import CAUSE

CHUNK_BYTES = 64 * 1024
CHUNK_BYTES_PER_CHANNEL = 1024  # an index record per channel and chunk must stay small beside it
CHUNK_SECONDS = 0.5

Tick = Sequence[Columns]


@dataclass(frozen=True, slots=True)
class _Stored:
    """What the file holds for good."""

    offset: int
    crc: int
    digest: Digest
    counts: NDArray[np.int64]
    """(channels + 1,) messages, by channel."""
    closed: int = 0
    """How many of the chunks that were closed; those without a message are not in the file."""
    chunks: int = 0
    ticks: int = 0
    start: int = 0
    end: int = 0


class Writer:
    """A new recording at `path`; a file that is already there is replaced.

    `version` is that of nrs-cosim. `metadata` and `attachments` (name to media type and content)
    describe the run; they, the channels and their schemas are on the disk when this returns.
    A chunk closes at the end of a tick when it holds `chunk_bytes` (64 KiB, or 1 KiB a channel if
    that is more) or when the last one closed `chunk_seconds` of wall time ago: that much is lost
    when the process is killed. Written chunks are with the operating system; nothing is synced
    against a loss of power. `arranging` makes a chunk of messages; all make the same bytes.

    As a context manager it always leaves a closed, valid file: when the block ends without
    `finish`, the status is "interrupted" after a KeyboardInterrupt, and else "failed".

    Raises UncreatableError when the file cannot be created, ValueError when two channels share
    a topic, a channel's schema is missing, or a metadata name is one of the container's own.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        *,
        version: str,
        channels: Iterable[Channel],
        schemas: Iterable[Schema],
        metadata: Mapping[str, Mapping[str, str]],
        attachments: Mapping[str, tuple[str, bytes]],
        compression: Compression = "zstd",
        chunk_bytes: int | None = None,
        chunk_seconds: float = CHUNK_SECONDS,
        arranging: Arranging = by_numpy,
    ) -> None:
        self.path = path
        self._compression = compression
        channels = list(channels)
        stored = {
            name: {key: storable(value) for key, value in record.items()}
            for name, record in metadata.items()
        }
        begin, self._summary = head(version, channels, schemas, stored, attachments)
        topics = dict(enumerate((channel.topic for channel in channels), 1))
        self.numbers = {topic: number for number, topic in topics.items()}
        """Of each topic its channel."""
        self._topics, self._rank = sorted(self.numbers), ranks(topics)
        counted = {n: c.topic for n, c in enumerate(channels, 1) if c.counted}
        self._chunk_bytes = chunk_bytes or max(CHUNK_BYTES, CHUNK_BYTES_PER_CHANNEL * len(channels))
        self._chunk_seconds = chunk_seconds
        self._chunk_indexes: list[bytes] = []
        try:
            self._file = Path(path).open("wb", buffering=0)  # noqa: SIM115 (closed by finish)
        except OSError as error:
            raise UncreatableError(f"{path}: cannot be created: {error.strerror}") from error
        digest = Digest(counted)
        self._arrange = arranging(self._rank, digest)
        self._stored = _Stored(0, 0, digest, np.zeros(len(channels) + 1, np.int64))
        try:
            offset, crc = self._emit(begin)
        except BaseException:
            self._file.close()
            raise
        self._stored = replace(self._stored, offset=offset, crc=crc)
        self._last: Tick = ()
        self._last_time = -1
        """ns: of the last of its messages."""
        self._ticks: dict[int, list[Tick]] = {0: []}
        """Of each chunk that is not in the file; the last one is open."""
        self._open, self._open_bytes = 0, 0
        self._closed_at = time.monotonic()
        self._thread = ThreadPoolExecutor(1, "recording")
        self._storing: Future[None] | None = None

    def write(self, messages: Iterable[Message]) -> None:
        """Write one closed tick: all of its messages, in any order; raises as `put`.

        Raises ValueError too when a topic has no channel, or when a number does not fit (log_time
        u64 ns, sequence u32).
        """
        if tick := list(messages):
            try:
                self.put([columns_of(tick, self.numbers)])
            except ValueError as error:
                raise ValueError(f"{self.path}: {error}") from None

    def put(self, tick: Tick) -> None:
        """Write one closed tick: all of its messages, in any order, on channels that there are.

        Raises ValueError, and writes none of them, when the first in total order is not after
        all earlier ones by (log_time, topic); UnwritableError when the disk refused a chunk,
        or after the end.
        """
        if self._file.closed:
            raise UnwritableError(f"{self.path}: is closed; nothing can be written any more")
        tick = [part for part in tick if len(part.channel)]
        if not tick:
            return
        self._expect_later(tick, min(int(part.time.min()) for part in tick))
        size = sum(HEAD.itemsize * len(part.channel) + len(part.data) for part in tick)
        if self._open_bytes + size > LIMIT:
            raise ValueError(f"a tick of {size} bytes exceeds {LIMIT}")
        self._ticks[self._open].append(tick)
        self._last, self._last_time = tick, max(int(part.time.max()) for part in tick)
        self._open_bytes += size
        due = self._closed_at + self._chunk_seconds
        if self._open_bytes >= self._chunk_bytes or time.monotonic() >= due:
            self._close_chunk()

    def flush(self) -> None:
        """Close the open chunk, so that all ticks so far are in the file; UnwritableError."""
        self._close_chunk()
        self._wait()

    def finish(
        self,
        status: Closing,
        reason: str = "",
        extra: Mapping[str, str] | None = None,
        more: Callable[[], Mapping[str, str]] = dict,
    ) -> None:
        """Close the recording and say how the run ended; `extra` joins the end's metadata.

        So does what `more` returns, which is called when the file is whole without it.

        Raises UnwritableError when the disk refuses a part, or when it is closed already. The
        file is closed in either case: with status "failed" when the last chunk alone is missing,
        unfinished when there is no room for the end itself. Raises ValueError for a status that
        there is not, or an extra name that is taken.
        """
        if self._file.closed:
            raise UnwritableError(f"{self.path}: is closed already")
        if status not in get_args(Closing) or not END_FIELDS.isdisjoint(extra or ()):
            raise ValueError(f"{self.path}: status {quoted(status)}, extra {quoted(extra)}")
        refused: UnwritableError | None = None
        try:
            try:
                self.flush()
            except UnwritableError as error:
                refused, reason = error, f"{reason}; {error}" if reason else str(error)
                status = "failed" if status == "completed" else status
                if status == "failed":
                    cause = replace(error.cause, tick=self._stored.ticks + 1)
                    extra = {**(extra or {}), CAUSE: json.dumps(asdict(cause))}
            end = self._tail(status, reason, extra or {})
            self._end(end)
            if status == "completed" and (said := more()):
                self._end_again(self._tail(status, reason, {**(extra or {}), **said}), end)
        finally:
            self._thread.shutdown()
            self._file.close()
        if refused:
            raise refused

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if self._file.closed:
            return
        status: Closing = "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"
        reason = "closed before the run ended"
        if error is not None:
            reason = ": ".join(filter(None, (type(error).__name__, str(error))))
        cause = Cause("interrupted" if status == "interrupted" else "other")
        if isinstance(error, RunError):
            cause = error.cause
        try:
            self.finish(status, reason, {CAUSE: json.dumps(asdict(cause))})
        except UnwritableError as refused:
            if error is None:
                raise
            error.add_note(str(refused))

    def _expect_later(self, tick: Tick, first: int) -> None:
        last = self._last_time
        if first > last:
            return
        begin = min(self._ranks(tick, first))
        if first < last or begin <= max(self._ranks(self._last, last)):
            end = self._topics[max(self._ranks(self._last, last))]
            raise ValueError(
                f"a tick begins at {(first, self._topics[begin])}, not after {(last, end)}"
            )

    def _ranks(self, tick: Tick, time_ns: int) -> list[int]:
        """Return the places of the topics that have a message at a time."""
        return [
            rank
            for part in tick
            for rank in self._rank[part.channel[part.time == time_ns]].tolist()
        ]

    def _close_chunk(self) -> None:
        """Let the open ticks be put into the file, once those before them are; UnwritableError."""
        self._wait()
        number = self._open
        self._ticks[number + 1] = []
        self._open, self._open_bytes, self._closed_at = number + 1, 0, time.monotonic()
        self._storing = self._thread.submit(self._store, number)

    def _wait(self) -> None:
        """Wait until what is being put into the file is there; UnwritableError."""
        storing, self._storing = self._storing, None
        if storing:
            storing.result()

    def _store(self, until: int) -> None:
        """Put closed ticks into the file: one chunk with its message indexes after the other."""
        for number in range(self._stored.closed, until + 1):
            parts = [part for tick in self._ticks[number] for part in tick]
            self._stored = self._with(parts) if parts else replace(self._stored, closed=number + 1)
            del self._ticks[number]

    def _with(self, parts: Sequence[Columns]) -> _Stored:
        """Put a chunk into the file; return what it then holds."""
        old, made = self._stored, self._arrange(parts)
        digest = old.digest.copy()
        digest.take(made.stream)
        chunk, index = encoded_chunk(old.offset, made.records, self._compression)
        self._chunk_indexes[old.chunks :] = [index]
        offset, crc = self._emit(chunk)
        return _Stored(
            offset,
            crc,
            digest,
            old.counts + made.counts,
            closed=old.closed + 1,
            chunks=old.chunks + 1,
            ticks=old.ticks + made.ticks,
            start=old.start if old.chunks else made.records.start,
            end=made.records.end,
        )

    def _tail(self, status: Closing, reason: str, extra: Mapping[str, str]) -> bytes:
        """Everything after the last chunk."""
        stored = self._stored
        counts = {n: count for n, count in enumerate(stored.counts.tolist()) if count}
        messages = sum(counts.values())
        fields = {
            "status": status,
            "reason": storable(reason),
            "digest": stored.digest.hexdigest(),
            "ticks": str(stored.ticks),
            "messages": str(messages),
            **extra,
        }
        statistics = mcap.Statistics(
            attachment_count=0,
            channel_count=0,
            channel_message_counts=counts,
            chunk_count=stored.chunks,
            message_count=messages,
            message_end_time=stored.end,
            message_start_time=stored.start,
            metadata_count=0,
            schema_count=0,
        )
        return tail(
            offset=stored.offset,
            crc=stored.crc,
            fields=fields,
            summary=self._summary,
            statistics=statistics,
            chunk_indexes=self._chunk_indexes[: stored.chunks],
        )

    def _end(self, tail: bytes) -> None:
        offset, _ = self._emit(tail)
        self._file.truncate(offset)

    def _end_again(self, tail: bytes, before: bytes) -> None:
        """End with more; as before where there is no room for it."""
        try:
            self._end(tail)
        except UnwritableError:
            self._end(before)

    def _emit(self, data: bytes) -> tuple[int, int]:
        """Write at the end of what is stored; the new offset and CRC. Whole, or taken back."""
        stored = self._stored
        rest = memoryview(data)
        try:
            self._file.seek(stored.offset)
            while rest:
                rest = rest[self._file.write(rest) :]
        except BaseException as error:
            with suppress(OSError):
                self._file.truncate(stored.offset)
            if isinstance(error, OSError):
                raise UnwritableError(
                    f"{self.path}: cannot be written: {error.strerror}"
                ) from error
            raise
        return stored.offset + len(data), zlib.crc32(data, stored.crc)
