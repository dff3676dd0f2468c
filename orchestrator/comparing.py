"""What is not the same in two recordings: scenario fields, the first tick, and how far apart.

Runs are compared tick by tick, message by message in total order. Distances are between the states
that both have of a robot at a time: |a − b| over all joints, its maximum, when that was, and its
root mean square.
"""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bus.messages import STATE, Codec
from bus.wire import Records
from orchestrator.clock import NS_PER_S
from orchestrator.replaying import ABSENT, Difference, difference_in
from orchestrator.running import past_of
from orchestrator.summary import scenario_text
from recordings.digest import Message
from recordings.reading import Reader
from recordings.tables import joints

QUANTITIES = STATE.vectors


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

    @property
    def is_same(self) -> bool:
        """Whether both hold the same run."""
        return not self.fields and self.first is None

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {**asdict(self), "same": self.is_same}


def compare(a: Reader, b: Reader) -> Comparison:
    """Compare two recordings."""
    fields = dict(_fields(tomllib.loads(scenario_text(a)), tomllib.loads(scenario_text(b))))
    first: Difference | None = None
    measured: dict[int, _Measured] = {}
    alike = joints(a) == joints(b)
    codec = Codec(STATE, joints(a))
    nothing: list[Message] = []
    for tick_a, tick_b in zip_longest(_ticks(a), _ticks(b), fillvalue=nothing):
        if first is None and tick_a != tick_b:
            was, now = next((was, now) for was, now in zip_longest(tick_a, tick_b) if was != now)
            first = difference_in(joints(a), joints(b), was, now)
        if alike and tick_a and tick_b:
            _measure(measured, _states(codec, tick_a), _states(codec, tick_b))
    distances = [
        distance for robot in sorted(measured) for distance in measured[robot].distances(robot)
    ]
    return Comparison(fields, first, tuple(distances))


class _Measured:
    """The distances of one robot so far, by quantity."""

    def __init__(self) -> None:
        size = len(QUANTITIES)
        self._count = 0
        self._largest, self._at, self._squares = np.zeros((3, size))

    def add(self, times: NDArray[np.uint64], distances: NDArray[np.float64]) -> None:
        """Take in distances (quantities, times) at some times, ns."""
        best = distances.argmax(axis=1)
        largest = distances[np.arange(len(best)), best]
        better = largest > self._largest
        self._largest[better] = largest[better]
        self._at[better] = times[best[better]] / NS_PER_S
        self._squares += (distances**2).sum(axis=1)
        self._count += len(times)

    def distances(self, robot: int) -> Iterator[Distance]:
        """Yield what they come to."""
        rms = np.sqrt(self._squares / max(self._count, 1))
        for i, quantity in enumerate(QUANTITIES):
            numbers = map(float, (self._largest[i], self._at[i], rms[i]))
            yield Distance(robot, quantity, *numbers)


def _ticks(reader: Reader) -> Iterator[list[Message]]:
    """Yield the messages of each tick that enter the digest."""
    counted = {channel.topic for channel in reader.channels if channel.counted}
    for tick in past_of(reader):
        yield [message for message in tick if message[1] in counted]


def _states(codec: Codec, tick: list[Message]) -> Records:
    return codec.decode([data for _, topic, _, data in tick if topic.startswith("state/")])


def _measure(measured: dict[int, _Measured], a: Records, b: Records) -> None:
    """Take in the states of one tick, of what both have."""
    keys_a, keys_b = (np.stack([r["time_ns"], r["robot"]], axis=1) for r in (a, b))
    rows = {tuple(key): row for row, key in enumerate(keys_b.tolist())}
    pairs = [(i, rows[tuple(key)]) for i, key in enumerate(keys_a.tolist()) if tuple(key) in rows]
    if not pairs:
        return
    ours, theirs = np.array(pairs).T
    apart = np.stack(
        [np.linalg.norm(a[name][ours] - b[name][theirs], axis=1) for name in QUANTITIES]
    )
    robots, times = a["robot"][ours], a["time_ns"][ours]
    for robot in np.unique(robots).tolist():
        mine = robots == robot
        measured.setdefault(robot, _Measured()).add(times[mine], apart[:, mine])


def _fields(a: Any, b: Any, name: str = "") -> Iterator[tuple[str, tuple[Any, Any]]]:
    """Yield the names and both values of what differs in two tables."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in sorted({*a, *b}):
            inner = f"{name}.{key}" if name else key
            yield from _fields(a.get(key, ABSENT), b.get(key, ABSENT), inner)
    elif a != b:
        yield name, (a, b)
