"""Small-value norms (Definition 1): ‖X‖_A = ‖S⁻¹ X S‖ with S such that ‖A‖_A < 1.

The vector norm is the paper's ‖η‖_A = ‖η 1ᵀ‖_A = ‖S⁻¹ η‖ ‖Sᵀ 1‖', with the dual norm ‖·‖'. From

    ‖η‖∞ ≤ b ‖η‖_A,   ‖η‖_A ≤ c ‖η‖∞

only b c counts, and ‖Sᵀ 1‖' cancels in it. Lemma 2 says that there is such a norm, not which. Three
families are tried, and that which gives the smallest b c / (1 − ‖A‖_A) is taken:

- weights: S = diag(w), w = (I − |A|)⁻¹ 1, in the ∞-norm, when ρ(|A|) < 1; it is sparse throughout;
- schur: S = U diag(1, η, η², …) of the Schur form A = U T U*, in the ∞-norm;
- ellipsoid: S = P^-½ with AᵀPA − r² P = −r² I, in the 2-norm, for ρ < r < 1.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse

from nrs_cosim.estimator_agents.theory.solving import solve

Complex = NDArray[np.complex128]
Family = Literal["weights", "schur", "ellipsoid"]

DENSE = 80
"""The order of A up to which the two families that need dense matrices are tried."""
DOUBLINGS = 40
RATIOS = np.geomspace(0.02, 1, 12)
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


def small_value_norm(A: sparse.csr_array) -> SmallValueNorm | None:
    """Return the best that is found of a matrix (p, p); None where it is not Schur stable."""
    return min(_candidates(A), key=lambda norm: norm.gain, default=None)


def _candidates(A: sparse.csr_array) -> Iterator[SmallValueNorm]:
    p = A.shape[0]
    size = abs(A)
    weights = solve(sparse.eye_array(p) - size, np.ones(p))
    if np.all(np.isfinite(weights)) and weights.min() > 0:
        value = float((size @ weights / weights).max())
        if value < 1:
            total = float(weights.sum())
            bc = (float(weights.max()) / total, total / float(weights.min()))
            yield SmallValueNorm("weights", weights.astype(complex), value, *bc)
    if p <= DENSE:
        dense = A.toarray()
        radius = float(np.abs(np.linalg.eigvals(dense)).max())
        if radius < 1:
            yield from _schur(dense)
            yield from _ellipsoids(dense, radius)


def _schur(A: NDArray[np.float64]) -> Iterator[SmallValueNorm]:
    T, U = linalg.schur(A, output="complex")
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


def _ellipsoids(A: NDArray[np.float64], radius: float) -> Iterator[SmallValueNorm]:
    for fraction in FRACTIONS:
        r = radius + fraction * (1 - radius)
        sizes, V = np.linalg.eigh(_gathered(A / r))
        if not np.isfinite(sizes[-1]) or sizes[0] <= 0:
            continue
        root = np.sqrt(sizes)
        S, back = (V / root) @ V.T, (V * root) @ V.T
        value = float(np.linalg.norm(back @ A @ S, 2))
        if value < 1:
            ones = float(np.linalg.norm(S.sum(axis=0)))
            b = float(np.linalg.norm(S, axis=1).max())
            c = float(root[-1] * np.sqrt(len(A)))
            yield SmallValueNorm("ellipsoid", S.astype(complex), value, b / ones, c * ones)


def _gathered(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return P = Σ (Aʲ)ᵀ Aʲ, for which AᵀPA − P = −I; each turn doubles the terms."""
    P, power = np.eye(len(A)), A
    for _ in range(DOUBLINGS):
        more = power.T @ P @ power
        P = P + (more + more.T) / 2
        if np.abs(more).max() <= 1e-16 * np.abs(P).max():
            break
        power = power @ power
    return P
