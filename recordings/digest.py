"""The law of the digest: SHA-256 over all counted messages in total order.

The total order is (log_time, topic); messages that share both follow by sequence, then data. Topics
compare by code point, which is also the order of their UTF-8 bytes. Each message enters as

    u32 len(topic) | topic, UTF-8 | u64 log_time | u32 sequence | u32 len(data) | data

little-endian. Every variable part carries its length, so that no two streams share their bytes.
Nothing else enters: not the compression, the chunks, the channels' numbers, or a version.
"""

import hashlib
from collections.abc import Iterable
from struct import Struct
from typing import Self

Message = tuple[int, str, int, bytes]
"""(log_time in integer ns, topic, sequence, data): `sorted` gives the total order."""

_PREFIX = Struct("<I")
_FIXED = Struct("<QII")


class Digest:
    """The running digest of a stream of messages, of which the topics in `counted` enter."""

    def __init__(self, counted: Iterable[str]) -> None:
        encoded = ((topic, topic.encode()) for topic in counted)
        self._prefixes = {topic: _PREFIX.pack(len(utf8)) + utf8 for topic, utf8 in encoded}
        self._hash = hashlib.sha256()

    def update(self, messages: Iterable[Message]) -> None:
        """Take in the next messages, which are in total order and after all earlier ones."""
        prefix, pack = self._prefixes.get, _FIXED.pack
        self._hash.update(
            b"".join(
                [
                    part
                    for time, topic, sequence, data in messages
                    if (head := prefix(topic)) is not None
                    for part in (head, pack(time, sequence, len(data)), data)
                ]
            )
        )

    def copy(self) -> Self:
        """The same digest, from here on by itself."""
        twin = object.__new__(type(self))
        twin._prefixes, twin._hash = self._prefixes, self._hash.copy()
        return twin

    def hexdigest(self) -> str:
        """The digest of everything taken in so far, 64 hexadecimal characters."""
        return self._hash.hexdigest()
