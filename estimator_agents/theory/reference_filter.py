"""What a PD loop makes of errors of its reference, if the robot had no mass (statement T1).

Of kd ḟ + kp f = kp ε̄_i + kd ῡ_i let f = ε̄_i + g on an axis, with c = kp/kd. Between sampling times
ε̄_i moves as ῡ_i says, so that ġ = −c g; at t_k g jumps back by what ε̄_i jumps. So (x, g) obeys a
recursion with the target's Δ in x alone, and |f| and |ḟ| = |ῡ_i − c g| have worst cases as
estimates have. Estimates whose positions do not jump have g = 0.
"""

from math import exp

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.worst_case import ErrorRecursion, largest_of

Array = NDArray[np.float64]

PERIODS, ROBOTS = 10_000, 40
"""Sampling periods of the past, and robots, that are looked at, at most."""


def filtered(
    recursion: Recursion | None,
    gammas: tuple[float, float],
    always: EstimateBounds,
    rate: float,
) -> EstimateBounds:
    """Return the most of |f| and |ḟ| in steady state, on an axis of rate c, per s.

    Without a recursion, or of many robots, it is what bounds on ε̄ and ῡ at all times say alone.
    """
    f = always.position + always.velocity / rate
    simple = EstimateBounds(f, always.velocity + rate * (f + always.position))
    if recursion is None:
        return simple
    if np.array_equal(recursion.keep[0], [1, 0]) and not recursion.gain[0].any():
        return always
    others = recursion.copies > 1 or recursion.keep[0, 1] or recursion.drag[:, 0].any()
    if others or recursion.n > ROBOTS:
        return simple
    n, jump = recursion.n, as_array(recursion.jump)
    jumps = jump[:n] - np.eye(n, 2 * n)
    left = exp(-rate * recursion.h)
    A = np.block(
        [[as_array(recursion.matrix), np.zeros((2 * n, n))], [-left * jumps, left * np.eye(n)]]
    )
    estimates = ErrorRecursion.of(recursion)
    error = ErrorRecursion(
        recursion.h, A, np.concatenate([estimates.B, np.zeros((n, 2))]), estimates.drag
    )
    g = np.eye(n, 3 * n, 2 * n)
    after = g - np.pad(jumps, ((0, 0), (0, n)))
    held = float(recursion.keep[1, 1] - 1)
    velocity_after = np.pad(jump[n:], ((0, 0), (0, n))) - rate * after
    found = [
        largest_of(error, seen, own, gammas, PERIODS)
        for seen, own in (
            (np.eye(n, 3 * n) + g, 0.0),
            (np.eye(n, 3 * n, n) - rate * g, 0.0),
            (velocity_after, held),
            (after, 0.0),
        )
    ]
    if any(part is None for part in found):
        return simple
    f, before, later, jumped = (part for part in found if part is not None)
    within = (rate * recursion.h) ** 2 / 8
    return EstimateBounds(
        min(f + within * jumped, simple.position),
        min(max(later, before + rate * (1 - left) * jumped), simple.velocity),
    )
