"""What is not the same in two recordings: scenario fields, the first tick, and how far apart.

Runs are compared tick by tick, message by message in total order. Distances are between the states,
and what agents keep, that both have of a robot at a time, in the same tick: |a − b| over all
numbers of a field, its maximum, when that was, and its root mean square.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import NS_PER_S
from nrs_cosim.bus.keys import kind_of
from nrs_cosim.bus.messages import Codec
from nrs_cosim.bus.validation import Records
from nrs_cosim.orchestrator.engine.run import past_of
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.replay.difference import ABSENT, Difference, difference_in
from nrs_cosim.orchestrator.scenario.assets import Asset
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import tables_of
from nrs_cosim.recordings.export.tables import flat, joints
from nrs_cosim.recordings.mcap.container import Message
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.schemas import contents_of, recorded_types

MEASURED = {"state": "", "agent_state": "agent_"}
"""What distances are of, and what stands before the names of its fields."""
COUNTED = ("sample", "state", "agent_state", "measurement")
"""The kinds of messages that enter the digest."""
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Distance:
    """How far apart one quantity of one robot is in two recordings, in its unit."""

    robot: int
    quantity: str
    largest: float
    at: float
    """s: when it was largest."""
    rms: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """What is not the same in two recordings."""

    fields: Mapping[str, tuple[Any, Any]]
    """Of the scenario, by their names: both values, or `ABSENT`."""
    first: Difference | None
    """The first message that differs, or that one of them has not."""
    distances: tuple[Distance, ...]
    """By robot and quantity; empty when they have no states in common."""

    apart: Mapping[tuple[int, str], tuple[Array, Array]]
    """By robot and quantity: the times that both have, s, and how far apart they are then."""
    why_not: str
    """Why there are no distances after t = 0; empty where there are, or no states to measure."""
    schemas: Mapping[str, tuple[str, str]]
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
            "partial": list(self.partial),
            "fields": dict(self.fields),
            "schemas": dict(self.schemas),
            "first": asdict(self.first) if self.first else None,
            "ends": {"recording": self.ends[0], "tick": self.ends[1]} if self.ends else None,
            "distances": [asdict(distance) for distance in self.distances],
            "why_not": self.why_not,
        }


def compare(a: Reader, b: Reader) -> Comparison:
    """Compare two recordings."""
    for reader in (a, b):
        reader.expect_ticks("compare")
    was, now = experiment_of(a), experiment_of(b)
    fields = _fields_of(was, now)
    first: Difference | None = None
    measured: defaultdict[tuple[int, str], list[Array]] = defaultdict(list)
    of_a, of_b = recorded_types(a).codecs, recorded_types(b).codecs
    types = {kind: (contents_of(of_a.get(kind)), contents_of(of_b.get(kind))) for kind in COUNTED}
    schemas = {kind: (one, other) for kind, (one, other) in types.items() if one != other}
    same_joints = joints(a) == joints(b)
    names = {kind: _fields_in_common(of_a.get(kind), of_b.get(kind)) for kind in MEASURED}
    nothing: list[Message] = []
    both, ends = 0, None
    for k, (tick_a, tick_b) in enumerate(zip_longest(_ticks(a), _ticks(b), fillvalue=nothing)):
        if first is None and tick_a != tick_b:
            pair = next((one, two) for one, two in zip_longest(tick_a, tick_b) if one != two)
            first = difference_in(of_a, of_b, *pair)
            if not (tick_a and tick_b):
                ends = ("B" if tick_a else "A"), k - 1
        both += bool(tick_a and tick_b)
        if same_joints and tick_a and tick_b:
            for kind, those in names.items():
                if those:
                    tables = _records(kind, of_a[kind], tick_a), _records(kind, of_b[kind], tick_b)
                    for robot, part in _apart(*tables, those):
                        measured[robot, kind].append(part)
    apart = {}
    for robot, kind in sorted(measured, key=lambda of: of[0]):
        times, *distances = np.concatenate(measured[robot, kind], axis=1)
        for name, of_it in zip(names[kind], distances, strict=True):
            apart[robot, MEASURED[kind] + name] = times, of_it
    found = [_distance(*of, *apart[of]) for of in apart]
    why_not = ""
    if not same_joints:
        why_not = f"robots have {joints(a)} joints in A, and {joints(b)} in B"
    elif both > 1 and not any(times[-1] > 0 for times, _ in apart.values()):
        why_not = "no tick has times in common: sampling times differ"
    partial = tuple(name for name, reader in (("A", a), ("B", b)) if reader.digest is None)
    return Comparison(fields, first, tuple(found), apart, why_not, schemas, partial, ends)


def _fields_in_common(a: Codec | None, b: Codec | None) -> list[str]:
    """Return the fields that two message types have of the same shape."""
    if a is None or b is None:
        return []
    return [name for name, shape in a.shapes.items() if b.shapes.get(name) == shape]


def _distance(robot: int, quantity: str, times: Array, apart: Array) -> Distance:
    """Return what the distances of a robot's quantity come to."""
    row, rms = int(apart.argmax()), np.sqrt(np.mean(apart**2))
    return Distance(robot, quantity, *map(float, (apart[row], times[row], rms)))


def _ticks(reader: Reader) -> Iterator[list[Message]]:
    """Yield the messages of each tick that enter the digest."""
    counted = {channel.topic for channel in reader.channels if channel.counted}
    for tick in past_of(reader):
        yield [message for message in tick if message[1] in counted]


def _records(kind: str, codec: Codec, tick: list[Message]) -> Records:
    return codec.decode([data for _, topic, _, data in tick if kind_of(topic) == kind])


def _apart(a: Records, b: Records, names: Sequence[str]) -> Iterator[tuple[int, Array]]:
    """Yield of each robot the times that both have in a tick, s, above distances by field."""
    keys_a, keys_b = (
        list(zip(r["time_ns"].tolist(), r["robot"].tolist(), strict=True)) for r in (a, b)
    )
    rows = {key: row for row, key in enumerate(keys_b)}
    pairs = [(i, rows[key]) for i, key in enumerate(keys_a) if key in rows]
    if not pairs:
        return
    ours, theirs = np.array(pairs).T
    robots, times = a["robot"][ours], a["time_ns"][ours] / NS_PER_S
    differences = (flat(a[name][ours] - b[name][theirs]) for name in names)
    apart = np.stack([times, *(np.linalg.norm(off, axis=1) for off in differences)])
    for robot in np.unique(robots).tolist():
        yield robot, apart[:, robots == robot]


def _fields_of(a: Experiment, b: Experiment) -> dict[str, tuple[Any, Any]]:
    """Return what differs in two scenarios; a file is what it holds, wherever it was."""
    fields = dict(_fields(tables_of(a.text), tables_of(b.text)))
    for field in sorted(a.assets.keys() & b.assets.keys()):
        one, other = a.assets[field], b.assets[field]
        if one.sha256 == other.sha256 or one.source_sha256 == other.source_sha256:
            fields.pop(field, None)
        else:
            fields[field] = (_file(one), _file(other))
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
