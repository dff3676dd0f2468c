"""How far the estimates stay from any target, with any periods between h − r and h + r.

With y = V x + (K − I)_22 υ_0, the velocities' errors right after a jump, and |η_k| <= r,

    x(t_{k+1}) = A(h) x(t_k) + Δ(k) + η_k [y(t_k); 0]   (A(h_k) = A(h) + η_k [V; 0])

so that a period adds at most r |y_i| to robot i's position. By the triangle inequality, with what Δ
comes to of a target that moves for h + r each time,

    lim |y| <= (1 − r H)⁻¹ lim_Δ |y|,   H = Σ_j |V A^j [1; 0]|,   if ρ(r H) < 1,
    lim |x| <= lim_Δ |x| + r Σ_j |A^j [1; 0]| lim |y|.

If velocities do not depend on positions, H is zero; if A ≥ 0 as well, the bound is that of h + r
throughout, and so it is attained. It holds for a list of periods and for jitter alike.
"""

from math import log

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from estimator_agents.theory.estimates import REST, Pair, always, largest, worst
from estimator_agents.theory.recursion import Recursion
from estimator_agents.theory.solving import solve

Array = NDArray[np.float64]

LARGEST, MOST = 200, 5000
"""Robots, and sampling periods of the past, for which a sum of |A^j| is affordable."""


def sharp_aperiodic(
    recursion: Recursion, r: float, gamma_1: float, gamma_2: float, radius: float
) -> tuple[Pair, Pair] | None:
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
    found: list[Pair] = []
    for seen in (sparse.eye_array(2 * n, format="csr"), jump):
        most = worst(recursion, *moved, seen, recursion.h + r)
        pushed = _pushed(recursion, seen, radius, y)
        if most is None or pushed is None:
            return None
        found.append(largest(most + r * pushed))
    before, after = found
    return before, always(before, after, recursion, gamma_1)


def _pushed(recursion: Recursion, seen: sparse.csr_array, radius: float, y: Array) -> Array | None:
    """Return Σ_j |seen A^j [1; 0]| y, (p,)."""
    n = recursion.n
    A, S = _of_positions(recursion, seen)
    if A.data.min(initial=0) >= 0 and S.data.min(initial=0) >= 0:
        given = np.concatenate([y, np.zeros(A.shape[0] - n)])
        found: Array = S @ solve(sparse.eye_array(A.shape[0]) - A, given)
        return found
    total = _sum(recursion, seen, radius)
    return None if total is None else total @ y


def _sum(recursion: Recursion, seen: sparse.csr_array, radius: float) -> Array | None:
    """Return Σ_j |seen A^j [1; 0]|, (p, n)."""
    if recursion.n > LARGEST or (radius > 0 and log(REST) / log(radius) > MOST):
        return None
    A, S = _of_positions(recursion, seen)
    X = np.eye(A.shape[0], recursion.n)
    total = np.zeros((S.shape[0], recursion.n))
    for _ in range(MOST):
        told = np.abs(S @ X)
        total += told
        if told.max() <= REST * (1 - radius) * total.max():
            return total
        X = A @ X
    return None


def _of_positions(
    recursion: Recursion, seen: sparse.csr_array
) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Return A and `seen` without the velocities where positions alone never come to them."""
    if not recursion.velocities_alone:
        return recursion.matrix, seen
    n = recursion.n
    return sparse.csr_array(recursion.matrix[:n, :n]), sparse.csr_array(seen[:, :n])
