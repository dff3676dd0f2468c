"""Small-value norms (Definition 1): ‖X‖_A = ‖S⁻¹ X S‖ with S such that ‖A‖_A < 1.

The vector norm is the paper's ‖η‖_A = ‖η 1ᵀ‖_A = ‖S⁻¹ η‖ ‖Sᵀ 1‖', with the dual norm ‖·‖'. From

    ‖η‖∞ ≤ b ‖η‖_A,   ‖η‖_A ≤ c ‖η‖∞

only b c counts, and ‖Sᵀ 1‖' cancels in it. Lemma 2 says that there is such a norm, not which. Three
families are tried, and that which gives the smallest b c / (1 − ‖A‖_A) is taken:

- weights: S = diag(w), w = (I − |A|/r)⁻¹ u, in the ∞-norm, for ρ(|A|) < r, when ρ(|A|) < 1: then
  |A| w ≤ r w − r u. u is 1, or 1 for those alone that depend on no others: along a row of robots w
  then falls as a geometric series. It is sparse throughout; of many robots r = 1 and u = 1 alone;
- schur: S = U diag(1, η, η², …) of a Schur form A = U T U*, in the ∞-norm, with the small
  eigenvalues first, found one after another: of no more than a few rows, and where ρ(|A|) ≥ 1;
- ellipsoid: S = P^-½ with AᵀPA − r² P = −r² I, in the 2-norm, for ρ < r < 1.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import Matrix, as_array, components, identity_like
from nrs_cosim.estimator_agents.theory.solving import solve

Complex = NDArray[np.complex128]
Family = Literal["weights", "schur", "ellipsoid"]

DENSE = 80
"""The order of A up to which the two families that need dense matrices are tried."""
SCHUR = 24
"""The order of A up to which Schur's family is tried beside weights."""
DOUBLINGS = 40
RATIOS = np.geomspace(0.02, 1, 12)
SHARES = np.array(
    [0.02, 0.05, *(i / 10 for i in range(1, 11)), 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0, 1e3]
)
"""By how much r is above ρ(|A|), in units of 1 − ρ(|A|)."""
FRACTIONS = np.array([0.02, 0.1, 0.25, 0.5, 0.75, 0.9])


@dataclass(frozen=True, slots=True, eq=False)
class SmallValueNorm:
    """A norm in which A is smaller than 1."""

    family: Family
    scale: Complex
    """S, (p, p), or its diagonal, (p,)."""
    value: float
    """‖A‖_A < 1"""
    b: float
    """‖η‖∞ ≤ b ‖η‖_A"""
    c: float
    """‖η‖_A ≤ c ‖η‖∞"""

    @property
    def gain(self) -> float:
        """b c / (1 − ‖A‖_A), by which a bound on |Δ(k)| is multiplied (equation 0.5)."""
        return self.b * self.c / (1 - self.value)

    def of_matrix(self, X: NDArray[np.float64]) -> float:
        """Return ‖X‖_A of a matrix (p, p)."""
        S = np.diag(self.scale) if self.scale.ndim == 1 else self.scale
        return float(np.linalg.norm(np.linalg.solve(S, X @ S), self._order))

    def of_vector(self, eta: NDArray[np.float64]) -> float:
        """Return ‖η‖_A = ‖η 1ᵀ‖_A of a vector (p,)."""
        return self.of_matrix(np.outer(eta, np.ones(len(eta))))

    @property
    def _order(self) -> float:
        return 2 if self.family == "ellipsoid" else np.inf


def small_value_norm(A: Matrix) -> SmallValueNorm | None:
    """Return the best that is found of a matrix (p, p); None where it is not Schur stable."""
    return min(_candidates(A), key=lambda norm: norm.gain, default=None)


def _candidates(A: Matrix) -> Iterator[SmallValueNorm]:
    size = abs(A)
    yield from _weights(size, 1.0, np.ones(size.shape[0]))
    if A.shape[0] > DENSE:
        return
    array = as_array(A)
    radius = float(np.abs(np.linalg.eigvals(array)).max())
    if radius >= 1:
        return
    of_size = float(np.abs(np.linalg.eigvals(np.abs(array))).max())
    if of_size < 1:
        u = np.stack([np.ones(len(array)), _roots(array)], axis=1)
        yield from _best_weights(np.abs(array), of_size + SHARES * (1 - of_size), u)
    if of_size >= 1 or len(array) <= SCHUR:
        yield from _schur(array)
    yield from _ellipsoids(array, radius)


def _roots(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 1 for the rows of components that depend on no other, else 0, (p,)."""
    found = np.zeros(len(A))
    for part in components(A):
        others = np.delete(A[part], part, axis=1)
        found[part] = not others.any()
    return found


def _weights(size: Matrix, r: float, u: NDArray[np.float64]) -> Iterator[SmallValueNorm]:
    """Yield the norm of w = (I − |A|/r)⁻¹ u, if it is one."""
    w = solve(identity_like(size) - size / r, u)
    if not (np.all(np.isfinite(w)) and w.min() > 0):
        return
    value = float((size @ w / w).max())
    if value < 1:
        total = float(w.sum())
        b, c = float(w.max()) / total, total / float(w.min())
        yield SmallValueNorm("weights", w.astype(complex), value, b, c)


def _best_weights(
    size: NDArray[np.float64], r: NDArray[np.float64], u: NDArray[np.float64]
) -> Iterator[SmallValueNorm]:
    """Yield the best norm of w = (I − |A|/r)⁻¹ u over all r, (q,), and u, the columns of (p, c)."""
    try:
        w = np.linalg.solve(np.eye(len(size)) - size / r[:, None, None], u)
    except np.linalg.LinAlgError:  # r is ρ(|A|) but for rounding
        return
    with np.errstate(all="ignore"):
        value, total = (size @ w / w).max(axis=1), w.sum(axis=1)
        b, c = w.max(axis=1) / total, total / w.min(axis=1)
        holds = np.isfinite(w).all(axis=1) & (w.min(axis=1) > 0) & (value < 1)
        gain = np.where(holds, b * c / (1 - value), np.inf)
    i, j = np.unravel_index(int(gain.argmin()), gain.shape)
    if holds[i, j]:
        scale = w[i, :, j].astype(complex)
        yield SmallValueNorm("weights", scale, *(float(one[i, j]) for one in (value, b, c)))


def _schur(A: NDArray[np.float64]) -> Iterator[SmallValueNorm]:
    T, U = _triangular(A)
    for ratio in RATIOS:
        powers = ratio ** np.arange(len(A))
        if powers[-1] < 1e-12:
            continue
        value = float(np.linalg.norm(T * powers / powers[:, None], np.inf))
        if value < 1:
            S = U * powers
            ones = float(np.abs(S.sum(axis=0)).sum())
            back = (U / powers).conj().T
            b, c = (float(np.linalg.norm(X, np.inf)) for X in (S, back))
            yield SmallValueNorm("schur", S, value, b / ones, c * ones)


def _triangular(A: NDArray[np.float64]) -> tuple[Complex, Complex]:
    """Return T and U of A = U T U*, by a reflection for one eigenvector after another."""
    p = len(A)
    T, U = A.astype(complex), np.eye(p, dtype=complex)
    for k in range(p - 1):
        found, vectors = np.linalg.eig(T[k:, k:])
        v = vectors[:, np.argmin(np.abs(found))]
        v[0] += np.exp(1j * np.angle(v[0])) * np.linalg.norm(v)
        turned = np.eye(p - k) - 2 * np.outer(v, v.conj()) / np.linalg.norm(v) ** 2
        T[k:] = turned @ T[k:]
        T[:, k:] = T[:, k:] @ turned
        U[:, k:] = U[:, k:] @ turned
    return T, U


def _ellipsoids(A: NDArray[np.float64], radius: float) -> Iterator[SmallValueNorm]:
    r = radius + FRACTIONS * (1 - radius)
    P = _gathered(A / r[:, None, None])
    sizes, V = np.linalg.eigh(P[np.isfinite(P).all(axis=(1, 2))])
    keeps = sizes[:, 0] > 0
    root, V = np.sqrt(sizes[keeps])[:, None], V[keeps]
    S, back = (V / root) @ V.mT, (V * root) @ V.mT
    values = np.linalg.norm(back @ A @ S, 2, axis=(1, 2)).tolist()
    for value, one, largest in zip(values, S, root[:, 0, -1].tolist(), strict=True):
        if value < 1:
            ones = float(np.linalg.norm(one.sum(axis=0)))
            b = float(np.linalg.norm(one, axis=1).max())
            c = largest * float(np.sqrt(len(A)))
            yield SmallValueNorm("ellipsoid", one.astype(complex), value, b / ones, c * ones)


def _gathered(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return P = Σ (Aʲ)ᵀ Aʲ of each A, (q, p, p), for which AᵀPA − P = −I.

    Each turn doubles the terms.
    """
    P: NDArray[np.float64] = np.broadcast_to(np.eye(A.shape[-1]), A.shape)
    power = A
    for _ in range(DOUBLINGS):
        more = power.mT @ P @ power
        P = P + (more + more.mT) / 2
        if (np.abs(more).max(axis=(1, 2)) <= 1e-16 * np.abs(P).max(axis=(1, 2))).all():
            break
        power = power @ power
    return P
