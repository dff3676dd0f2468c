"""What a report draws of a recording, read in one pass over its messages.

What was not recorded is NaN, so a recording that is cut or damaged has gaps and no guesses. Of
many robots some are drawn, spread evenly, and the envelopes are over all of them. Estimates are
those in the states at t_k, whether they were sent or not.
"""

from collections import Counter
from dataclasses import dataclass, field
from itertools import takewhile
from math import prod
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import Clock
from nrs_cosim.bus.fields import column_names
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.export.tables import (
    AGENT_STATES,
    LINK_EVENTS,
    STATES,
    flat,
    joints,
    robots,
    rows_of,
)
from nrs_cosim.recordings.link_counts import kinds
from nrs_cosim.recordings.mcap.container import END_FIELDS, Status
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import (
    SaturationMeter,
    SteadyState,
    at_sampling_times,
    steady_state,
)
from nrs_cosim.recordings.report.subject import Subject
from nrs_cosim.recordings.robots.skeleton import Skeleton, skeletons
from nrs_cosim.recordings.schemas import RecordedTypes, about, recorded_types
from nrs_cosim.recordings.units import field_unit

Array = NDArray[np.float64]
MOST_DRAWN = 24
"""Robots."""
MOST_NUMBERS = 12
"""Of a field that is no joints' each of which is drawn."""
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Of robots, at or below the edges of bands."""


@dataclass(frozen=True, slots=True, eq=False)
class Envelope:
    """The largest of a norm over all honest robots, at times (rows,) in s."""

    t: Array
    largest: Array


@dataclass(frozen=True, slots=True, eq=False)
class LinkEvents:
    """What links did to samples, (rows,) each, in the order of the recording."""

    k: NDArray[np.int64]
    source: NDArray[np.int64]
    robot: NDArray[np.int64]
    kind: NDArray[np.int64]
    """Which of `link_counts.KINDS`."""


@dataclass(frozen=True, slots=True, eq=False)
class AgentField:
    """What agents keep in one field right after t_k; of many numbers, how large they are."""

    labels: tuple[str, ...]
    """Of each number that is drawn, with its unit where that is known."""
    doc: str
    by_joint: bool
    values: Array
    """(K, r, labels)"""


@dataclass(frozen=True, slots=True, eq=False)
class Story:
    """A recording, and the scenario that it came from."""

    subject: Subject
    name: str
    file: str
    """The name of its file, without the ending."""
    status: Status
    reason: str
    digest: str | None
    damage: tuple[str, ...]
    ticks: int
    planned: int
    n: int
    m: int
    seed: int
    versions: dict[str, str]
    ending: dict[str, str]
    """What the run said at its end beside how it ended."""
    counts: dict[str, int]
    """Messages by the name of their schema."""
    drawn: NDArray[np.intp]
    """(r,) the robots that are drawn, ascending."""
    t: Array
    """(T,) the output times, s."""
    t_k: Array
    """(K,) the sampling times from t_1 on, s."""
    skeletons: tuple[Skeleton, ...]
    """(r,) how they are drawn."""
    vectors: dict[str, Array]
    """(T, r, m) of the joints and of the estimates that they follow: `VECTORS`."""
    spreads: dict[str, Array]
    """(T, m, 5) of `VECTORS`: the least, the quartiles and the largest of all honest robots.

    Empty where all robots are drawn one by one."""
    target: dict[str, Array]
    """(T, m) position and velocity."""
    agents: dict[str, AgentField]
    """By the fields that agents keep beside their estimates."""
    envelopes: dict[str, Envelope]
    """By the fields of `SteadyState`, in the norms of `measuring`."""
    link_events: LinkEvents
    steady: SteadyState
    saturation: dict[int, Array]
    """(m,) of each robot whose torques have limits: the part of its states that is at them."""
    verdicts: dict[str, str] = field(default_factory=dict)
    """By the fields of `SteadyState`: whether a measurement is within what is proven of it."""

    close_up: float = 0.0
    """s before the end that are drawn as finely as the whole."""

    def close(self, t: Array) -> int:
        """Return how many of some times are in the close-up."""
        return int((t > t[-1] - self.close_up).sum()) if self.close_up and len(t) else 0

    @property
    def seconds(self) -> float:
        """The simulated time up to when something was recorded."""
        return float(self.t_k[-1]) if len(self.t_k) else 0.0


VECTORS = ("position", "velocity", "reference_position", "reference_velocity")


def read_story(reader: Reader, subject: Subject) -> Story:
    """Read all that a report draws of a recording."""
    said = about(reader)
    n, m = robots(reader), joints(reader)
    end = -1 if reader.end_ns is None else reader.end_ns
    drawn = np.unique(np.linspace(1, n, min(n, MOST_DRAWN)).astype(np.intp))
    row_of = np.full(n + 1, -1)
    row_of[drawn] = np.arange(len(drawn))
    sampled, output_times = _times(subject.times, end)
    t_k, t = sampled / 1e9, output_times / 1e9
    vectors = {name: np.full((len(t), len(drawn), m), np.nan) for name in VECTORS}
    largest = {
        "position_estimate": np.full(len(t_k), -1.0),
        "velocity_estimate": np.full(len(t_k), -1.0),
        "position_tracking": np.full(len(t), -1.0),
        "velocity_tracking": np.full(len(t), -1.0),
    }
    spreads = {name: np.full((len(t), m, 5), np.nan) for name in VECTORS if len(drawn) < n}
    counts: Counter[str] = Counter()
    saturation = SaturationMeter(subject.torque_limits, n)
    met: list[NDArray[np.int64]] = []

    def note(name: str, at: NDArray[np.int64], errors: Array, order: float) -> None:
        np.maximum.at(largest[name], at, np.linalg.norm(errors, order, axis=1))

    types = recorded_types(reader)
    agents = _agent_fields(types, subject, len(t_k), len(drawn))
    schemas = {channel.topic: channel.schema_name for channel in reader.channels}
    for messages in reader.columns():
        numbers, found = np.unique(messages.channel, return_counts=True)
        for number, count in zip(numbers.tolist(), found.tolist(), strict=True):
            counts[schemas[reader.topics[number]]] += count
        if (table := rows_of(reader, types, STATES, messages)) is not None:
            saturation.take(table)
            at = _places(reader, output_times, table["time_ns"])
            rows = row_of[table["robot"]]
            shown = rows >= 0
            for name, array in vectors.items():
                array[at[shown], rows[shown]] = table[name][shown]
            honest = ~np.isin(table["robot"], subject.byzantine)
            table, at = table[honest], at[honest]
            for name, spread in spreads.items():
                _spread(spread, at, table[name])
            position, velocity = subject.target_at(table["t"])
            note("position_tracking", at, table["position"] - position, 2)
            note("velocity_tracking", at, table["velocity"] - velocity, 2)
            then = at_sampling_times(table)
            at = _places(reader, sampled, table["time_ns"][then])
            for name, off in (("position", position), ("velocity", velocity)):
                errors = table[f"reference_{name}"][then] - off[then]
                note(f"{name}_estimate", at, errors, np.inf)
        if (table := rows_of(reader, types, AGENT_STATES, messages)) is not None:
            at, rows = _places(reader, sampled, table["time_ns"]), row_of[table["robot"]]
            shown = rows >= 0
            for name, kept in agents.items():
                numbers_of = flat(table[name][shown])
                if numbers_of.shape[1] > MOST_NUMBERS:
                    numbers_of = np.linalg.norm(numbers_of, axis=1)[:, None]
                kept.values[at[shown], rows[shown]] = numbers_of
        if (table := rows_of(reader, types, LINK_EVENTS, messages)) is not None:
            met.append(_met(table))
    position, velocity = subject.target_at(t)
    return Story(
        subject=subject,
        name=said.run.name,
        file=Path(reader.path).stem,
        status=reader.status,
        reason=reader.reason,
        digest=reader.digest,
        damage=tuple(reader.damage),
        ticks=reader.ticks,
        planned=said.run.ticks,
        n=n,
        m=m,
        seed=said.run.seed,
        versions=dict(said.versions),
        ending={name: said for name, said in reader.end.items() if name not in END_FIELDS},
        counts=dict(counts),
        drawn=drawn,
        t=t,
        t_k=t_k,
        skeletons=skeletons(reader, drawn.tolist(), m),
        vectors=vectors,
        spreads=spreads,
        target={"position": position, "velocity": velocity},
        agents=agents,
        envelopes={
            name: Envelope(
                t if name.endswith("tracking") else t_k, np.where(norms < 0, np.nan, norms)
            )
            for name, norms in largest.items()
        },
        link_events=LinkEvents(*np.concatenate([np.empty((4, 0), np.int64), *met], axis=1)),
        steady=steady_state(reader, subject.target_at, subject.byzantine),
        saturation=saturation.found(),
    )


def _spread(spread: Array, at: NDArray[np.intp], values: Array) -> None:
    """Note how robots are spread at the times (rows,) that values (rows, m) are of."""
    order = np.argsort(at, kind="stable")
    times, begins = np.unique(at[order], return_index=True)
    for time, of_robots in zip(times.tolist(), np.split(values[order], begins[1:]), strict=True):
        spread[time] = np.quantile(of_robots, SHARES, axis=0).T


def _agent_fields(
    types: RecordedTypes, subject: Subject, ticks: int, robots: int
) -> dict[str, AgentField]:
    """Return what agents keep, with gaps in place of the numbers."""
    codec, found = types.codecs.get(AGENT_STATES.kind), {}
    for name, shape in codec.shapes.items() if codec else ():
        assert codec
        kept = codec.kind.fields[name]
        by_joint = kept.shape == ("m",)
        if by_joint:
            labels = [f"{name}, {joint}" for joint in subject.joints]
        elif prod(shape) <= MOST_NUMBERS:
            labels = column_names(name, shape)
        else:
            labels = [f"‖{name}‖₂"]
        coordinates = subject.units if by_joint else [subject.unit] * len(labels)
        units = [field_unit(name, kept, coordinate) for coordinate in coordinates]
        labels = [
            f"{label} ({unit})" if unit else label
            for label, unit in zip(labels, units, strict=True)
        ]
        values = np.full((ticks, robots, len(labels)), np.nan)
        found[name] = AgentField(tuple(labels), kept.doc, by_joint, values)
    return found


def _times(times: Clock, end: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the sampling times from t_1 on and the output times, ns, up to an end."""
    ticks = range(times.ticks + 1)
    sampled = takewhile(lambda time: time <= end, (times.t(k) for k in ticks[1:]))
    outputs = (time for k in ticks for time in times.outputs(k))
    output = takewhile(lambda time: time <= end, outputs)
    return np.fromiter(sampled, np.int64), np.fromiter(output, np.int64)


def _places(reader: Reader, grid: NDArray[np.int64], times: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return where times are in a grid; `UnreadableError` for one that is none of the run's."""
    at = np.searchsorted(grid, times)
    off = np.append(grid, -1)[at] != times
    if off.any():
        time = float(times[off][0]) / 1e9
        raise UnreadableError(f"{reader.path}: a message at t = {time:g} s: the run has none then")
    return at


def _met(table: NDArray[np.void]) -> NDArray[np.int64]:
    """Return k, source, robot and kind of faults, (4, rows)."""
    found = [table["k"], table["source"], table["robot"], kinds(table)]
    return np.stack(found).astype(np.int64)
