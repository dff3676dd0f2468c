"""Between which values honest robots stay, whatever others of them send (statement B1).

Where each jump leaves a robot's position and velocity between the least and the largest of honest
robots' and the target's, on each axis, and a position moves by its velocity in between,

    U_k = max(max_i υ_i(t_0), max_{s ≤ k} υ_0(t_s))
    V_{k+1} = max(V_k, ε_0(t_k)) + (t_{k+1} − t_k) U_k

are above all velocities right after t_k and all positions at t_{k+1}, V_1 from max_i ε_i(t_0); and
so below, with least ones.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.estimate import Estimate

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class HonestHull:
    """The least and the largest that honest estimates come to in a run, (m, 2) by axis."""

    position: Array
    velocity: Array


def honest_hull(times: Array, start: Estimate, target: Estimate) -> HonestHull:
    """Return what honest robots, (n, m) at t_0, stay within up to t_K.

    `times` are t_0 … t_K, s, and the target is at t_1 … t_K, (K, m).
    """
    low, high = (_largest(times, start, target, sign) for sign in (-1, 1))
    return HonestHull(*(np.stack([-a, b], axis=1) for a, b in zip(low, high, strict=True)))


def _largest(times: Array, start: Estimate, target: Estimate, sign: int) -> tuple[Array, Array]:
    """Return the largest position and velocity, (m,) each, of what has a sign."""
    of_robots, speed_of_robots = (
        (sign * part).max(axis=0) for part in (start.position, start.velocity)
    )
    speed = np.maximum.accumulate(np.vstack([speed_of_robots, sign * target.velocity]))
    moved = np.diff(times)[:, None] * speed[:-1]
    total = np.vstack([np.zeros_like(of_robots), np.cumsum(moved, axis=0)])
    # V_k less all moves before it is the largest of what was there at some t_s less those till t_s.
    known = np.vstack([of_robots, sign * target.position]) - total
    positions = np.maximum.accumulate(known) + total  # right after t_k: no less than right before
    return positions.max(axis=0), speed[-1]
