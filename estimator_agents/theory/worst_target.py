"""The target that attains the worst case at a sampling time, as a motion through samples.

Its acceleration is that of `worst_case.worst_motion`, constant in each cell, but for short ramps in
place of its jumps: so it is piecewise linear, the position is a C² cubic spline through its values
where a ramp begins and ends, and no other is (not-a-knot, for both ends go straight). Averages over
a ramp are those of the jump, so that neither speed nor acceleration is more than it was.
"""

from dataclasses import dataclass
from math import ceil, log

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import as_array, identity_like
from nrs_cosim.estimator_agents.theory.estimates import worst
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.transient import ticks_until
from nrs_cosim.estimator_agents.theory.worst_case import (
    ErrorRecursion,
    attained,
    responses,
    worst_case_of,
    worst_motion,
)

Array = NDArray[np.float64]

PERIODS = 200_000
"""Sampling periods of the past that are looked at, at most."""
LEFT_OUT = 1e-3
"""The part of the worst case that is left to what was longer ago than the motion begins."""
FORGOTTEN = 1e-6
"""What is left of a run's initial error at the sampling time, relative."""
GRID = 256
"""Parts of a period, in which samples lie: were two nearer, rounding would bend the spline."""
RAMP = 4
"""How many of these there are at least from one ramp to the next; each takes two."""
NEXT_TO_NOTHING = 1e-7
"""The part of the largest acceleration that is rounding where it is all that changes."""
WITHIN = 1 - 1e-6
"""By which speed and acceleration are within γ1 and γ2, for what rounding does."""


@dataclass(frozen=True, slots=True, eq=False)
class WorstTarget:
    """A motion on one axis, and what it does."""

    robot: int
    """Whose estimate it is, from 1."""
    tick: int
    """k, when its error is the worst case."""
    bound: float
    """The worst case."""
    times: Array
    """(s,) s, from 0 to two periods after t_k, or the other target's."""
    positions: Array
    """(s,)"""


def worst_targets(
    recursion: Recursion, gamma_1: float, gamma_2: float, radius: float
) -> tuple[WorstTarget | None, WorstTarget | None]:
    """Return the targets that are worst for positions and for velocities, at the same tick.

    None where there is no bound, or none is known to be attained.
    """
    unit = identity_like(recursion.matrix)
    most = worst(recursion, gamma_1, gamma_2, radius, unit, recursion.h)
    if most is None:
        return None, None
    _, rows = attained(
        ErrorRecursion.of(recursion), unit, most, (gamma_1, gamma_2), np.zeros(2), PERIODS
    )
    beginning = ticks_until(recursion.matrix, FORGOTTEN)
    if beginning is None:
        beginning = ceil(log(FORGOTTEN) / log(radius)) if radius > 0 else 1
    robots, copies, h = recursion.n // recursion.copies, recursion.copies, recursion.h
    moved: dict[int, tuple[float, Array, Array]] = {}
    for row in rows:
        response = row >= 0 and responses(
            ErrorRecursion.of(recursion), as_array(unit[[row]]), 0.0, PERIODS
        )
        if not response:
            continue
        worst_case = worst_case_of(response[0], gamma_1, gamma_2)
        before_end, velocity = worst_motion(worst_case, gamma_1, gamma_2)
        pushed = np.cumsum(gamma_2 * worst_case.widths * np.abs(worst_case.mean))
        first = int(np.searchsorted(pushed, LEFT_OUT * worst_case.bound))
        moved[row] = worst_case.bound, before_end[first:], velocity[first:]
    longest = max((ceil(before[0] / h) + 3 for _, before, _ in moved.values()), default=0)
    tick = max(beginning, longest)
    # Of phases that come again, robot i at t_k is copy (k − 1) mod c.
    ticks = {row: tick + (row % recursion.n // robots + 1 - tick) % copies for row in moved}
    last = max(ticks.values(), default=0) + 2
    found = {
        row: WorstTarget(
            row % recursion.n % robots + 1,
            ticks[row],
            bound,
            *_spline(h, ticks[row], last, before_end, velocity * WITHIN),
        )
        for row, (bound, before_end, velocity) in moved.items()
    }
    return found.get(rows[0]), found.get(rows[1])


def _spline(
    h: float, tick: int, last_tick: int, before_end: Array, velocity: Array
) -> tuple[Array, Array]:
    """Return the samples, (s,) each, of what goes straight before the cells and after them."""
    step = h / GRID
    whole = np.unique(np.round(before_end * (GRID / RAMP / h)))[::-1] * RAMP
    velocity = np.interp(-whole * step, -before_end, velocity)
    ends, last = tick * GRID - whole, last_tick * GRID
    acceleration = np.concatenate([[0.0], np.diff(velocity) / np.diff(ends) / step, [0.0]])
    jumps = np.flatnonzero(
        np.abs(np.diff(acceleration)) > NEXT_TO_NOTHING * np.abs(acceleration).max()
    )
    if not len(jumps):
        return np.array([0.0, last * step]), np.array([0.0, last * step * velocity[0]])
    at, after = ends[jumps], acceleration[jumps + 1]
    ramps = np.stack([at - 1, at + 1], axis=1).ravel()
    pulls = np.stack([np.append(0.0, after[:-1]), after], axis=1).ravel()
    middles = np.floor([ramps[0] / 2, (ramps[-1] + last) / 2])
    times = step * np.concatenate([[0.0, middles[0]], ramps, [middles[1], last]])
    pull = np.concatenate([[0.0, 0.0], pulls, [0.0, 0.0]])
    dt = np.diff(times)
    speed = velocity[0] + np.append(0.0, np.cumsum(dt * (pull[1:] + pull[:-1]) / 2))
    moved = dt * speed[:-1] + dt * dt * (2 * pull[:-1] + pull[1:]) / 6
    return times, np.append(0.0, np.cumsum(moved))
