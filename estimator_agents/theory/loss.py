"""Links that lose samples by chance: x(t_{k+1}) = A_k x(t_k), with A_k drawn anew at each tick.

The matrices are those of `lossy_step`.

- E x xᵀ → 0 iff ρ(E[A ⊗ A]) < 1 (statement L1). With the mean Ā and what robots' rows deviate from
  it, E[A X Aᵀ] = Ā X Āᵀ + Σ M_e X M_eᵀ; over the strongly connected components of all outcomes it
  is the largest of theirs. Of large ones it lies between the smallest and the largest c of
  E[A X Aᵀ] = c X for any X > 0 (Collatz and Wielandt in that cone, statement L2).
- Almost every run converges iff λ = lim ln ‖A_k ⋯ A_1‖/k < 0. E ln |det A|/p ≤ λ ≤ ½ ln ρ(E[A ⊗ A])
  is proven (statement L4); between them it is simulated (`simulated_links`).
- With K = I and G = diag(α, β), 0 < α, β ≤ 1, it converges in both senses whatever the losses below
  1 and bounded delays (statement L3).
- Of digraphs in turn E x xᵀ goes on by one such map a tick, and ρ is that of a period's (L7).

Radii are of sizes, not of squares: ρ(E[A ⊗ A])^½ and e^λ.
"""

from collections.abc import Callable, Sequence
from math import exp, inf, isqrt, prod

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.theory.aperiodic import RadiusBounds
from nrs_cosim.estimator_agents.theory.lossy_step import (
    LossyStep,
    by_components,
    squared,
    squares,
)
from nrs_cosim.estimator_agents.theory.switching import Phases, product_radius

Array = NDArray[np.float64]

ALWAYS: Phases = ((0, 1),)
"""One recursion at all ticks."""
DENSE = 24
"""States of a component up to which E[A ⊗ A] is a matrix."""
RESTARTS, ROUNDS, POWERS, SLACK = 60, 8, 20, 1e-6
"""Of Arnoldi's method for larger ones; of powers after it, so many in each; and how near bounds
come to one another."""
MATRICES = 4096
"""Outcomes of a component up to which the determinants of all are taken."""
FEW = 40
"""States of a recursion up to which a critical loss is looked for."""
GRID, NEAR = 8, 1e-6
"""Probabilities of loss at which it is looked for a critical one, and how near it is found."""


def mean_square_radius(steps: Sequence[LossyStep], phases: Phases = ALWAYS) -> RadiusBounds:
    """Return bounds on the root of the growth of E x xᵀ at a tick (statements L1, L2 and L7)."""
    found = [_squared(part, phases) for part in by_components(steps)]
    return RadiusBounds(
        max(one.lower for one in found) ** 0.5, max(one.upper for one in found) ** 0.5
    )


def _squared(steps: Sequence[LossyStep], phases: Phases) -> RadiusBounds:
    p = len(steps[0].fixed)
    each = [(step.mean, step.deviations()) for step in steps]
    if p <= DENSE:
        radius = product_radius([_of_symmetric(squares(*one)) for one in each], phases)
        return RadiusBounds(radius, radius)

    def through(X: Array) -> Array:
        for e, count in phases:
            for _ in range(count):
                X = squared(*each[e], X)
        return X

    ticks = sum(count for _, count in phases)
    found = _bracket(through, p)
    return RadiusBounds(found.lower ** (1 / ticks), found.upper ** (1 / ticks))


def _of_symmetric(whole: Array) -> Array:
    """Return a map of matrices as one of what symmetric ones have on and below the diagonal."""
    p = isqrt(len(whole))
    row, column = np.tril_indices(p)
    below, above = row * p + column, column * p + row
    whole = whole[below]
    folded: Array = whole[:, below] + np.where(row == column, 0, whole[:, above])
    return folded


def _bracket(through: Callable[[Array], Array], p: int) -> RadiusBounds:
    """Return bounds on the radius of a map of positive semidefinite matrices (p, p)."""
    from scipy.linalg import eigh  # noqa: PLC0415, as in `bus.matrices`
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigs  # noqa: PLC0415, as above

    def flat(x: Array) -> Array:
        X = x.reshape(p, p)
        return through((X + X.T) / 2).ravel()

    X = np.eye(p) / p
    operator = LinearOperator((p * p, p * p), matvec=flat, dtype=float)
    try:
        _, vectors = eigs(operator, 1, v0=X.ravel(), maxiter=RESTARTS, tol=SLACK)
        found = vectors[:, 0].reshape(p, p)
        found = (found / np.trace(found)).real
        found = (found + found.T) / 2
        least = float(np.linalg.eigvalsh(found)[0])
        if least > -1 / p:  # else it is no multiple of what is positive, but for rounding
            X = found + (SLACK + 2 * max(-least * p, 0)) * X
    except ArpackError:
        pass  # the bounds are so of any X > 0, if not as near
    lower, upper = 0.0, inf
    for _ in range(ROUNDS):
        quotients = eigh(through(X), X, eigvals_only=True)
        lower, upper = max(lower, float(quotients[0])), min(upper, float(quotients[-1]))
        if upper - lower <= SLACK * upper:
            break
        for _ in range(POWERS):
            X = through(X)
            X = X / np.trace(X)
        X = X + SLACK**2 * np.eye(p) / p  # what is nearly singular has quotients of rounding
    return RadiusBounds(lower, upper)


def almost_sure(steps: Sequence[LossyStep], upper: float, phases: Phases = ALWAYS) -> RadiusBounds:
    """Return bounds on e^λ, which errors are multiplied by in almost every run (statement L4).

    `upper` is the mean-square radius at most.
    """
    ticks = sum(count for _, count in phases)
    least = (
        exp(sum(count * _of_determinants(part[e]) for e, count in phases) / ticks)
        for part in by_components(steps)
    )
    return RadiusBounds(min(max(least), upper), upper)  # by rounding it may be above


def _of_determinants(lossy: LossyStep) -> float:
    """Return E ln |det A|/p, of few outcomes; −∞ for others, which any λ is above."""
    p = len(lossy.fixed)
    if prod(len(one.chance) for one in lossy.outcomes) > MATRICES or p > DENSE:
        return -inf
    chance, matrices = np.ones(1), lossy.fixed[None]
    for one in lossy.outcomes:
        matrices = np.repeat(matrices, len(one.chance), axis=0)
        matrices[:, one.rows] = np.tile(one.parts, (len(chance), 1, 1))
        chance = np.outer(chance, one.chance).ravel()
    logs = np.linalg.slogdet(matrices[chance > 0])[1]
    return float(chance[chance > 0] @ logs) / p


def critical_loss(
    lossy_at: Callable[[float], Sequence[LossyStep] | None], phases: Phases = ALWAYS
) -> float | None:
    """Return the least probability of loss from which it does not converge in mean square.

    0 if it does not without losses, 1 if it does at all that are tried; None of too many states.
    """
    first = lossy_at(1 / GRID)
    if first is None or len(first[0].fixed) > FEW:
        return None
    if len(phases) > 1 and max(len(part[0].fixed) for part in by_components(first)) > DENSE:
        return None

    def diverges(loss: float) -> bool:
        lossy = lossy_at(loss)
        return lossy is None or not mean_square_radius(lossy, phases).upper < 1

    if diverges(0.0):
        return 0.0
    low, high = 0.0, 1.0
    for at in range(1, GRID):
        if diverges(at / GRID):
            high = at / GRID
            break
        low = at / GRID
    else:
        return 1.0
    while high - low > NEAR:
        middle = (low + high) / 2
        low, high = (low, middle) if diverges(middle) else (middle, high)
    return high
