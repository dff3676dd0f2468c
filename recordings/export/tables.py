"""A recording's tables: one row a message, sorted by time, then robot, a chunk at a time.

A row has k, `time_ns` and `t` (the same in s), the robot, then what the message type in the file
has. Samples are left limits at t_k, of all nodes, robot 0 being the target; states are of robots on
the output grid; agent states are what agents keep beside their estimates, right after t_k;
measurements are what pinned robots measured of the target at t_k; link events say what a link did
to a sample of `source` on its way to the robot.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.fields import Shape, indexed_names
from nrs_cosim.bus.messages import Codec
from nrs_cosim.bus.topics import Topics
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.container import DamageError
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.schemas import RecordedTypes, about, recorded_types

Put = Callable[[NDArray[np.void]], None]
"""Takes rows of a table."""
MOST_UNSEEN = 2**16
"""Columns of a table without rows: a file has nothing that would be in proportion to more."""
OPENING = ("k", "time_ns", "t", "robot")
"""What every row begins with."""


@dataclass(frozen=True, slots=True)
class MessageTable:
    """A name, the kind of its messages, and the first robot that has any."""

    name: str
    kind: str
    first: int


@dataclass(frozen=True, slots=True, eq=False)
class TableLayout:
    """What the rows of a table are in one recording."""

    table: MessageTable
    codec: Codec | None
    """None where the recording has no such messages."""
    joints: tuple[int, ...] | None = None
    """The numbers of those that there are; all unless given."""

    @property
    def counts(self) -> tuple[str, ...]:
        """The whole numbers of a row beside those of `OPENING`."""
        return self.codec.kind.counts if self.codec else ()

    @property
    def scalars(self) -> tuple[str, ...]:
        """All that are no field."""
        return (*OPENING, *self.counts)

    @property
    def numbers(self) -> dict[str, list[Sequence[int]]]:
        """The fields, with the numbers along each axis, from 1."""
        if self.codec is None:
            return {}
        fields = self.codec.kind.fields
        return {
            name: [
                self.joints if self.joints and axis == "m" else range(1, size + 1)
                for axis, size in zip(fields[name].shape, shape, strict=True)
            ]
            for name, shape in self.codec.shapes.items()
        }

    @property
    def shapes(self) -> dict[str, Shape]:
        """The fields, with their shapes in numbers."""
        return {name: tuple(map(len, axes)) for name, axes in self.numbers.items()}

    @property
    def order(self) -> tuple[str, ...]:
        """What rows are sorted by, the last one first, as `numpy.lexsort` wants it."""
        return (*reversed(self.counts), "robot", "time_ns")

    @property
    def columns(self) -> list[str]:
        """The names of the columns where each number has one of its own."""
        fields = (indexed_names(name, axes) for name, axes in self.numbers.items())
        return [*self.scalars, *(column for field in fields for column in field)]

    def narrowed(self, rows: NDArray[np.void]) -> NDArray[np.void]:
        """Return rows of all joints with those that there are."""
        if self.joints is None:
            return rows
        found = np.empty(len(rows), self.dtype)
        for name in rows.dtype.names or ():
            values = rows[name]
            for axis, numbers in enumerate(self.numbers.get(name, ()), 1):
                values = values.take(np.array(numbers, np.intp) - 1, axis=axis)
            found[name] = values
        return found

    def expect_few_columns(self, path: object) -> None:
        """Raise `UnreadableError` where there are no rows, and no end of columns."""
        if (count := sum(map(prod, self.shapes.values()))) > MOST_UNSEEN:
            raise UnreadableError(
                f"{path}: {self.table.name}: there are none, but each would have {count} numbers"
            )

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The type of a row."""
        layout: list[tuple[Any, ...]] = [
            ("k", "u4"),
            ("time_ns", "i8"),
            ("t", "f8"),
            ("robot", "u4"),
        ]
        layout += [(name, "u4") for name in self.counts]
        return np.dtype(layout + [(name, "f8", shape) for name, shape in self.shapes.items()])


SAMPLES = MessageTable("samples", "sample", 0)
STATES = MessageTable("states", "state", 1)
AGENT_STATES = MessageTable("agent_states", "agent_state", 1)
MEASUREMENTS = MessageTable("measurements", "measurement", 1)
LINK_EVENTS = MessageTable("link_events", "link_event", 1)
_FURTHER = (AGENT_STATES, MEASUREMENTS, LINK_EVENTS)
MESSAGES = {table.name: table for table in (SAMPLES, STATES, *_FURTHER)}


def joints(reader: Reader) -> int:
    """Return m, the axes of each robot."""
    return about(reader).run.joints


def robots(reader: Reader) -> int:
    """Return n."""
    return about(reader).run.robots


def flat(values: NDArray[Any]) -> NDArray[Any]:
    """Return values (rows, …) as (rows, numbers), in the order of their columns."""
    return values.reshape(len(values), prod(values.shape[1:]))


def layout(
    types: RecordedTypes, table: MessageTable, joints: tuple[int, ...] | None = None
) -> TableLayout:
    """Return what the rows of a table are in a recording of some types, of all joints or some."""
    return TableLayout(table, types.codecs.get(table.kind), joints)


def recorded_tables(types: RecordedTypes) -> list[MessageTable]:
    """Return the tables that a recording has: samples and states, and others that it may have."""
    return [SAMPLES, STATES, *(table for table in _FURTHER if types.channels[table.kind])]


def rows(
    reader: Reader,
    tables: Sequence[MessageTable],
    of: Collection[int] | None = None,
    start_ns: int | None = None,
    end_ns: int | None = None,
) -> Iterator[tuple[MessageTable, NDArray[np.void]]]:
    """Yield rows of some tables, each with its own, in one pass over the file.

    They are those of all robots or some, with start_ns <= time_ns < end_ns, a chunk each, which
    holds whole ticks. Raises `UnreadableError` when a schema is none of a run's, or a message is
    not of its type, or has a number that is not finite.
    """
    types = recorded_types(reader)
    for messages in reader.columns(topics_of(reader, tables, of), start_ns, end_ns):
        for table in tables:
            found = rows_of(reader, types, table, messages, of)
            if found is not None:
                yield table, found


def topics_of(
    reader: Reader, tables: Sequence[MessageTable], of: Collection[int] | None = None
) -> set[str]:
    """Return the topics of some tables, of all robots or some."""
    n = robots(reader)
    topics = Topics.among(reader.topics.values(), n)
    return {
        topic
        for table in tables
        for topic in topics.all_of(
            table.kind, [i for i in range(table.first, n + 1) if of is None or i in of]
        )
    }


def rows_of(
    reader: Reader,
    types: RecordedTypes,
    table: MessageTable,
    messages: Columns,
    of: Collection[int] | None = None,
) -> NDArray[np.void] | None:
    """Return the rows of a table among messages, None if there are none; raises as `rows`.

    They are those of all robots or some: a topic may be of more.
    """
    mine = messages.on(types.channels[table.kind])
    if not len(mine.time):
        return None
    found = _rows(reader, layout(types, table), mine)
    if of is not None:
        found = found[np.isin(found["robot"], [*of])]
    return found if len(found) else None


def _rows(reader: Reader, of: TableLayout, mine: Columns) -> NDArray[np.void]:
    codec, dtype = of.codec, of.dtype
    assert codec is not None  # there are messages of it
    try:
        messages = codec.parsed(mine.payloads(codec.size))
    except (BusError, DamageError) as error:
        raise UnreadableError(f"{reader.path}: {of.table.name}: {error}") from error
    found = np.empty(len(messages), dtype)
    for name in dtype.names or ():
        found[name] = messages["time_ns"] / 1e9 if name == "t" else messages[name]
    order = np.lexsort([found[name] for name in of.order])
    whole = found.view(f"V{dtype.itemsize}")  # field by field it takes ten times as long
    return whole[order].view(dtype)


def samples(reader: Reader, start_ns: int | None = None) -> Iterator[NDArray[np.void]]:
    """Yield rows of k, time_ns, t, robot, and the fields of samples, from `start_ns` on."""
    return (found for _, found in rows(reader, [SAMPLES], start_ns=start_ns))


def states(reader: Reader, start_ns: int | None = None) -> Iterator[NDArray[np.void]]:
    """Yield rows of k, time_ns, t, robot, and the vectors of `nrs.State` (m,)."""
    return (found for _, found in rows(reader, [STATES], start_ns=start_ns))
