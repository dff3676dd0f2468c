"""The law of the digest: SHA-256 over all counted messages in total order.

The total order is (log_time, topic); messages that share both follow by sequence, then data. Topics
compare by code point, which is also the order of their UTF-8 bytes. Each message enters as

    u32 len(topic) | topic, UTF-8 | u64 log_time | u32 sequence | u32 len(data) | data

little-endian. Every variable part carries its length, so that no two streams share their bytes.
Nothing else enters: not the compression, the chunks, the channels' numbers, or a version.
"""

import hashlib
from collections.abc import Iterable
from itertools import chain, repeat
from operator import itemgetter
from struct import Struct
from typing import Self

import numpy as np

Message = tuple[int, str, int, bytes]
"""(log_time in integer ns, topic, sequence, data): `sorted` gives the total order."""

_PREFIX = Struct("<I")
_FIXED = np.dtype([("time", "<u8"), ("sequence", "<u4"), ("length", "<u4")])


class Digest:
    """The running digest of a stream of messages, of which the topics in `counted` enter."""

    def __init__(self, counted: Iterable[str]) -> None:
        encoded = ((topic, topic.encode()) for topic in counted)
        self._prefixes = {topic: _PREFIX.pack(len(utf8)) + utf8 for topic, utf8 in encoded}
        self._hash = hashlib.sha256()

    def update(self, messages: Iterable[Message]) -> None:
        """Take in the next messages, which are in total order and after all earlier ones."""
        columns = [*zip(*messages, strict=True)]
        if not columns:
            return
        times, topics, sequences, data = columns
        fixed = np.empty(len(times), _FIXED)
        fixed["time"] = np.array(times, np.uint64)
        fixed["sequence"] = sequences
        fixed["length"] = np.fromiter(map(len, data), np.int64, len(data))
        prefixes = map(self._prefixes.get, topics, repeat(b""))
        parts = zip(prefixes, fixed.view(f"V{_FIXED.itemsize}").tolist(), data, strict=True)
        counted = filter(itemgetter(0), parts)
        self._hash.update(b"".join(chain.from_iterable(counted)))

    def copy(self) -> Self:
        """The same digest, from here on by itself."""
        twin = object.__new__(type(self))
        twin._prefixes, twin._hash = self._prefixes, self._hash.copy()
        return twin

    def hexdigest(self) -> str:
        """The digest of everything taken in so far, 64 hexadecimal characters."""
        return self._hash.hexdigest()
