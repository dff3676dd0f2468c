"""Messages as they come, in any order, become one stretch of columns in total order.

The total order is (log_time, topic); messages that share both follow by sequence, then data. A
topic's place among all topics stands for it: `rank`, by channel number.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.text import quoted
from nrs_cosim.recordings.mcap.columns import Columns, put_rows
from nrs_cosim.recordings.mcap.container import Message

Rank = NDArray[np.int32]


def ranks(topics: Mapping[int, str]) -> Rank:
    """Return each channel's place among the topics, by its number; topics are by number too."""
    rank = np.zeros(max(topics, default=0) + 1, np.int32)
    rank[sorted(topics, key=topics.__getitem__)] = np.arange(len(topics))
    return rank


def columns_of(messages: Sequence[Message], numbers: Mapping[str, int]) -> Columns:
    """Return messages, at least one, as they are; `numbers` gives each topic's channel.

    Raises ValueError when a topic has no channel, or when a log_time does not fit u64 ns or a
    sequence u32.
    """
    times, topics, sequences, data = zip(*messages, strict=True)
    if unknown := set(topics).difference(numbers):
        raise ValueError(f"topic {quoted(min(unknown))} has no channel")
    if min(*times, *sequences) < 0 or max(times) >= 2**64 or max(sequences) >= 2**32:
        raise ValueError("a log_time or sequence is out of range")
    stops = np.fromiter(accumulate(map(len, data)), np.int64, len(data))
    return Columns(
        b"".join(data),
        np.array([numbers[topic] for topic in topics], np.uint16),
        np.array(sequences, np.uint32),
        np.array(times, np.uint64),
        np.concatenate([[0], stops[:-1]]),
        stops,
    )


def concatenated(parts: Sequence[Columns]) -> Columns:
    """Return some columns, at least one, as one after the other."""
    if len(parts) == 1:
        return parts[0]
    counts = [len(part.channel) for part in parts]
    lengths = [len(part.data) for part in parts]
    shift = np.repeat(np.cumsum([0, *lengths[:-1]]), counts)
    return Columns(
        b"".join([part.data for part in parts]),
        np.concatenate([part.channel for part in parts]),
        np.concatenate([part.sequence for part in parts]),
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.start for part in parts]) + shift,
        np.concatenate([part.stop for part in parts]) + shift,
    )


def order(messages: Columns, rank: Rank) -> NDArray[np.intp]:
    """Return which message is the first in total order, which the second, and so on."""
    keys = messages.time, rank[messages.channel], messages.sequence
    found: NDArray[np.intp] = np.lexsort(keys[::-1])
    same = np.ones(max(len(found) - 1, 0), bool)
    for key in keys:
        at = key[found]
        same &= at[1:] == at[:-1]
    if same.any():
        opening = _first_bytes(messages)
        found = np.lexsort((opening, *keys[::-1]))
        at = opening[found]
        same &= at[1:] == at[:-1]
    for first, stop in _runs(same):
        tied = found[first:stop].tolist()
        found[first:stop] = sorted(tied, key=messages.payload)
    return found


def _first_bytes(messages: Columns) -> NDArray[np.uint64]:
    """Return the first bytes of each message as a number, which is less where they are before."""
    sizes = np.minimum(messages.stop - messages.start, 8)
    padded = np.zeros(8 * len(sizes), np.uint8)
    put_rows(padded.data, np.arange(0, len(padded), 8), messages.data, messages.start, sizes)
    return padded.view(">u8").astype(np.uint64)


def _runs(same: NDArray[np.bool_]) -> Iterable[tuple[int, int]]:
    """Yield the first and the stop of each row of entries of which each is the same as the next."""
    if not same.any():
        return
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), (edges[1::2] + 1).tolist(), strict=True)
