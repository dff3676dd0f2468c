"""When the estimates converge: everything follows from the spectrum of D (paper, section 3)."""

import numpy as np

from nrs_cosim.bus.matrices import Matrix, as_array, nonzeros
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Spectrum
from nrs_cosim.estimator_agents.theory.outermost import PartialSpectrum, outermost

DENSE, BAND = 1000, 32
"""Robots of a component up to which it is solved densely, and the widest band that is solved."""


def spectrum_of(topology: Topology) -> Spectrum:
    """Return the eigenvalues s_i of D, shape (n,); perhaps a `PartialSpectrum` of large components.

    D is block triangular over the strongly connected components of the digraph, so they are the
    eigenvalues of its diagonal blocks. A component of one robot gives an exact zero, where an
    eigenvalue solver on the whole of D would lose half of the digits or more: zero is defective.
    """
    D, degree = topology.D, topology.in_degree
    parts = topology.components()
    lone = sum(len(part) == 1 for part in parts)
    blocks = [_eigenvalues(D[part][:, part], degree[part]) for part in parts if len(part) > 1]
    known = np.concatenate([np.zeros(lone), *(found for found, _ in blocks)]).astype(np.complex128)
    within = [radius for _, radius in blocks if radius is not None]
    return PartialSpectrum.of(known, max(within)) if within else known


def _eigenvalues(block: Matrix, degree: np.ndarray) -> tuple[Spectrum, float | None]:
    """Return the eigenvalues of a component's part of D, of robots with in-degrees ϖ_i.

    With them goes the radius that holds those which are not known, where there are such.

    A large one is solved when it is a directed cycle, where s^p is the product of its p weights, or
    when its edges go both ways with equal weights, for then B^½ D B^-½ is symmetric.
    """
    p = len(degree)
    if p <= DENSE:
        return np.linalg.eigvals(as_array(block)).astype(np.complex128), None
    from scipy import sparse  # noqa: PLC0415, as in `bus.matrices`
    from scipy.linalg import eigvals_banded  # noqa: PLC0415, as above
    from scipy.sparse.csgraph import reverse_cuthill_mckee  # noqa: PLC0415, as above

    if nonzeros(block) == p:
        length = np.exp(np.log(block.data).mean())
        cycle: Spectrum = length * np.exp(2j * np.pi * np.arange(p) / p)
        return cycle, None
    root = sparse.diags_array(np.sqrt(degree))
    constant_period = (root @ block @ sparse.diags_array(1 / np.sqrt(degree))).tocsr()
    if abs(constant_period - constant_period.T).max() <= 1e-13:
        order = reverse_cuthill_mckee(constant_period, symmetric_mode=True)
        ranked = constant_period[order][:, order].tocoo()
        row, column = ranked.coords
        width = int((row - column).max())
        if width <= BAND:
            band = np.zeros((width + 1, p))
            below = row >= column
            band[(row - column)[below], column[below]] = ranked.data[below]
            return np.asarray(eigvals_banded(band, lower=True), np.complex128), None
    return outermost(block)


def thetas(spectrum: Spectrum) -> Spectrum:
    """Return 2 / (1 − s_i) = θ_i + j ϑ_i; A2 makes every s_i ≠ 1 (Lemma 1)."""
    return 2 / (1 - spectrum)


def smallest_theta(spectrum: Spectrum) -> float:
    """Return min θ_i = min (2 − 2 Re s_i)/|1 − s_i|², the bound of Theorem 1 (equation 0.8).

    It is above 1, for |s_i| < 1 (Lemma 1): gains up to 1 are never too large.
    """
    return float(thetas(spectrum).real.min())


def largest_period(spectrum: Spectrum, alpha: float, beta: float) -> float:
    """Return Theorem 3's bound on h in s: min 2 β² (θ_i − β) / (α (ϑ_i² + β²)) (equation 5.2)."""
    theta = thetas(spectrum)
    bounds = 2 * (beta * beta) * (theta.real - beta) / (alpha * (theta.imag**2 + beta * beta))
    return float(bounds.min())


def spectral_radius(modes: Spectrum) -> float:
    """Return ρ, the factor by which the error shrinks over one sampling period in steady state.

    It is not a number for an algorithm that has no modes, since its jump is not linear.
    """
    return float(np.abs(modes).max()) if len(modes) else float("nan")
