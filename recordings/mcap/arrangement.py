"""What becomes of a chunk's messages, which come in any order: records, and what the digest hears.

    messages → total order → records with their indexes, for the file
                           → topic, time, sequence, length, bytes of each counted one, for SHA-256

NumPy does it here; `native` does it by one call, to the same bytes.
"""

from collections.abc import Callable

from nrs_cosim.recordings.mcap.chunk import ChunkRecords, packed
from nrs_cosim.recordings.mcap.columns import Bytes, Columns
from nrs_cosim.recordings.mcap.digest import Digest
from nrs_cosim.recordings.mcap.ordering import Rank, order

Arrange = Callable[[Columns], tuple[ChunkRecords, Bytes]]
"""Makes records of messages, at least one, and the stream that the digest takes."""
Arranging = Callable[[Rank, Digest], Arrange]
"""Knows the places of topics, and which of them are counted."""


def by_numpy(rank: Rank, digest: Digest) -> Arrange:
    """Return how NumPy arranges messages."""

    def arrange(messages: Columns) -> tuple[ChunkRecords, Bytes]:
        messages = messages.at(order(messages, rank))
        return packed(messages), digest.stream(messages)

    return arrange
