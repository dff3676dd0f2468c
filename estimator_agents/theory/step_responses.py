"""What estimates right after sampling times make of a target that begins to move, in the long run.

Of a recursion it follows from A^j 1; of agents that keep more, and over late links, from statement
W4. Robots behind the estimates are moved by it (`cascade`).
"""

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.estimator_agents.theory.all_times import is_straight
from nrs_cosim.estimator_agents.theory.delays import LateStep
from nrs_cosim.estimator_agents.theory.estimates import BLOCK, DENSE, history
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.target_response import impulse_errors
from nrs_cosim.estimator_agents.theory.worst_case import LEFT

Array = NDArray[np.float64]

ROBOTS, PERIODS, WORK = 200, 50_000, 3e7
"""Robots, and sampling periods of the past, that are looked at; and numbers of their responses."""


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """What comes of a target that begins to move at 1, in estimates right after sampling times."""

    h: float
    """s"""
    after: Array
    """(P, e, 2, n) errors of positions and velocities, the first since then first. The target
    began right before a sampling time, or right after the one before, or (if e = 3) it moves not
    and sends an acceleration of 1 once."""
    limit: Array
    """(2, n), which the first two come to."""

    @property
    def begun(self) -> Array:
        """(e, 2): the errors right before the first of these times."""
        return np.array([[0.0, -1.0], [-self.h, -1.0], [0.0, 0.0]])[: self.after.shape[1]]


def steps_of(recursion: Recursion) -> Steps | None:
    """Return the responses of a recursion's estimates; None where the past lasts too long."""
    n, h = recursion.n, recursion.h
    if recursion.copies > 1 or n > ROBOTS or recursion.drag[:, 0].any():
        return None
    A, jump, unit = as_array(recursion.matrix), recursion.jump, np.kron(np.eye(2), np.ones((n, 1)))
    drag, held = recursion.drag[:, 1], np.repeat((recursion.keep - np.eye(2))[:, 1], n)
    found: list[Array] = []
    dragged, most, count = np.zeros(2 * n), 0.0, 0
    for kernels in history(A, unit, BLOCK if 2 * n <= DENSE else 16):
        p, r = kernels[:, 0].T, kernels[:, 1].T
        pulled = dragged + np.cumsum(p * drag[0] + r * drag[1], axis=0)
        before = np.concatenate([dragged[None], pulled[:-1]])
        dragged = pulled[-1]
        both = np.stack([before - r, before - r - h * p], axis=1)
        found.append((both @ as_array(jump).T + held).reshape(len(both), 2, 2, n))
        size, count = float(np.abs(kernels[:, :, -1]).max()), count + len(both)
        most = max(most, float(np.abs(kernels).max()))
        if size <= LEFT * most:
            after = np.concatenate(found)
            return Steps(h, after, after[-1, 0] * bool(recursion.drag.any() or held.any()))
        if not size < inf or count * 4 * n > WORK or count > PERIODS:
            return None
    return None


def steps_of_late(late: LateStep, radius: float) -> Steps | None:
    """Return the responses of estimates that move on straight; None where they are not known."""
    h = late.step.h
    known = is_straight(late.step.flow, h) and late.topology.n <= ROBOTS
    found = impulse_errors(late, radius) if known else None
    if found is None:
        return None
    (limit, errors) = found[0][:2], (now[:, :2] for now in found[1])
    back = np.array([[1.0, -h], [0.0, 1.0]])
    rest, most, after = np.stack([limit, limit, 0 * limit]), 0.0, list[Array]()
    for count, now in enumerate(errors):
        after.append(back @ now[[1, 0, 2]])
        size = float(np.abs(now - rest).max())
        most = max(most, size)
        if size <= LEFT * most:
            both = np.array(after)  # of a sample at t_0, what is right after t_0 comes first
            both[:-1, :2] = both[1:, :2]
            return Steps(h, both[:-1], back @ limit)
        if not size < inf or count * now.size > WORK or count > PERIODS:
            return None
    return None
