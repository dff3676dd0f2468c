"""The messages of a chunk as columns, one entry a message.

A record can begin with any length, so where each one begins is found by walking, which is all the
work that is done per message. Each of a message's numbers stands at a fixed place after that: they
are taken out of the bytes for all messages at once.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from struct import Struct, error

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from recordings.container import demand
from recordings.digest import Message

_LENGTH = Struct("<Q")
_HEAD = np.dtype(
    [
        ("kind", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("time", "<u8"),
        ("published", "<u8"),
    ]
)
_MANY = 2**16
"""Channel numbers: u16."""


def rows_at(data: bytes, starts: NDArray[np.int64], size: int) -> NDArray[np.void]:
    """Return the `size` bytes that begin at each start, copied together: (rows,) of V`size`."""
    kind = np.dtype(f"V{size}")
    every = max(0, len(data) - size + 1)
    return np.ndarray((every,), kind, data, strides=(1,))[starts]


@dataclass(frozen=True, slots=True)
class Columns:
    """Messages in the order of the file; `data` are the bytes that they lie in."""

    data: bytes
    channel: NDArray[np.uint16]
    sequence: NDArray[np.uint32]
    time: NDArray[np.uint64]
    """log_time, ns"""
    start: NDArray[np.int64]
    """Where each message's own bytes begin in `data`."""
    stop: NDArray[np.int64]
    """Where they end."""

    def only(self, kept: NDArray[np.bool_]) -> "Columns":
        """Return some of the messages."""
        if kept.all():
            return self
        columns = (self.channel, self.sequence, self.time, self.start, self.stop)
        return Columns(self.data, *(column[kept] for column in columns))  # type: ignore[arg-type]

    def on(self, channels: Collection[int]) -> "Columns":
        """Return the messages on some channels."""
        wanted = np.zeros(_MANY, bool)
        wanted[list(channels)] = True
        return self.only(wanted[self.channel])

    def within(self, start: int, end: int) -> "Columns":
        """Return the messages with start <= log_time < end, ns."""
        return self.only((self.time >= start) & (self.time < end))

    def payloads(self, size: int) -> bytes:
        """Return all messages' bytes, one after the other; DamageError when one has not `size`."""
        demand(bool((self.stop - self.start == size).all()), "a message has another size")
        return rows_at(self.data, self.start, size).tobytes()

    def messages(self, topics: Mapping[int, str]) -> list[Message]:
        """Return them one by one; `topics` are those of the channels."""
        data = self.data
        return [
            (time, topics[channel], sequence, data[start:stop])
            for time, channel, sequence, start, stop in zip(
                self.time.tolist(),
                self.channel.tolist(),
                self.sequence.tolist(),
                self.start.tolist(),
                self.stop.tolist(),
                strict=True,
            )
        ]


def columns(records: bytes, channels: Collection[int]) -> Columns:
    """Return the messages among the records of a chunk, which must be all that there is.

    Raises DamageError when there are other records, or channels not in `channels`.
    """
    begins: list[int] = []
    note, length_at, at, stop = begins.append, _LENGTH.unpack_from, 0, len(records)
    try:
        while at < stop:
            note(at)
            at += 9 + length_at(records, at + 1)[0]
    except error:
        at = -1
    starts = np.array(begins, np.int64)
    whole = at == stop and (not begins or begins[-1] + _HEAD.itemsize <= stop)
    demand(whole, "it holds more than messages of this recording")
    heads = rows_at(records, starts, _HEAD.itemsize).view(_HEAD)
    known = np.zeros(_MANY, bool)
    known[list(channels)] = True
    sound = (heads["kind"] == Opcode.MESSAGE) & (heads["length"] >= _HEAD.itemsize - 9)
    demand(
        bool((sound & known[heads["channel"]]).all()),
        "it holds more than messages of this recording",
    )
    return Columns(
        records,
        heads["channel"],
        heads["sequence"],
        heads["time"],
        starts + _HEAD.itemsize,
        np.append(starts[1:], stop),
    )
