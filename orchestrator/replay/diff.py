"""What is not the same in two recordings: scenario fields, the first tick, and how far apart.

Runs are compared tick by tick, message by message in total order. Distances are between the states
that both have of a robot at a time, in the same tick: |a − b| over all joints, its maximum, when
that was, and its root mean square.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import NS_PER_S
from nrs_cosim.bus.keys import kind_of
from nrs_cosim.bus.messages import STATE, Codec
from nrs_cosim.bus.validation import Records
from nrs_cosim.orchestrator.engine.run import past_of
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.replay.difference import ABSENT, Difference, difference_in
from nrs_cosim.orchestrator.scenario.assets import Asset
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import tables_of
from nrs_cosim.recordings.export.tables import joints
from nrs_cosim.recordings.mcap.container import Message
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.schemas import contents_of, recorded_types

QUANTITIES = tuple(STATE.fields)
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

    times: Mapping[int, Array]
    """Of each robot the times of its states that both have, s."""
    apart: Mapping[int, Array]
    """And how far apart they are then, (times, quantities)."""
    why_not: str
    """Why there are no distances after t = 0; empty where there are, or no states to measure."""
    schemas: Mapping[str, tuple[str, str]]
    """Of kinds of messages that have other fields in one than in the other: both, with shapes."""
    partial: tuple[str, ...] = ()
    """Which of the two, A and B, lack messages of their runs: nothing is known of these."""

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
    measured: defaultdict[int, list[tuple[Array, Array]]] = defaultdict(list)
    of_a, of_b = recorded_types(a).codecs, recorded_types(b).codecs
    types = {kind: (contents_of(of_a.get(kind)), contents_of(of_b.get(kind))) for kind in COUNTED}
    schemas = {kind: (one, other) for kind, (one, other) in types.items() if one != other}
    alike = joints(a) == joints(b)
    codec = of_a["state"]
    nothing: list[Message] = []
    both = 0
    for tick_a, tick_b in zip_longest(_ticks(a), _ticks(b), fillvalue=nothing):
        if first is None and tick_a != tick_b:
            pair = next((one, two) for one, two in zip_longest(tick_a, tick_b) if one != two)
            first = difference_in(of_a, of_b, *pair)
        both += bool(tick_a and tick_b)
        if alike and tick_a and tick_b:
            for robot, *part in _apart(_states(codec, tick_a), _states(codec, tick_b)):
                measured[robot].append((part[0], part[1]))
    times = {robot: np.concatenate([t for t, _ in parts]) for robot, parts in measured.items()}
    apart = {robot: np.concatenate([d for _, d in parts]) for robot, parts in measured.items()}
    found = (d for robot in sorted(times) for d in _distances(robot, times[robot], apart[robot]))
    why_not = ""
    if not alike:
        why_not = f"robots have {joints(a)} joints in A, and {joints(b)} in B"
    elif both > 1 and not any(t[-1] > 0 for t in times.values()):
        why_not = "no tick has times in common: sampling times differ"
    partial = tuple(name for name, reader in (("A", a), ("B", b)) if reader.digest is None)
    return Comparison(fields, first, tuple(found), times, apart, why_not, schemas, partial)


def _distances(robot: int, times: Array, apart: Array) -> Iterator[Distance]:
    """Yield what the distances of one robot come to, by quantity."""
    rms = np.sqrt(np.mean(apart**2, axis=0))
    for i, quantity in enumerate(QUANTITIES):
        row = int(apart[:, i].argmax())
        yield Distance(robot, quantity, *map(float, (apart[row, i], times[row], rms[i])))


def _ticks(reader: Reader) -> Iterator[list[Message]]:
    """Yield the messages of each tick that enter the digest."""
    counted = {channel.topic for channel in reader.channels if channel.counted}
    for tick in past_of(reader):
        yield [message for message in tick if message[1] in counted]


def _states(codec: Codec, tick: list[Message]) -> Records:
    return codec.decode([data for _, topic, _, data in tick if kind_of(topic) == "state"])


def _apart(a: Records, b: Records) -> Iterator[tuple[int, Array, Array]]:
    """Yield of each robot the times that both have in a tick, s, and the distances then."""
    keys_a, keys_b = (
        list(zip(r["time_ns"].tolist(), r["robot"].tolist(), strict=True)) for r in (a, b)
    )
    rows = {key: row for row, key in enumerate(keys_b)}
    pairs = [(i, rows[key]) for i, key in enumerate(keys_a) if key in rows]
    if not pairs:
        return
    ours, theirs = np.array(pairs).T
    apart = np.stack(
        [np.linalg.norm(a[name][ours] - b[name][theirs], axis=1) for name in QUANTITIES], axis=1
    )
    robots, times = a["robot"][ours], a["time_ns"][ours] / NS_PER_S
    for robot in np.unique(robots).tolist():
        mine = robots == robot
        yield robot, times[mine], apart[mine]


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
