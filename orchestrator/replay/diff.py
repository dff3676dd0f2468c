"""What is not the same in two recordings: scenario fields, the first tick, and how far apart.

Whole recordings of the same digest have the same samples and states, and no message is read. That a
digest stands as it was written is what a file's checksums vouch for, not that a run wrote it: where
it was computed from the messages, as by `Reader(verify=True)`, it is said so. Else runs are
compared some ticks at once, message by message in total order. Distances are between the states,
and what agents keep, that both have of a robot at a time, in the same tick. No more than a chunk of
each is in memory.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from itertools import chain, repeat
from typing import Any, Literal

import numpy as np

from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.keys import kind_of
from nrs_cosim.bus.messages import Codec
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.replay.difference import ABSENT, Difference, Pairs, difference_in
from nrs_cosim.orchestrator.replay.distances import Array, Distance, Distances
from nrs_cosim.orchestrator.scenario.assets import Asset
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import tables_of
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.export.tables import AGENT_STATES, STATES, joints, robots, rows_of
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.container import Message
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.ticks import consecutive
from nrs_cosim.recordings.schemas import contents_of, recorded_types

MEASURED = {STATES: "", AGENT_STATES: "agent_"}
"""The tables that distances are of, and what stands before the names of their fields."""
COUNTED = ("sample", "state", "agent_state", "measurement")
"""The kinds of messages that enter the digest."""
Compared = Literal["messages", "computed digests", "stored digests"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """What is not the same in two recordings."""

    fields: Mapping[str, tuple[Any, Any]]
    """Of the scenario, by their names: both values, or `ABSENT`."""
    first: Difference | None
    """The first message that differs, or that one of them has not."""
    compared: Compared
    """What was: the digests where they are equal, of all messages here or as they are stored."""
    distances: tuple[Distance, ...] = ()
    """By robot and quantity; empty where digests were compared, or nothing is in common."""
    apart: Mapping[tuple[int, str], tuple[Array, Array]] = field(default_factory=dict)
    """By robot, of as many as were asked for, and quantity: times, s, and distances then."""
    why_not: str = ""
    """Why there are no distances after t = 0; empty where there are, or no states to measure."""
    schemas: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Of kinds of messages that have other fields in one than in the other: both, with shapes."""
    partial: tuple[str, ...] = ()
    """Which of the two, A and B, lack messages of their runs: nothing is known of these."""
    ends: tuple[str, int] | None = None
    """Which of the two ends first, and at which tick, where up to there both are the same."""

    @property
    def is_same(self) -> bool:
        """Whether both hold all of the same run."""
        same = not self.fields and not self.schemas
        return same and self.first is None and not self.partial

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "same": self.is_same,
            "compared": self.compared,
            "partial": list(self.partial),
            "fields": dict(self.fields),
            "schemas": dict(self.schemas),
            "first": asdict(self.first) if self.first else None,
            "ends": {"recording": self.ends[0], "tick": self.ends[1]} if self.ends else None,
            "distances": [asdict(distance) for distance in self.distances],
            "why_not": self.why_not,
        }


def compare(a: Reader, b: Reader, curves: int = 0) -> Comparison:
    """Compare two recordings; of the first `curves` robots all distances are kept."""
    for reader in (a, b):
        reader.expect_ticks("compare")
    fields = _fields_of(experiment_of(a), experiment_of(b))
    types_a, types_b = recorded_types(a), recorded_types(b)
    of_a, of_b = types_a.codecs, types_b.codecs
    types = {kind: (contents_of(of_a.get(kind)), contents_of(of_b.get(kind))) for kind in COUNTED}
    schemas = {kind: (one, other) for kind, (one, other) in types.items() if one != other}
    if a.digest is not None and a.digest == b.digest:
        compared: Compared = "computed digests" if a.computed and b.computed else "stored digests"
        return Comparison(fields, None, compared, schemas=schemas)
    first, ends, both = None, None, 0
    same_joints, n = joints(a) == joints(b), max(robots(a), robots(b))
    common = {
        table: _fields_in_common(of_a.get(table.kind), of_b.get(table.kind)) for table in MEASURED
    }
    distances = {
        table: Distances(n, names, MEASURED[table], curves)
        for table, names in common.items()
        if names and same_joints
    }
    pairs = Pairs(a.topics, b.topics)
    for in_a, in_b in _together(a, b):
        if first is None and (row := pairs.first(in_a, in_b)) is not None:
            was, now = pairs.at(in_a, in_b, row)
            _expect_sound(a, of_a, was)
            _expect_sound(b, of_b, now)
            first = difference_in(of_a, of_b, was, now)
            if not (len(in_a.time) and len(in_b.time)):
                here, name = (in_a, "B") if len(in_a.time) else (in_b, "A")
                ends = name, int(here.sequence[0]) - 1
        both += len(np.intersect1d(in_a.sequence, in_b.sequence))
        for table, of_table in distances.items():
            ours = rows_of(a, types_a, table, in_a)
            theirs = rows_of(b, types_b, table, in_b)
            if ours is not None and theirs is not None:
                of_table.add(ours, theirs)
    why_not = ""
    if not same_joints:
        why_not = f"robots have {joints(a)} joints in A, and {joints(b)} in B"
    elif both > 1 and not any(of_table.later for of_table in distances.values()):
        why_not = "no tick has times in common: sampling times differ"
    return Comparison(
        fields,
        first,
        "messages",
        tuple(sorted(chain(*(d.found() for d in distances.values())), key=lambda d: d.robot)),
        dict(chain(*(d.curves() for d in distances.values()))),
        why_not,
        schemas,
        tuple(name for name, reader in (("A", a), ("B", b)) if reader.digest is None),
        ends,
    )


def _expect_sound(reader: Reader, codecs: Mapping[str, Codec], message: Message | None) -> None:
    """Raise `UnreadableError` for a message that is not of its type."""
    if message is None:
        return
    try:
        codecs[kind_of(message[1])].decode([message[3]])
    except BusError as error:
        raise UnreadableError(f"{reader.path}: {error}") from error


def _fields_in_common(a: Codec | None, b: Codec | None) -> list[str]:
    """Return the fields that two message types have of the same shape."""
    if a is None or b is None:
        return []
    return [name for name, shape in a.shapes.items() if b.shapes.get(name) == shape]


def _counted(reader: Reader) -> Iterator[Columns]:
    """Yield the messages that enter the digest, of the ticks from 0 to the first missing one."""
    counted = {channel.topic for channel in reader.channels if channel.counted}
    numbers = [number for number, topic in reader.topics.items() if topic in counted]
    found = (messages.on(numbers) for messages in consecutive(reader))
    return (messages for messages in found if len(messages.time))


def _together(a: Reader, b: Reader) -> Iterator[tuple[Columns, Columns]]:
    """Yield what two recordings have of the same ticks, nothing of one that has ended."""
    nothing = Columns(b"", *(np.empty(0, kind) for kind in ("u2", "u4", "u8", "i8", "i8")))
    more_a, more_b = (chain(_counted(reader), repeat(nothing)) for reader in (a, b))
    rest_a, rest_b = next(more_a), next(more_b)
    while len(rest_a.time) or len(rest_b.time):
        last = min(int(rest.sequence[-1]) for rest in (rest_a, rest_b) if len(rest.time))
        yield rest_a.only(rest_a.sequence <= last), rest_b.only(rest_b.sequence <= last)
        rest_a, rest_b = (rest.only(rest.sequence > last) for rest in (rest_a, rest_b))
        rest_a = rest_a if len(rest_a.time) else next(more_a)
        rest_b = rest_b if len(rest_b.time) else next(more_b)


def _fields_of(a: Experiment, b: Experiment) -> dict[str, tuple[Any, Any]]:
    """Return what differs in two scenarios; a file is what it holds, wherever it was."""
    fields = dict(_fields(tables_of(a.text), tables_of(b.text)))
    for name in sorted(a.assets.keys() & b.assets.keys()):
        one, other = a.assets[name], b.assets[name]
        if one.sha256 == other.sha256 or one.source_sha256 == other.source_sha256:
            fields.pop(name, None)
        else:
            fields[name] = (_file(one), _file(other))
    return fields


def _file(asset: Asset) -> str:
    return f"{asset.name}, SHA-256 {asset.source_sha256}"


def _fields(a: Any, b: Any, name: str = "") -> Iterator[tuple[str, tuple[Any, Any]]]:
    """Yield the names and both values of what differs in two tables."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in sorted({*a, *b}):
            inner = f"{name}.{key}" if name else key
            yield from _fields(a.get(key, ABSENT), b.get(key, ABSENT), inner)
    elif a != b:
        yield name, (a, b)
