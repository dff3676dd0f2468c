"""The messages of a chunk as columns, one entry a message.

Where a message begins follows from the length of the one before, so it is found by walking; but as
long as it has the layout of another chunk, as most chunks of a run do, that is verified for all
messages at once. Each of a message's numbers stands at a fixed place after its beginning: they are
taken out of the bytes for all messages at once too.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from struct import Struct, error

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from nrs_cosim.recordings.mcap.container import MOST_CHANNELS, Message, demand

_OPENING = Struct("<BQ")  # opcode, length
HEAD = np.dtype(
    [
        ("kind", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("time", "<u8"),
        ("published", "<u8"),
    ]
)
"""What stands before a message's own bytes: opcode, length of what follows, and so on."""
_LEAST = HEAD.itemsize - _OPENING.size
"""What the length of a message without bytes of its own is."""
MANY = MOST_CHANNELS + 1
"""Channel numbers: u16."""
_OTHER = "it holds more than messages of this recording"


Bytes = bytes | memoryview


def windows(data: Bytes, size: int) -> NDArray[np.void]:
    """Return the `size` > 0 bytes from each place in data on, which overlap: views, of V`size`.

    What is put into one of them is put into the data, where those can be written.
    """
    kind = np.dtype(f"V{size}")
    return np.ndarray((max(0, len(data) - size + 1),), kind, data, strides=(1,))


def rows_at(data: Bytes, starts: NDArray[np.int64], size: int) -> NDArray[np.void]:
    """Return the `size` bytes that begin at each start, copied together: (rows,) of V`size`."""
    return windows(data, size)[starts]


def put_rows(
    into: memoryview,
    at: NDArray[np.int64],
    data: Bytes,
    starts: NDArray[np.int64],
    sizes: NDArray[np.int64],
) -> None:
    """Copy stretches of data to places in other bytes, all of one size in one step."""
    for size in np.unique(sizes).tolist():
        if size:
            those = sizes == size
            windows(into, size)[at[those]] = windows(data, size)[starts[those]]


@dataclass(frozen=True, slots=True)
class Columns:
    """Messages in the order of the file; `data` are the bytes that they lie in."""

    data: Bytes
    channel: NDArray[np.uint16]
    sequence: NDArray[np.uint32]
    time: NDArray[np.uint64]
    """log_time, ns"""
    start: NDArray[np.int64]
    """Where each message's own bytes begin in `data`."""
    stop: NDArray[np.int64]
    """Where they end."""

    def payload(self, row: int) -> bytes:
        """Return the bytes of one message."""
        return bytes(self.data[self.start[row] : self.stop[row]])

    def only(self, kept: NDArray[np.bool_]) -> "Columns":
        """Return some of the messages."""
        return self if kept.all() else self.at(kept)

    def at(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> "Columns":
        """Return messages by their rows."""
        columns = (self.channel, self.sequence, self.time, self.start, self.stop)
        return Columns(self.data, *(column[rows] for column in columns))  # type: ignore[arg-type]

    def on(self, channels: Collection[int]) -> "Columns":
        """Return the messages on some channels."""
        return self.only(on_any_of(channels)[self.channel])

    def within(self, start: int, end: int) -> "Columns":
        """Return the messages with start <= log_time < end, ns."""
        return self.only((self.time >= start) & (self.time < end))

    def payloads(self, size: int) -> bytes:
        """Return all messages' bytes, one after the other; DamageError when one has not `size`."""
        demand(bool((self.stop - self.start == size).all()), "a message has another size")
        return rows_at(self.data, self.start, size).tobytes()

    def stretch(self) -> bytes:
        """Return the records from the first message's to the last one's, whatever is between."""
        if not len(self.start):
            return b""
        return bytes(self.data[int(self.start[0]) - HEAD.itemsize : int(self.stop[-1])])

    def messages(self, topics: Mapping[int, str]) -> list[Message]:
        """Return them one by one; `topics` are those of the channels."""
        data = bytes(self.data)
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


def on_any_of(channels: Collection[int]) -> NDArray[np.bool_]:
    """Return whether each number of a channel, from 0 on, is one of those: (MANY,)."""
    found = np.zeros(MANY, bool)
    found[list(channels)] = True
    return found


def columns(
    records: bytes, channels: Collection[int], like: NDArray[np.int64] | None = None
) -> Columns:
    """Return the messages among the records of a chunk, which must be all that there is.

    `like` are the `start` of another chunk of the same run: a guess, which only saves time.
    Raises DamageError when there are other records, or channels not in `channels`.
    """
    begins = _begins(records, like)
    heads = rows_at(records, begins, HEAD.itemsize).view(HEAD)
    known = on_any_of(channels)
    sound = (heads["kind"] == Opcode.MESSAGE) & (heads["length"] >= _LEAST)
    demand(bool((sound & known[heads["channel"]]).all()), _OTHER)
    return Columns(
        records,
        heads["channel"],
        heads["sequence"],
        heads["time"],
        begins + HEAD.itemsize,
        np.append(begins[1:], len(records)),
    )


def _begins(records: bytes, like: NDArray[np.int64] | None) -> NDArray[np.int64]:
    """Return where records begin; DamageError unless they fill all the bytes.

    The first that is no message ends the walk: nobody knows how many follow.
    """
    stop, at, known = len(records), 0, np.empty(0, np.int64)
    if like is not None and len(like) and stop >= HEAD.itemsize:
        tried = like - HEAD.itemsize
        tried = tried[: np.searchsorted(tried, stop - HEAD.itemsize, "right")]
        lengths = rows_at(records, tried + 1, 8).view("<u8")
        after = tried + 9 + np.minimum(lengths, stop).astype(np.int64)
        wrong = np.flatnonzero(after[:-1] != tried[1:])
        known = tried[: wrong[0] + 1] if len(wrong) else tried
        at = int(after[len(known) - 1])
    begins: list[int] = []
    note, opening_at = begins.append, _OPENING.unpack_from
    message, least = int(Opcode.MESSAGE), _LEAST  # an enumeration compares slowly
    try:
        while at < stop:
            kind, length = opening_at(records, at)
            if kind != message or length < least:
                break
            note(at)
            at += 9 + length
    except error:
        at = -1
    found = np.concatenate([known, np.array(begins, np.int64)])
    demand(at == stop and (not len(found) or found[-1] + HEAD.itemsize <= stop), _OTHER)
    return found
