"""The steady state is the last fifth of a run: how far the estimates and the robots are off there.

ε̄_i = ε_i − ε_0 and ῡ_i = υ_i − υ_0 are taken at the sampling times, left limits, in the ∞-norm;
e_i = q_i − ε_0 and ė_i = q̇_i − υ_0 on the output grid, in the 2-norm (paper, after equation 2.1).
Both are of the states, where ε_i and υ_i are what a robot follows: samples are but those that were
sent, and one that sends only when it must would be judged by its worst moments, or by none.
Robots that lie are left out: nobody expects them to follow the target.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.plurals import numbered
from nrs_cosim.recordings.export.tables import STATES, robots, rows
from nrs_cosim.recordings.mcap.reader import Reader

Array = NDArray[np.float64]
TargetAt = Callable[[Array], tuple[Array, Array]]
"""Position and velocity (rows, m) of the target at times in s (rows,)."""


@dataclass(frozen=True, slots=True)
class SteadyState:
    """Suprema over honest robots and the last fifth of a run; None of what was not recorded."""

    position_estimate: float | None = None
    """sup ‖ε̄_i(t_k)‖∞"""
    velocity_estimate: float | None = None
    """sup ‖ῡ_i(t_k)‖∞"""
    position_tracking: float | None = None
    """sup ‖e_i‖₂"""
    velocity_tracking: float | None = None
    """sup ‖ė_i‖₂"""
    times_ns: tuple[int, int, int, int] = (0, 0, 0, 0)
    """When each of the four was reached first, ns."""
    size: float = 0.0
    """The largest position or velocity of an estimate or a robot: what rounding is relative to."""


QUANTITIES = ("position_estimate", "velocity_estimate", "position_tracking", "velocity_tracking")
"""The fields of `SteadyState` that are measured."""


class Meter:
    """Measures the steady state by states that come in the order of their times, in whole ticks."""

    def __init__(self, target_at: TargetAt, byzantine: Sequence[int], since_ns: int) -> None:
        """Measure what is from `since_ns` on against a target, of all robots but some."""
        self._target_at, self._byzantine, self._since = target_at, byzantine, since_ns
        self._most, self._times, self._size = np.full(4, -np.inf), np.zeros(4, np.int64), 0.0

    @np.errstate(all="ignore")  # what is not finite is measured as such
    def take(self, states: NDArray[np.void]) -> None:
        """Take the next states."""
        kept = (states["time_ns"] >= self._since) & ~np.isin(states["robot"], self._byzantine)
        part = states[kept]
        position, velocity = self._target_at(part["time_ns"] / 1e9)
        self._note(2, part["position"] - position, 2, part["time_ns"])
        self._note(3, part["velocity"] - velocity, 2, part["time_ns"])
        then = at_sampling_times(part)
        sampled, names = part[then], ("reference_position", "reference_velocity")
        self._note(0, sampled[names[0]] - position[then], np.inf, sampled["time_ns"])
        self._note(1, sampled[names[1]] - velocity[then], np.inf, sampled["time_ns"])
        for values in (part["position"], part["velocity"], *(sampled[name] for name in names)):
            self._size = max(self._size, float(np.abs(values).max(initial=0.0)))

    def _note(self, quantity: int, errors: Array, order: float, time_ns: NDArray[np.int64]) -> None:
        norms = np.linalg.norm(errors, order, axis=1)
        if len(norms) and norms.max() > self._most[quantity]:
            row = int(norms.argmax())
            self._most[quantity], self._times[quantity] = norms[row], time_ns[row]

    def found(self) -> SteadyState:
        """Return what was measured so far."""
        (a, b, c, d) = (value if value >= 0 else None for value in self._most.tolist())
        (e, f, g, h) = self._times.tolist()
        return SteadyState(a, b, c, d, (e, f, g, h), self._size)


def steady_state(reader: Reader, target_at: TargetAt, byzantine: Sequence[int] = ()) -> SteadyState:
    """Measure the steady state of a recording against its target, of all robots but some."""
    end = reader.end_ns or 0
    meter = Meter(target_at, byzantine, end - end // 5)
    for _, states in rows(reader, [STATES], start_ns=end - end // 5):
        meter.take(states)
    return meter.found()


class SaturationMeter:
    """Measures in which part of its states each robot's effort is at its limits."""

    def __init__(self, limits: Mapping[int, Array], n: int) -> None:
        """Know the limits (m,) of some of n robots."""
        self._limits = limits
        m = len(next(iter(limits.values()), ()))
        self._every = np.full((n + 1, m), np.nan)
        for robot, limit in limits.items():
            self._every[robot] = limit
        self._at, self._count = np.zeros_like(self._every), np.zeros(n + 1)

    def take(self, states: NDArray[np.void]) -> None:
        """Take some states, in any order."""
        if self._limits:
            whose = states["robot"]
            np.add.at(self._at, whose, np.abs(states["effort"]) >= self._every[whose])
            np.add.at(self._count, whose, 1)

    def found(self) -> dict[int, Array]:
        """Return the parts so far, (m,), of each robot that has limits."""
        return {robot: self._at[robot] / max(self._count[robot], 1) for robot in self._limits}


def saturation(reader: Reader, limits: Mapping[int, Array]) -> dict[int, Array]:
    """Return in which part of its states each robot's effort is at its limits (m,), by joint."""
    meter = SaturationMeter(limits, robots(reader))
    for _, states in rows(reader, [STATES], limits):
        meter.take(states)
    return meter.found()


def saturation_in_words(found: Mapping[int, Iterable[float]], joints: Sequence[str]) -> str:
    """Say how often torques are at their limits, of robots that have some; joints by name."""
    parts = [
        (part, robot, joint)
        for robot, at in found.items()
        for joint, part in zip(joints, at, strict=True)
        if part > 0
    ]
    if not parts:
        return "no torque is at its limit in any state"
    share, whose, joint = max(parts, key=lambda part: part[0])
    robots = numbered("robot", sorted({robot for _, robot, _ in parts}), 8)
    return (
        f"torques of {robots} are at their limits, in up to {100 * share:.3g} % of the states: "
        f"{joint} of robot {whose}"
    )


def errors_by_tick(
    reader: Reader, target_at: TargetAt, start_ns: int | None = None
) -> Iterator[tuple[NDArray[np.int64], Array]]:
    """Yield k, (t,), and the estimates' errors ε̄ and ῡ at t_k, (t, 2, n, m), chunk by chunk.

    They are of each tick that is whole.
    """
    n = robots(reader)
    for _, part in rows(reader, [STATES], start_ns=start_ns):
        mine = part[at_sampling_times(part)]
        _, counts = np.unique(mine["k"], return_counts=True)
        mine = mine[np.repeat(counts == n, counts)].reshape(-1, n)
        if len(mine):
            target = np.stack(target_at(mine["t"][:, 0]), axis=1)
            states = [mine["reference_position"], mine["reference_velocity"]]
            yield mine["k"][:, 0].astype(np.int64), np.stack(states, axis=1) - target[:, :, None]


def at_sampling_times(states: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return which states, of whole ticks, are of a sampling time from t_1 on: a tick's last.

    They are in the order of their times, so that a tick's last time is where its states end.
    """
    k, time_ns = states["k"], states["time_ns"]
    ends = np.flatnonzero(np.append(k[1:] != k[:-1], True)[: len(k)])
    last = np.repeat(time_ns[ends], np.diff(ends, prepend=-1))
    found: NDArray[np.bool_] = (time_ns == last) & (k > 0)
    return found
