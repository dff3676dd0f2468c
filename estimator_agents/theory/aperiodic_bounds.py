"""How far the estimates stay from any target, when periods are not all alike.

A list of periods over and over: what an acceleration in one period comes to is followed through
those after it, as for a single period, apart for each place in the list where it may end.

Any periods between h − r and h + r, in any order: with y = V x + (K − I)_22 υ_0, the velocities'
errors right after a jump, and |η_k| <= r,

    x(t_{k+1}) = A(h) x(t_k) + Δ(k) + η_k [y(t_k); 0]   (A(h_k) = A(h) + η_k [V; 0])

so that a period adds at most r |y_i| to robot i's position. By the triangle inequality, with what Δ
comes to of a target that moves for h + r each time,

    lim |y| <= (1 − r H)⁻¹ lim_Δ |y|,   H = Σ_j |V A^j [1; 0]|,   if ρ(r H) < 1,
    lim |x| <= lim_Δ |x| + r Σ_j |A^j [1; 0]| lim |y|.

If velocities do not depend on positions, H is zero; if A ≥ 0 as well, the bound is that of h + r
throughout, and so it is attained.
"""

from collections.abc import Sequence
from math import log

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import Matrix, identity_like, nonzeros
from nrs_cosim.estimator_agents.theory.estimates import (
    REST,
    EstimateBounds,
    always,
    largest,
    slip,
    worst,
)
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.slow_modes import modulus
from nrs_cosim.estimator_agents.theory.solving import solve

Array = NDArray[np.float64]

LARGEST, MOST = 200, 5000
"""Robots, and sampling periods of the past, for which a sum of |A^j| is affordable."""
WORK = 2e9
"""Multiplications that a list may take."""


def worst_case_of_list(
    recursion: Recursion, gaps: Sequence[float], gamma_1: float, gamma_2: float, factor: float
) -> tuple[EstimateBounds, EstimateBounds] | None:
    """Return the worst-case bounds at the sampling times, left limits, and at all times.

    Of the recursion K, G and D count, and `factor` < 1 is the spectral radius. None where it takes
    too long.
    """
    n, jump, h = recursion.n, recursion.jump, np.array(gaps)
    rounds = int(WORK / ((nonzeros(jump) + 2 * n) * 2 * len(h)))
    if recursion.drag[:, 0].any() or (factor > 0 and log(REST) / log(factor) > rounds):
        return None
    sizes = np.array([[slip(gap, gamma_1, gamma_2), min(2 * gamma_1, gap * gamma_2)] for gap in h])
    pull = (recursion.keep - np.eye(2))[:, 1]
    drag = np.stack([pull[0] + h * pull[1], np.full(len(h), pull[1])], axis=1)

    def moved(responses: Array) -> Array:
        """Return two bounds, (2, p, L), on what each period does to responses, (p, L, 2)."""
        held = np.abs((responses * drag).sum(axis=2)) * gamma_1
        driven = gamma_2 * modulus(responses[..., 1], responses[..., 1] + h * responses[..., 0], h)
        return np.stack([(np.abs(responses) * sizes).sum(axis=2) + held, driven + held])

    kernel = np.zeros((2 * n, len(h), 2))
    kernel[:n, :, 0] = kernel[n:, :, 1] = 1.0
    views = (identity_like(jump), jump)
    most = np.zeros((len(views), 2, 2 * n, len(h)))
    for j in range(rounds):
        added = np.stack([moved(_times(seen, kernel)) for seen in views])
        most += np.roll(added, j, axis=3)
        left, all_ = (sums.max(axis=(0, 2, 3)) for sums in (added, most))
        if j >= len(h) and np.all(left <= REST * (1 - factor) * all_):
            before, after = (largest(bounds.min(axis=0).max(axis=1)) for bounds in most)
            return before, always(before, after, recursion, gamma_1)
        kernel = _times(jump, kernel)
        kernel[:n] += np.roll(h, -j - 1)[:, None] * kernel[n:]
    return None


def worst_case_aperiodic(
    recursion: Recursion, r: float, gamma_1: float, gamma_2: float, radius: float
) -> tuple[EstimateBounds, EstimateBounds] | None:
    """Return bounds at the sampling times, left limits, and at all times, for periods h ± r.

    The recursion and its ρ = `radius` are those of h. None where no bound is found.
    """
    n, jump = recursion.n, recursion.jump
    moved = (gamma_1, gamma_2, radius)
    y = worst(recursion, *moved, jump[n:], recursion.h + r)
    if y is None:
        return None
    y = y + abs(recursion.keep[1, 1] - 1) * gamma_1
    if not recursion.velocities_alone:
        H = _sum(recursion, jump[n:], radius)
        if H is None or r * np.abs(np.linalg.eigvals(H)).max() >= 1:
            return None
        y = np.linalg.solve(np.eye(n) - r * H, y)
    found: list[EstimateBounds] = []
    for seen in (identity_like(jump), jump):
        most = worst(recursion, *moved, seen, recursion.h + r)
        pushed = _pushed(recursion, seen, radius, y)
        if most is None or pushed is None:
            return None
        found.append(largest(most + r * pushed))
    before, after = found
    return before, always(before, after, recursion, gamma_1)


def _pushed(recursion: Recursion, seen: Matrix, radius: float, y: Array) -> Array | None:
    """Return Σ_j |seen A^j [1; 0]| y, (p,)."""
    n = recursion.n
    A, S = _of_positions(recursion, seen)
    if A.min() >= 0 and S.min() >= 0:
        given = np.concatenate([y, np.zeros(A.shape[0] - n)])
        found: Array = S @ solve(identity_like(A) - A, given)
        return found
    total = _sum(recursion, seen, radius)
    return None if total is None else total @ y


def _sum(recursion: Recursion, seen: Matrix, radius: float) -> Array | None:
    """Return Σ_j |seen A^j [1; 0]|, (p, n)."""
    if recursion.n > LARGEST or (radius > 0 and log(REST) / log(radius) > MOST):
        return None
    A, S = _of_positions(recursion, seen)
    X = np.eye(A.shape[0], recursion.n)
    total = np.zeros((S.shape[0], recursion.n))
    for _ in range(MOST):
        term = np.abs(S @ X)
        total += term
        if term.max() <= REST * (1 - radius) * total.max():
            return total
        X = A @ X
    return None


def _of_positions(recursion: Recursion, seen: Matrix) -> tuple[Matrix, Matrix]:
    """Return A and `seen` without the velocities where positions alone never come to them."""
    if not recursion.velocities_alone:
        return recursion.matrix, seen
    n = recursion.n
    return recursion.matrix[:n, :n], seen[:, :n]


def _times(A: Matrix, stacked: Array) -> Array:
    """Multiply (p, q) by (q, …)."""
    product: Array = (A @ stacked.reshape(len(stacked), -1)).reshape(-1, *stacked.shape[1:])
    return product
