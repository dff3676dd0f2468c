"""A target that is an FMU must be continuously differentiable, its velocity the derivative.

Where its samples do not say so, it is sampled again, ever more often about the largest step of a
quantity. In what is smooth that step shrinks with the distance of the samples, h; what does not
shrink jumps, and a position jumps by more than its velocity can move it in h.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.orchestrator.scenario.samples import Array, VelocityMismatch, disagreement
from nrs_cosim.plant_fmu.errors import FmuError

FINER, ROUNDS = 4, 4
"""By how much samples come nearer in one round, and how often they do: 256 times in all."""
SHRUNK = 0.5

Sample = Callable[[Sequence[float]], tuple[Array, Array]]
"""Positions and velocities (s, m) at s times, s, the first of them 0."""
Sizes = Callable[[Array, Array, Array], Array]
"""Of the steps between s times, (s − 1,), from positions and velocities (s,) there."""


@dataclass(frozen=True, slots=True)
class _Track:
    """One axis of a motion at s times: arrays (s,)."""

    times: Array
    position: Array
    velocity: Array

    @property
    def reach(self) -> float:
        """How far its velocity can move it between the two times that are farthest apart."""
        return float(np.diff(self.times).max() * np.abs(self.velocity).max())


def expect_smooth(
    label: str, times: Sequence[float], positions: Array, velocities: Array, sample: Sample | None
) -> None:
    """Raise `FmuError` unless velocities are the derivatives of positions, both (s, m).

    Without a function that samples the FMU again, the error cannot say what is the matter.
    """
    found = disagreement(np.array(times), positions, velocities)
    if found is None:
        return
    try:
        why = _why(times[: found.row + 2], positions, velocities, found, sample)
    except CosimError:
        why = ""
    raise FmuError(
        f"{label}: velocity_{found.axis + 1} at t = {times[found.row]:g} s: expected "
        f"{found.expected:g} as the positions have it, within {found.tolerance:g}, got "
        f"{found.got:g}; " + (why or "take a shorter target.step, or name them in target.variables")
    )


def _why(
    times: Sequence[float],
    positions: Array,
    velocities: Array,
    found: VelocityMismatch,
    sample: Sample | None,
) -> str:
    """Return what samples that are nearer to one another say, and what to do then."""
    if sample is None:
        return ""
    axis, count = found.axis, len(times)
    track = _Track(np.array(times), positions[:count, axis], velocities[:count, axis])

    def again(at: Array) -> _Track:
        moved = sample(at.tolist())
        return _Track(at, moved[0][:, axis], moved[1][:, axis])

    no_target = "a target must be continuously differentiable"
    last = _nearest(track, _defects, again)
    if last and abs(np.diff(last.position)[0]) > max(2 * last.reach, _tiny(track)):
        return (
            f"position_{axis + 1} jumps{_from_to(last, last.position)}, as it does where an FMU "
            f"steps at times of its own; {no_target}"
        )
    last = _nearest(track, _changes, again)
    if last:
        return f"velocity_{axis + 1} jumps{_from_to(last, last.velocity)}; {no_target}"
    finer = _refined(track.times, range(count - 1))
    left = disagreement(finer, *sample(finer.tolist()))
    if left is None or left.apart < SHRUNK * found.apart:
        step = min(end - start for start, end in pairwise(times)) / FINER
        return f"take a shorter target.step: {step:g} s{'' if left is None else ' or less'}"
    return "name them in target.variables"


def _nearest(track: _Track, sizes_of: Sizes, again: Callable[[Array], _Track]) -> _Track | None:
    """Return the two samples between which there is a jump; None where there is none."""
    first = sizes_of(track.times, track.position, track.velocity)
    j, size = int(np.argmax(first)), float(first.max())
    among = range(j, j + 1)
    for _ in range(ROUNDS):
        track = again(_refined(track.times, among))
        among = range(j, j + FINER)
        sizes = sizes_of(track.times, track.position, track.velocity)
        j += int(np.argmax(sizes[among.start : among.stop]))
        among = range(j, j + 1)
    if sizes[j] <= SHRUNK * size:
        return None
    pair = slice(j, j + 2)
    return _Track(track.times[pair], track.position[pair], track.velocity[pair])


def _refined(times: Array, among: range) -> Array:
    """Return times (s,) with others between those of some intervals and the next."""
    parts = [
        np.linspace(times[j], times[j + 1], FINER, endpoint=False)
        if j in among
        else times[j : j + 1]
        for j in range(len(times) - 1)
    ]
    return np.concatenate([*parts, times[-1:]])


def _changes(_times: Array, _position: Array, velocity: Array) -> Array:
    return np.abs(np.diff(velocity))


def _defects(times: Array, position: Array, velocity: Array) -> Array:
    """Return how far each step of the position is from what the velocity makes of it."""
    moved = np.diff(times) * (velocity[:-1] + velocity[1:]) / 2
    return np.abs(np.diff(position) - moved)


def _tiny(track: _Track) -> float:
    """Return what may be rounding."""
    return 1e-9 * float(np.abs(track.position).max())


def _from_to(pair: _Track, values: Array) -> str:
    return f" from {values[0]:g} to {values[1]:g} at t = {pair.times.mean():.6g} s"
