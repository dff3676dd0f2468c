"""The eigenvalues of a large component of D: those at the ends, and a disc that holds the others.

A component B ≥ 0 is irreducible, so its spectral radius r is an eigenvalue, and for any x > 0
min (B x)_i/x_i ≤ r ≤ max (B x)_i/x_i (Collatz, Wielandt). With its vector v, and Q = I − v uᵀ/uᵀv
for any u, the eigenvalues but r are those of Q B Q, at most ‖(Q B)^p Q‖^{1/p}; and of 10 normal
vectors ω a matrix has ‖M‖ ≤ 10 √(2/π) max ‖M ω‖ but for a chance of 10⁻¹⁰ (Halko, Martinsson and
Tropp 2011, lemma 4.1), of which the p-th root makes little.

What an algorithm makes of s, log |σ(s)|, is subharmonic where σ are the eigenvalues of a matrix
that is analytic in s: over the disc it is largest on the circle.
"""

from collections.abc import Callable
from math import exp, log, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import Matrix
from nrs_cosim.estimator_agents.algorithm import Spectrum

EXTREMES, RESTARTS, WORK = 6, 500, 2e6
"""How many eigenvalues are looked for at an end, how often Arnoldi's method begins anew at most,
and that times the number of robots: a second or so of 100,000."""
STEPS, TIGHT = 200, 1e-9
"""Of the power method after it, and how far apart bounds on r may be that are one number."""
DRAWN, POWERS = 10, 150
"""How many vectors ω, and p."""
POINTS, BESIDE = 721, 1e-5
"""Of the circle's upper half, both real ones among them, and by how much the others lie outside:
between two of them |σ| may be larger, by the square of their distance."""


class PartialSpectrum(np.ndarray[Any, np.dtype[np.complex128]]):
    """Eigenvalues that are known, then points of the circle about 0 that holds all others."""

    known: int
    """How many, the first, are eigenvalues."""
    within: float
    """The radius."""

    @classmethod
    def of(cls, eigenvalues: Spectrum, within: float) -> "PartialSpectrum":
        """Return them, and upper half of the circle: the lower one's modes are conjugates."""
        outside = within + min(BESIDE, max(1 - within, 0) / 2)
        circle = outside * np.exp(1j * np.linspace(0, pi, POINTS))
        circle[[0, -1]] = within, -within
        found = np.concatenate([eigenvalues, circle]).astype(np.complex128).view(cls)
        found.known, found.within = len(eigenvalues), within
        return found


def known_of(spectrum: Spectrum) -> Spectrum:
    """Return those that are eigenvalues: of a whole spectrum all."""
    if not isinstance(spectrum, PartialSpectrum):
        return spectrum
    return np.asarray(spectrum)[: spectrum.known]


def within_of(spectrum: Spectrum) -> float | None:
    """Return within what of 0 those are that are not known; None where all are."""
    return spectrum.within if isinstance(spectrum, PartialSpectrum) else None


def bounds_by(radius: Callable[[Spectrum], float], spectrum: Spectrum) -> tuple[float, float]:
    """Return bounds on a radius that depends on all eigenvalues: it is one where all are known."""
    upper = radius(spectrum)
    if not isinstance(spectrum, PartialSpectrum):
        return upper, upper
    return (radius(known_of(spectrum)) if spectrum.known else 0.0), upper


def outermost(block: Matrix) -> tuple[Spectrum, float]:
    """Return eigenvalues of an irreducible B ≥ 0, (p, p), and the radius that holds the others."""
    largest, low, high, v = _perron(block)
    if high - low > TIGHT * high:
        return np.zeros(0, np.complex128), high
    u = _perron(block.T)[3]
    found = np.concatenate([_arnoldi(block, which)[0] for which in ("LR", "SR", "LI")])
    others = found[np.abs(found - largest) > sqrt(TIGHT) * high]
    known = np.unique(np.concatenate([[min(max(largest, low), high)], others]))
    return known.astype(np.complex128), min(high, _others(block, v, u))


def _perron(block: Matrix) -> tuple[float, float, float, NDArray[np.float64]]:
    """Return r, bounds on it, and its vector v > 0, (p,)."""
    values, vectors = _arnoldi(block, "LR", 1)
    p = block.shape[0]
    largest = float(values[0].real) if len(values) else 0.0
    v = np.abs(vectors[:, 0]) if len(values) else np.ones(p)
    v = v + 1e-12 * v.max()
    for _ in range(STEPS):
        v = v + block @ v  # B + I is aperiodic
        v = v / v.max()
    ratios = (block @ v) / v
    return largest, float(ratios.min()), float(ratios.max()), v


def _others(block: Matrix, v: NDArray[np.float64], u: NDArray[np.float64]) -> float:
    """Return a bound on the eigenvalues but that of v, from p steps of vectors drawn."""
    along = u / (u @ v)

    def without(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
        return vectors - v[:, None] * (along @ vectors)

    vectors = without(np.random.default_rng(0).standard_normal((len(v), DRAWN)))
    grown = log(DRAWN * sqrt(2 / pi))
    for _ in range(POWERS):
        vectors = without(block @ vectors)
        size = float(np.linalg.norm(vectors, axis=0).max())
        if not size:
            return 0.0
        vectors, grown = vectors / size, grown + log(size)
    return exp(grown / POWERS)


def _arnoldi(block: Matrix, which: str, count: int = EXTREMES) -> tuple[Spectrum, NDArray[Any]]:
    """Return eigenvalues at one end, and vectors, as many as Arnoldi's method comes to."""
    from scipy.sparse.linalg import ArpackNoConvergence, eigs  # noqa: PLC0415, as in `matrices`

    p = block.shape[0]
    restarts = int(min(RESTARTS, WORK / p)) + 1
    try:
        values, vectors = eigs(block, count, which=which, v0=np.ones(p), maxiter=restarts)
    except ArpackNoConvergence as error:
        values, vectors = error.eigenvalues, error.eigenvectors
    return np.asarray(values, np.complex128), vectors
