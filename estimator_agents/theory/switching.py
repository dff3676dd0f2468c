"""Digraphs that take turns: x(t_{k+1}) = A_σ(k) x(t_k) + Δ(k), with the exchange σ(k) of tick k.

- Phases that repeat after T ticks: z(t_{k+T}) = A_T ⋯ A_1 z(t_k) without the target's part, so that
  the factor per tick is ρ(A_T ⋯ A_1)^{1/T}, exactly. With one copy of the robots for each tick of a
  period, of which each is told by the copy before, all is one recursion with one matrix 𝒜 again:
  𝒜 has A_p from copy p to copy p + 1, ρ(𝒜) is that factor, and whatever holds of A holds of 𝒜.
- The last phase stays: in steady state it alone counts.
- Any order: the joint spectral radius of the A_e (`varying`). It is below 1 when K = I and
  G = diag(α, β) with 0 < α, β < 1, whatever the digraphs, if each has a spanning tree from the
  target (docs/theory.md).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import Matrix, as_array, components, nonzeros
from nrs_cosim.estimator_agents.theory.recursion import Array, Recursion
from nrs_cosim.estimator_agents.theory.varying import LARGEST, JointRadius, joint_spectral_radius

DENSE = 1000
"""The order of a block up to which the product of a period is made."""
WORK = 1e9
"""Numbers that Arnoldi's method may multiply to find the largest eigenvalue of a larger one."""
MOST_COPIES = 20_000
"""Robots, with all their copies, up to which a period is made one recursion."""

Phases = Sequence[tuple[int, int]]
"""Which exchange, and for how many ticks, of one period."""


def period(recursions: Sequence[Recursion], phases: Phases) -> Recursion | None:
    """Return the recursion of all T copies of the robots; None where these are too many.

    Robot i of copy p is number p n + i: copy p is the robots at ticks k with (k − 1) mod T = p.
    """
    first = recursions[0]
    ticks = [e for e, count in phases for _ in range(count)]
    if len(ticks) * first.n > MOST_COPIES:
        return None
    from scipy import sparse  # noqa: PLC0415, as in `bus.matrices`

    def copied(blocks: Sequence[Matrix]) -> Matrix:
        grid: list[list[Matrix | None]] = [[None] * len(ticks) for _ in ticks]
        for p, e in enumerate(ticks):
            grid[(p + 1) % len(ticks)][p] = sparse.csr_array(blocks[e])
        return sparse.csr_array(sparse.block_array(grid))

    D = copied([one.D for one in recursions])
    has_two_digraphs = any(one.D is not one.D_velocity for one in recursions)
    other = copied([one.D_velocity for one in recursions]) if has_two_digraphs else D
    own = copied([one.own for one in recursions])
    return Recursion(first.h, first.keep, first.gain, D, other, own, len(ticks))


def period_radius(recursions: Sequence[Recursion], phases: Phases) -> float:
    """Return ρ(A_T ⋯ A_1)^{1/T}; not a number where it is not found."""
    return product_radius([one.matrix for one in recursions], phases)


def product_radius(matrices: Sequence[Matrix], phases: Phases) -> float:
    """Return the same of matrices.

    All A_e have one block triangular form over the strongly connected parts of their sum.
    """
    ticks = sum(count for _, count in phases)
    parts = components(_united(matrices))
    lone = np.array([part[0] for part in parts if len(part) == 1], np.intp)
    with np.errstate(divide="ignore"):
        logs = sum(n * np.log(np.abs(matrices[e].diagonal()[lone])) for e, n in phases)
    found = [float(np.exp(np.max(logs) / ticks))] if len(lone) else []
    for rows in (part for part in parts if len(part) > 1):
        blocks = [A[rows][:, rows] for A in matrices]
        found.append(_of_block(blocks, phases, ticks))
    return max(found, key=lambda factor: (np.isnan(factor), factor))


def _united(matrices: Sequence[Matrix]) -> Matrix:
    """Return what is not 0 where any of some matrices is not."""
    return sum((abs(A) for A in matrices[1:]), abs(matrices[0]))


def _of_block(blocks: Sequence[Matrix], phases: Phases, ticks: int) -> float:
    if blocks[0].shape[0] > DENSE:
        return _of_large_block(blocks, phases, ticks)
    product, size = np.eye(blocks[0].shape[0]), 0.0
    for e, count in phases:
        power, more = _power(as_array(blocks[e]), count)
        product, most = _scaled(power @ product)
        size += more + most
    return float(np.exp((size + np.log(_radius(product))) / ticks)) if product.any() else 0.0


def _of_large_block(blocks: Sequence[Matrix], phases: Phases, ticks: int) -> float:
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigs  # noqa: PLC0415, as above

    order = [blocks[e] for e, count in phases for _ in range(count)]

    def through(x: NDArray[np.float64]) -> NDArray[np.float64]:
        for A in order:
            x = A @ x
        return x

    p = blocks[0].shape[0]
    once = sum(nonzeros(A) for A in order)
    try:
        found = eigs(
            LinearOperator((p, p), matvec=through, dtype=float),
            1,
            v0=np.ones(p),
            maxiter=int(1 + WORK / (20 * once)),
            return_eigenvectors=False,
        )
    except ArpackError:
        return float("nan")
    return float(np.abs(found).max() ** (1 / ticks))


def _power(A: Array, count: int) -> tuple[Array, float]:
    """Return A^count as a matrix of size 1 and the logarithm of what it is divided by."""
    power, size, square, of_square = np.eye(len(A)), 0.0, A, 0.0
    while count:
        if count % 2:
            power, more = _scaled(square @ power)
            size += of_square + more
        square, more = _scaled(square @ square)
        of_square = 2 * of_square + more
        count //= 2
    return power, size


def _scaled(A: Array) -> tuple[Array, float]:
    most = float(np.abs(A).max())
    return (A / most, float(np.log(most))) if most else (A, 0.0)


def _radius(product: Array) -> float:
    """Return ρ; what is zero in the product by its structure is not left to rounding.

    It is infinite where the product is beyond all numbers.
    """
    if not np.isfinite(product).all():
        return np.inf
    parts = components(product != 0)
    sizes = (np.abs(np.linalg.eigvals(product[np.ix_(part, part)])).max() for part in parts)
    return float(max(sizes))


def any_order(recursions: Sequence[Recursion]) -> JointRadius | None:
    """Return bounds on the joint spectral radius; None where it is too large to be looked for."""
    matrices = [one.matrix for one in recursions]
    parts = components(_united(matrices))
    if matrices[0].shape[0] > DENSE or max(map(len, parts)) > LARGEST:
        return None
    arrays = [as_array(A) for A in matrices]
    found = joint_spectral_radius(arrays)
    if found is None or not found.lower < 1 <= found.upper:
        return found
    # What is asked is on which side of 1 it lies: a search that ends near enough to tell.
    nearer = joint_spectral_radius(arrays, (1 - found.lower) / 4)
    if nearer is None:
        return found
    best = max(found, nearer, key=lambda one: one.lower)
    return JointRadius(best.lower, min(found.upper, nearer.upper), best.order)


def contracts_in_any_order(keep: Array, gain: Array) -> bool:
    """Return whether it is proven that every order converges, by the gains alone, given A2."""
    return bool(np.diag(gain).max() < 1) and gains_up_to_one(keep, gain)


def gains_up_to_one(keep: Array, gain: Array) -> bool:
    """Return whether K = I and G = diag(α, β) with 0 < α, β ≤ 1."""
    gains = np.diag(gain)
    diagonal = np.array_equal(gain, np.diag(gains)) and np.array_equal(keep, np.eye(2))
    return diagonal and bool(np.all((gains > 0) & (gains <= 1)))
