"""A recording's samples and states as arrays: one row a message, in the order of the file."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bus.keys import sample_key, state_key
from bus.messages import SAMPLE, STATE, Codec, MessageType
from recordings.reading import Reader

RUN = "nrs.run"
"""The metadata record that describes the run: seed, robots, joints, ticks, periods, plants."""


def joints(reader: Reader) -> int:
    """Return m, the numbers in each vector of the run's messages."""
    return int(reader.metadata[RUN]["joints"])


def robots(reader: Reader) -> int:
    """Return n."""
    return int(reader.metadata[RUN]["robots"])


def samples(reader: Reader, start_ns: int | None = None) -> Iterator[NDArray[np.void]]:
    """Yield records (rows,) with robot, k, time_ns, position and velocity (m,), a chunk each.

    Robot 0 is the target. A chunk holds whole ticks, from `start_ns` (ns) on.
    """
    topics = {sample_key(node) for node in range(robots(reader) + 1)}
    return _records(reader, SAMPLE, topics, start_ns)


def states(reader: Reader, start_ns: int | None = None) -> Iterator[NDArray[np.void]]:
    """Yield records (rows,) with robot, k, time_ns, and q, qd, tau, position, velocity (m,)."""
    topics = {state_key(robot) for robot in range(1, robots(reader) + 1)}
    return _records(reader, STATE, topics, start_ns)


def _records(
    reader: Reader, kind: MessageType, topics: set[str], start_ns: int | None
) -> Iterator[NDArray[np.void]]:
    codec = Codec(kind, joints(reader))
    for batch in reader.batches(topics, start_ns):
        yield codec.decode([data for *_, data in batch])
