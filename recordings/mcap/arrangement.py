"""What becomes of a chunk's messages, which come in any order: records, and what the digest hears.

    messages → total order → records with their indexes, for the file
                           → topic, time, sequence, length, bytes of each counted one, for SHA-256

NumPy does it here; `native` does it by one call, to the same bytes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.recordings.mcap.chunk import ChunkRecords, packed
from nrs_cosim.recordings.mcap.columns import Bytes, Columns
from nrs_cosim.recordings.mcap.digest import Digest
from nrs_cosim.recordings.mcap.ordering import Rank, concatenated, order


@dataclass(frozen=True, slots=True, eq=False)
class Arranged:
    """All that is made of the messages of a chunk."""

    records: ChunkRecords
    stream: Bytes
    """What the digest takes."""
    counts: NDArray[np.int64]
    """(channels + 1,) messages, by channel."""
    ticks: int
    """How many sequences there are but 0."""


Arrange = Callable[[Sequence[Columns]], Arranged]
"""Arranges messages, at least one, which come in parts; what it made is there until the next."""
Arranging = Callable[[Rank, Digest], Arrange]
"""Knows the places of topics, and which of them are counted."""


def by_numpy(rank: Rank, digest: Digest) -> Arrange:
    """Return how NumPy arranges messages."""

    def arrange(parts: Sequence[Columns]) -> Arranged:
        messages = concatenated(parts)
        messages = messages.at(order(messages, rank))
        return Arranged(
            packed(messages),
            digest.stream(messages),
            np.bincount(messages.channel, minlength=len(rank)),
            int(np.count_nonzero(np.unique(messages.sequence))),
        )

    return arrange
