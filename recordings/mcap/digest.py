"""The law of the digest: SHA-256 over all counted messages in total order.

The total order is (log_time, topic); messages that share both follow by sequence, then data. Topics
compare by code point, which is also the order of their UTF-8 bytes. Each message enters as

    u32 len(topic) | topic, UTF-8 | u64 log_time | u32 sequence | u32 len(data) | data

little-endian. Every variable part carries its length, so that no two streams share their bytes.
Nothing else enters: not the compression, the chunks, the channels' numbers, or a version.
"""

import hashlib
from collections.abc import Mapping
from struct import Struct
from typing import Self

import numpy as np

from nrs_cosim.recordings.mcap.columns import MANY, Bytes, Columns, put_rows, windows

_PREFIX = Struct("<I")
FIXED = np.dtype([("time", "<u8"), ("sequence", "<u4"), ("length", "<u4")])


class Digest:
    """The running digest of a stream of messages, of which those on `counted` channels enter."""

    def __init__(self, counted: Mapping[int, str]) -> None:
        """Know the topics that are counted, by the numbers of their channels."""
        topics = [topic.encode() for topic in counted.values()]
        prefixes = [_PREFIX.pack(len(utf8)) + utf8 for utf8 in topics]
        self.prefixes = b"".join(prefixes)
        """What each message on a counted channel enters with first."""
        self.lengths, self.starts = np.zeros(MANY, np.int64), np.zeros(MANY, np.int64)
        """Of each channel's in `prefixes`; the length of what is not counted is 0."""
        numbers = np.array([*counted], np.intp)
        self.lengths[numbers] = lengths = np.array([*map(len, prefixes)], np.int64)
        self.starts[numbers] = np.cumsum(lengths) - lengths
        self._hash = hashlib.sha256()

    def stream(self, messages: Columns) -> memoryview:
        """Return as what the next messages enter, which are in total order."""
        messages = messages.only(self.lengths[messages.channel] > 0)
        prefixes, sizes = self.lengths[messages.channel], messages.stop - messages.start
        fixed = np.empty(len(sizes), FIXED)
        fixed["time"], fixed["sequence"], fixed["length"] = messages.time, messages.sequence, sizes
        lengths = prefixes + FIXED.itemsize + sizes
        at = np.cumsum(lengths) - lengths
        stream = np.empty(int(lengths.sum()), np.uint8).data
        put_rows(stream, at, self.prefixes, self.starts[messages.channel], prefixes)
        windows(stream, FIXED.itemsize)[at + prefixes] = fixed.view(f"V{FIXED.itemsize}")
        after = at + prefixes + FIXED.itemsize
        put_rows(stream, after, messages.data, messages.start, sizes)
        return stream

    def take(self, stream: Bytes) -> None:
        """Take in the next messages, which are after all earlier ones, as `stream` has them."""
        self._hash.update(stream)

    def update(self, messages: Columns) -> None:
        """Take in the next messages, which are in total order and after all earlier ones."""
        self.take(self.stream(messages))

    def copy(self) -> Self:
        """The same digest, from here on by itself."""
        twin = object.__new__(type(self))
        vars(twin).update(vars(self), _hash=self._hash.copy())
        return twin

    def hexdigest(self) -> str:
        """The digest of everything taken in so far, 64 hexadecimal characters."""
        return self._hash.hexdigest()


def digest_differs(written: str) -> str:
    """Say that messages have another digest than was written of them."""
    return f"the messages had the digest {written} when written"
