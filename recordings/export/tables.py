"""A recording's tables: one row a message, sorted by time, then robot, a chunk at a time.

A row has k, `time_ns` and `t` (the same in s), the robot, then what the message type has. Samples
are left limits at t_k, of all nodes, robot 0 being the target; states are of robots on the output
grid; link events say what a link did to a sample of `source` on its way to the robot.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.keys import link_event_topic, sample_topic, state_topic
from nrs_cosim.bus.messages import LINK_EVENT, SAMPLE, STATE, Codec, MessageType
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.container import DamageError
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import RUN, About

Put = Callable[[NDArray[np.void]], None]
"""Takes rows of a table."""


@dataclass(frozen=True, slots=True)
class MessageTable:
    """A name, the type of the messages, their topics by robot, the first robot, the row's names."""

    name: str
    kind: MessageType
    key: Callable[[int], str]
    first: int
    scalars: tuple[str, ...]

    @property
    def order(self) -> tuple[str, ...]:
        """What rows are sorted by, the last one first, as `numpy.lexsort` wants it."""
        return (*reversed(self.kind.counts), "robot", "time_ns")

    def columns(self, m: int) -> list[str]:
        """Return the names of the columns where each number has one of its own."""
        vectors = [f"{name}_{i}" for name in self.kind.fields for i in range(1, m + 1)]
        return [*self.scalars, *vectors]

    def dtype(self, m: int) -> np.dtype[np.void]:
        """Return the type of a row of vectors of m numbers."""
        layout: list[tuple[Any, ...]] = [
            ("k", "u4"),
            ("time_ns", "i8"),
            ("t", "f8"),
            ("robot", "u4"),
        ]
        layout += [(name, "u4") for name in self.kind.counts]
        return np.dtype(layout + [(name, "f8", (m,)) for name in self.kind.fields])


SAMPLES = MessageTable("samples", SAMPLE, sample_topic, 0, ("k", "time_ns", "t", "robot"))
STATES = MessageTable("states", STATE, state_topic, 1, ("k", "time_ns", "t", "robot"))
LINK_EVENTS = MessageTable(
    "link_events",
    LINK_EVENT,
    link_event_topic,
    1,
    ("k", "time_ns", "t", "robot", *LINK_EVENT.counts),
)


def about(reader: Reader) -> About:
    """Return what a recording says of its run; `UnreadableError` when it says nothing of one."""
    if reader.about is None:
        raise UnreadableError(f"{reader.path}: holds no run; give a recording of `nrs run`")
    return reader.about


def joints(reader: Reader) -> int:
    """Return m, the numbers in each vector of the run's messages."""
    return about(reader).run.joints


def expect_joints(reader: Reader) -> None:
    """Raise `UnreadableError` where messages are not of as many joints as the run is said to have.

    It reads the first message, before anything is made of that many.
    """
    m = joints(reader)
    first = next(reader.columns([state_topic(1)]), None)
    expected = Codec(STATE, Sizes(m)).size
    if first is not None and (size := int(first.stop[0] - first.start[0])) != expected:
        raise UnreadableError(
            f"{reader.path}: {RUN}: joints: is {m}, but a state of robot 1 has {size} bytes"
        )


def robots(reader: Reader) -> int:
    """Return n."""
    return about(reader).run.robots


def rows(
    reader: Reader,
    tables: Sequence[MessageTable],
    of: Collection[int] | None = None,
    start_ns: int | None = None,
    end_ns: int | None = None,
) -> Iterator[tuple[MessageTable, NDArray[np.void]]]:
    """Yield rows of some tables, each with its own, in one pass over the file.

    They are those of all robots or some, with start_ns <= time_ns < end_ns, a chunk each, which
    holds whole ticks. Raises `UnreadableError` when a message is not of the table's type, or has a
    number that is not finite.
    """
    n, m = robots(reader), joints(reader)
    codecs = {table.name: Codec(table.kind, Sizes(m)) for table in tables}
    wanted = {
        table.name: {table.key(i) for i in range(table.first, n + 1) if of is None or i in of}
        for table in tables
    }
    channels = {
        name: [number for number, topic in reader.topics.items() if topic in topics]
        for name, topics in wanted.items()
    }
    for columns in reader.columns(set().union(*wanted.values()), start_ns, end_ns):
        for table in tables:
            mine = columns.on(channels[table.name])
            if len(mine.time):
                try:
                    yield table, _rows(table, codecs[table.name], mine)
                except (BusError, DamageError) as error:
                    raise UnreadableError(f"{reader.path}: {error}") from error


def _rows(table: MessageTable, codec: Codec, columns: Columns) -> NDArray[np.void]:
    messages = codec.parsed(columns.payloads(codec.size))
    dtype = table.dtype(codec.sizes.m)
    found = np.empty(len(messages), dtype)
    for name in dtype.names or ():
        found[name] = messages["time_ns"] / 1e9 if name == "t" else messages[name]
    order = np.lexsort([found[name] for name in table.order])
    whole = found.view(f"V{dtype.itemsize}")  # field by field it takes ten times as long
    return whole[order].view(dtype)


def samples(reader: Reader, start_ns: int | None = None) -> Iterator[NDArray[np.void]]:
    """Yield rows of k, time_ns, t, robot, and position and velocity (m,), from `start_ns` on."""
    return (found for _, found in rows(reader, [SAMPLES], start_ns=start_ns))


def states(reader: Reader, start_ns: int | None = None) -> Iterator[NDArray[np.void]]:
    """Yield rows of k, time_ns, t, robot, and the vectors of `nrs.State` (m,)."""
    return (found for _, found in rows(reader, [STATES], start_ns=start_ns))
