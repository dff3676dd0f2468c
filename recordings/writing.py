"""Writing a recording: ticks in, chunks out.

The law: a tick is written whole or not at all, in total order, and never before an earlier one. A
chunk closes at the end of a tick, when it is large or old enough; only then does it reach the
file, in one piece. Where chunks close changes neither the digest nor a message. All that the file
holds is one value, replaced at once when a chunk is on the disk: no interruption tears it, and a
chunk that the disk refuses is taken back.
"""

import time
import zlib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Self, get_args

from mcap import records as mcap

from recordings.chunk import closed, packed
from recordings.columns import HEAD
from recordings.container import (
    END_FIELDS,
    LIMIT,
    Channel,
    Closing,
    Compression,
    Schema,
    head,
    tail,
)
from recordings.digest import Digest, Message
from recordings.errors import UncreatableError, UnwritableError

CHUNK_BYTES = 64 * 1024
CHUNK_BYTES_PER_CHANNEL = 1024  # an index record per channel and chunk must stay small beside it
CHUNK_SECONDS = 0.5


@dataclass(frozen=True, slots=True)
class _Stored:
    """What the file holds for good, and the ticks that come next."""

    offset: int
    crc: int
    digest: Digest
    chunks: int = 0
    ticks: int = 0
    start: int = 0
    end: int = 0
    counts: Mapping[int, int] = field(default_factory=dict)
    open: list[list[Message]] = field(default_factory=list)


class Writer:
    """A new recording at `path`; a file that is already there is replaced.

    `version` is that of nrs-cosim. `metadata` and `attachments` (name to media type and content)
    describe the run; they, the channels and their schemas are on the disk when this returns.
    A chunk closes at the end of a tick when it holds `chunk_bytes` (64 KiB, or 1 KiB a channel if
    that is more) or when the last one closed `chunk_seconds` of wall time ago: that much is lost
    when the process is killed. Written chunks are with the operating system; nothing is synced
    against a loss of power.

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
    ) -> None:
        self.path = path
        self._compression = compression
        channels = list(channels)
        begin, self._summary = head(version, channels, schemas, metadata, attachments)
        self._numbers = {channel.topic: number for number, channel in enumerate(channels, 1)}
        self._chunk_bytes = chunk_bytes or max(CHUNK_BYTES, CHUNK_BYTES_PER_CHANNEL * len(channels))
        self._chunk_seconds = chunk_seconds
        self._chunk_indexes: list[bytes] = []
        try:
            self._file = Path(path).open("wb", buffering=0)  # noqa: SIM115 (closed by finish)
        except OSError as error:
            raise UncreatableError(f"{path}: cannot be created: {error.strerror}") from error
        self._stored = _Stored(0, 0, Digest(c.topic for c in channels if c.counted))
        try:
            offset, crc = self._emit(begin)
        except BaseException:
            self._file.close()
            raise
        self._stored = _Stored(offset, crc, self._stored.digest)
        self._last = (-1, "")
        self._open_bytes = 0
        self._closed_at = time.monotonic()

    def write(self, messages: Iterable[Message]) -> None:
        """Write one closed tick: all of its messages, in any order.

        Raises ValueError, and writes none of them, when the first in total order is not after
        all earlier ones by (log_time, topic), when a topic has no channel, or when a number does
        not fit (log_time u64 ns, sequence u32); UnwritableError when the disk refuses a chunk,
        or after the end.
        """
        if self._file.closed:
            raise UnwritableError(f"{self.path}: is closed; nothing can be written any more")
        tick = sorted(messages)
        if not tick:
            return
        times, topics, sequences, data = zip(*tick, strict=True)
        if unknown := set(topics).difference(self._numbers):
            raise ValueError(f"{self.path}: topic {min(unknown)!r} has no channel")
        if min(times[0], *sequences) < 0 or times[-1] >= 2**64 or max(sequences) >= 2**32:
            raise ValueError(f"{self.path}: a log_time or sequence is out of range")
        size = HEAD.itemsize * len(tick) + sum(map(len, data))
        if tick[0][:2] <= self._last:
            raise ValueError(f"{self.path}: a tick begins at {tick[0][:2]}, not after {self._last}")
        if self._open_bytes + size > LIMIT:
            raise ValueError(f"{self.path}: a tick of {size} bytes exceeds {LIMIT}")
        self._last = tick[-1][:2]
        self._open_bytes += size
        self._stored.open.append(tick)
        due = self._closed_at + self._chunk_seconds
        if self._open_bytes >= self._chunk_bytes or time.monotonic() >= due:
            self._close_chunk()

    def flush(self) -> None:
        """Close the open chunk, so that all ticks so far are in the file; UnwritableError."""
        self._close_chunk()

    def finish(
        self, status: Closing, reason: str = "", extra: Mapping[str, str] | None = None
    ) -> None:
        """Close the recording and say how the run ended; `extra` joins the end's metadata.

        Raises UnwritableError when the disk refuses a part, or when it is closed already. The
        file is closed in either case: with status "failed" when the last chunk alone is missing,
        unfinished when there is no room for the end itself. Raises ValueError for a status that
        there is not, or an extra name that is taken.
        """
        if self._file.closed:
            raise UnwritableError(f"{self.path}: is closed already")
        if status not in get_args(Closing) or not END_FIELDS.isdisjoint(extra or ()):
            raise ValueError(f"{self.path}: status {status!r}, extra {extra!r}")
        refused: UnwritableError | None = None
        try:
            try:
                self._close_chunk()
            except UnwritableError as error:
                refused, reason = error, f"{reason}; {error}" if reason else str(error)
                status = "failed" if status == "completed" else status
            offset, _ = self._emit(self._tail(status, reason, extra or {}))
            self._file.truncate(offset)
        finally:
            self._file.close()
        if refused:
            raise refused

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file.closed:
            return
        status: Closing = "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"
        reason = "left before the run said how it ended"
        if error is not None:
            reason = ": ".join(filter(None, (type(error).__name__, str(error))))
        try:
            self.finish(status, reason)
        except UnwritableError as refused:
            if error is None:
                raise
            error.add_note(str(refused))

    def _close_chunk(self) -> None:
        """Put the open ticks into the file as one chunk with its message indexes."""
        old = self._stored
        if not old.open:
            return
        messages = [message for tick in old.open for message in tick]
        columns = packed(messages, self._numbers)
        digest = old.digest.copy()
        digest.update(messages)
        chunk, index, added = closed(old.offset, columns, self._compression)
        self._chunk_indexes[old.chunks :] = [index]
        offset, crc = self._emit(chunk)
        self._stored = _Stored(
            offset,
            crc,
            digest,
            chunks=old.chunks + 1,
            ticks=old.ticks + len({*columns.sequence.tolist()} - {0}),
            start=old.start if old.chunks else messages[0][0],
            end=messages[-1][0],
            counts={**old.counts, **{n: old.counts.get(n, 0) + m for n, m in added.items()}},
        )
        self._open_bytes = 0
        self._closed_at = time.monotonic()

    def _tail(self, status: Closing, reason: str, extra: Mapping[str, str]) -> bytes:
        """Everything after the last chunk."""
        stored, messages = self._stored, sum(self._stored.counts.values())
        fields = {
            "status": status,
            "reason": reason.encode(errors="backslashreplace").decode(),
            "digest": stored.digest.hexdigest(),
            "ticks": str(stored.ticks),
            "messages": str(messages),
            **extra,
        }
        statistics = mcap.Statistics(
            attachment_count=0,
            channel_count=0,
            channel_message_counts=dict(stored.counts),
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
