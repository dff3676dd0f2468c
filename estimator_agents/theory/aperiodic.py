"""Periods h_k that are not all alike: x(t_{k+1}) = F(h_k) J x(t_k) + Δ(k), with the jump J.

J does not depend on h. On the i-th vector of a Schur basis of D, A(h) = F(h) J is block triangular
with the 2 × 2 blocks F(h) B, B = K − (1 − s_i) G. So the growth of a sequence of A(h_k) in the long
run is that of the same sequence of 2 × 2 matrices for some i, and this is exact.

- K and G upper triangular (the first-order DCEA): the blocks' eigenvalues are those of B, in any
  order of periods;
- a list of periods over and over: ρ of its product;
- jitter, t_k = k h − δ_k with any δ_k in 0 … T: as F(h_k) = F(−δ_{k+1}) F(h) F(δ_k), a product is
  one of M(δ_k) = F(h) F(δ_k) B F(−δ_k) but for its ends, with each δ_k apart from the others. M is
  quadratic in δ, and lies in the hull of its values and Bézier points: their joint spectral radius
  is an upper bound, and that of values a lower one.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import nan
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectrum
from nrs_cosim.estimator_agents.theory.recursion import linear_jump
from nrs_cosim.estimator_agents.theory.varying import joint_spectral_radius

Complex = NDArray[np.complex128]
ConvergenceStatus = Literal["proven", "refuted", "not decided"]
KNOWN = 1e-6
"""Of a radius: bounds that are nearer are one number."""

PIECES = 3
"""Of the span of δ, each in the hull of three points."""
REFINED, NEAR = 8, 1e-3
"""Eigenvalues of D, the worst, for which a search goes on where a norm leaves more than so much."""
SHARES, ITERATIONS = (0.01, 0.03, 0.1, 0.3, 0.6, 0.9), 4
"""Norms that are tried: r² from ρ² on towards 1, and how often the largest gets more weight."""


@dataclass(frozen=True, slots=True)
class Periods:
    """What the periods may be, s."""

    gaps: tuple[float, ...]
    """They, over and over; without jitter."""
    early: float = 0.0
    """T: by how much a sampling time may be early."""

    @property
    def constant_period(self) -> float | None:
        """h, where all are the same."""
        return self.gaps[0] if len(self.gaps) == 1 and not self.early else None

    @property
    def mean(self) -> float:
        """Asymptotically."""
        return sum(self.gaps) / len(self.gaps)

    @property
    def shortest(self) -> float:
        """None is shorter."""
        return min(self.gaps) - self.early

    @property
    def longest(self) -> float:
        """None is longer."""
        return max(self.gaps) + self.early


@dataclass(frozen=True, slots=True)
class RadiusBounds:
    """Bounds on what the error is multiplied by at a sampling time, asymptotically at worst."""

    lower: float
    upper: float

    @property
    def status(self) -> ConvergenceStatus:
        """Whether the error shrinks for all sampling times that there may be."""
        if self.upper < 1:
            return "proven"
        return "refuted" if self.lower >= 1 else "not decided"

    @property
    def radius(self) -> float:
        """The radius, at most, where it is known to a millionth; else not a number."""
        if self.upper == self.lower:
            return self.upper
        near = self.upper - self.lower <= KNOWN * self.upper
        return self.upper if near and self.status != "not decided" else nan


def radius_bounds(algorithm: Algorithm, spectrum: Spectrum, periods: Periods) -> RadiusBounds:
    """Return bounds on the spectral radius; not numbers where the jump is not linear."""
    found = linear_jump(algorithm)
    if found is None:
        return RadiusBounds(nan, nan)
    keep, gain = found
    away = np.unique(np.round(1 - spectrum.real + 1j * np.abs(spectrum.imag), 12))
    blocks = keep - away[:, None, None] * gain
    if not keep[1, 0] and not gain[1, 0]:
        exact = float(np.abs(blocks[:, [0, 1], [0, 1]]).max())
        return RadiusBounds(exact, exact)
    if not periods.early:
        exact = _of_list(blocks, periods.gaps)
        return RadiusBounds(exact, exact)
    return _of_jitter(blocks, periods.mean, periods.early)


def flow(h: float) -> NDArray[np.float64]:
    """Return F(h), (2, 2)."""
    return np.array([[1.0, h], [0.0, 1.0]])


def _of_list(blocks: Complex, gaps: tuple[float, ...]) -> float:
    """Return max ρ(F(h_L) B ⋯ F(h_1) B)^{1/L}; the sizes of products are kept as logarithms."""
    product = np.broadcast_to(np.eye(2, dtype=complex), blocks.shape)
    size = np.zeros(len(blocks))
    for h in gaps:
        product = flow(h) @ blocks @ product
        most = np.abs(product).max(axis=(1, 2))
        product = product / most[:, None, None]
        size += np.log(most)
    return float(np.exp((size + np.log(_radii(product))) / len(gaps)).max())


def _of_jitter(blocks: Complex, h: float, early: float) -> RadiusBounds:
    """Return bounds: by values for the lower one, with Bézier points for the upper one."""
    ends = np.linspace(0, early, PIECES + 1)
    values = np.stack([_bent(blocks, h, end, end) for end in ends])
    hull = np.stack([_bent(blocks, h, *piece) for piece in pairwise(ends)])
    hull = np.concatenate([values, hull])
    pairs = values[:, None] @ values
    lowest = np.maximum(_radii(values).max(axis=0), np.sqrt(_radii(pairs)).max(axis=(0, 1)))
    lower = float(lowest.max())
    highest = _in_a_norm(hull, lower)
    for i in np.argsort(-highest)[:REFINED]:
        near = min(NEAR, abs(1 - lower) / 4)
        if highest[i] <= lower * (1 + near):
            break
        for points in (values, hull):
            found = joint_spectral_radius(list(points[:, i]), near)
            if found is not None and points is values:
                lower = max(lower, found.lower)
            elif found is not None:
                highest[i] = min(highest[i], found.upper)
    return RadiusBounds(lower, max(lower, float(highest.max())))


def _bent(blocks: Complex, h: float, one: float, other: float) -> Complex:
    """Return the point for δ = one, other of the polar form of M; M(δ) itself where both are δ."""
    N = np.array([[0.0, 1.0], [0.0, 0.0]])
    middle = (one + other) / 2
    bent: Complex = flow(h) @ (
        blocks + middle * (N @ blocks - blocks @ N) - one * other * (N @ blocks @ N)
    )
    return bent


def _radii(matrices: Complex) -> NDArray[np.float64]:
    """Return ρ of 2 × 2 matrices (…, 2, 2)."""
    half = (matrices[..., 0, 0] + matrices[..., 1, 1]) / 2
    determinant = matrices[..., 0, 0] * matrices[..., 1, 1]
    determinant = determinant - matrices[..., 0, 1] * matrices[..., 1, 0]
    root = np.sqrt(half**2 - determinant + 0j)
    radii: NDArray[np.float64] = np.maximum(np.abs(half + root), np.abs(half - root))
    return radii


def _in_a_norm(matrices: Complex, enough: float) -> NDArray[np.float64]:
    """Return the largest of q matrices, (q, n, 2, 2), in a norm for each n that makes them small.

    It is that of xᴴ P x with P = 1 + L(P)/r², L(X) = Σ w Mᴴ X M. Of one matrix alone, it would be
    below r, for any r above ρ. The largest of several gets more weight in the next turn. For an n
    of which it is no more than `enough`, no better norm is looked for.
    """
    least = np.full(matrices.shape[1], np.inf)
    for share in SHARES:
        rows = np.flatnonzero(least > enough)
        those = matrices[:, rows]
        q, n = those.shape[:2]
        turned = those.conj().swapaxes(-1, -2)
        weights = np.full((q, n), 1 / q)
        for _ in range(ITERATIONS):
            L = np.einsum("qn,qnab,qncd->nadbc", weights, turned, those).reshape(n, 4, 4)
            radius = np.abs(np.linalg.eigvals(L)).max(axis=1, initial=0)
            r2 = radius + share * np.maximum(np.abs(1 - radius), 1e-9)
            P = np.linalg.solve(np.eye(4) - L / r2[:, None, None], np.eye(2).reshape(4, 1))
            norms = _in_norm_of(P.reshape(n, 2, 2), those)
            least[rows] = np.minimum(least[rows], norms.max(axis=0))
            weights = weights * norms**8
            weights = weights / weights.sum(axis=0)
    return least


def _in_norm_of(P: Complex, matrices: Complex) -> NDArray[np.float64]:
    """Return the norms, (q, n), of matrices (q, n, 2, 2) where P (n, 2, 2) is all but Hermitian."""
    sizes, vectors = np.linalg.eigh((P + P.conj().swapaxes(-1, -2)) / 2)
    root = np.sqrt(np.maximum(sizes, 1e-9 * sizes[:, 1:]))[:, None, :]
    turned = vectors.conj().swapaxes(-1, -2)
    constant_period = (vectors * root @ turned) @ matrices @ (vectors / root @ turned)
    norms: NDArray[np.float64] = np.linalg.norm(constant_period, 2, axis=(-2, -1))
    return norms
