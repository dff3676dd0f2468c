"""When the estimates converge: everything follows from the spectrum of D (paper, section 3)."""

import numpy as np

from bus.topology import Topology
from estimator_agents.algorithm import Spectrum


def spectrum_of(topology: Topology) -> Spectrum:
    """Return the eigenvalues s_i of D, shape (n,).

    D is block triangular over the strongly connected components of the digraph, so they are the
    eigenvalues of its diagonal blocks. A component of one robot gives an exact zero, where an
    eigenvalue solver on the whole of D would lose half of the digits or more: zero is defective.
    """
    D = topology.D
    blocks = [
        np.linalg.eigvals(D[part][:, part].toarray()) if len(part) > 1 else np.zeros(1)
        for part in topology.components()
    ]
    return np.concatenate(blocks).astype(np.complex128)


def thetas(spectrum: Spectrum) -> Spectrum:
    """Return 2 / (1 − s_i) = θ_i + j ϑ_i; A2 makes every s_i ≠ 1 (Lemma 1)."""
    return 2 / (1 - spectrum)


def smallest_theta(spectrum: Spectrum) -> float:
    """Return min θ_i = min (2 − 2 Re s_i)/|1 − s_i|², the bound of Theorem 1 (equation 0.8)."""
    return float(thetas(spectrum).real.min())


def largest_period(spectrum: Spectrum, alpha: float, beta: float) -> float:
    """Return Theorem 3's bound on h in s: min 2 β² (θ_i − β) / (α (ϑ_i² + β²)) (equation 5.2)."""
    theta = thetas(spectrum)
    bounds = 2 * beta**2 * (theta.real - beta) / (alpha * (theta.imag**2 + beta**2))
    return float(bounds.min())


def spectral_radius(modes: Spectrum) -> float:
    """Return ρ, the factor by which the error shrinks over one sampling period in the long run."""
    return float(np.abs(modes).max())
