"""What it adds to the bounds that samples of robots are not what is received, but near it.

Where each number that is received from robot j may be off by δ, x(t_{k+1}) = A x + F G ⊗ D δ + Δ(k)
with the recursion of what would be received. In the long run δ adds at most Σ_j |A^j F G ⊗ D| δ to
the error, which is (I − A)⁻¹ F G ⊗ D δ where nothing in it is negative. So it is with samples that
are sent only when they say something new (`event_triggered`).
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import ESTIMATE
from nrs_cosim.bus.matrices import FEW, Matrix, as_array, identity_like, kron
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.solving import solve

LEFT = 1e-13
"""The part of the sum at which it ends."""
MOST = 200_000
"""Sampling periods of the past that a sum may take."""


def received_errors(
    period: Recursion | LinearStep, D: Matrix, off: Mapping[str, float], radius: float
) -> EstimateBounds | None:
    """Return what errors of up to `off`, by field that is sent, add in the long run on a digraph.

    None where ρ = `radius` ≥ 1, and of many robots where something in A is negative.
    """
    if radius >= 1:
        return None
    n = D.shape[0]
    if isinstance(period, LinearStep):
        A, samples, names = period.matrix(D), period.samples, period.sent
    else:
        A, samples, names = period.matrix, period.flow @ period.gain, tuple(ESTIMATE)
    received = kron(samples, D)
    errors = np.kron([off[name] for name in names], np.ones(n))
    if A.min() >= 0 and received.min() >= 0:
        return _largest(solve(identity_like(A) - A, received @ errors), n)
    if n > FEW:
        return None
    dense, kernel = as_array(A), as_array(received)
    most = np.zeros(len(dense))
    for _ in range(MOST):
        added = np.abs(kernel) @ errors
        most += added
        if added.max() <= LEFT * (1 - radius) * most.max():
            return _largest(most, n)
        kernel = dense @ kernel
    return None


def _largest(most: NDArray[np.float64], n: int) -> EstimateBounds:
    position, velocity = most.reshape(-1, n)[:2].max(axis=1).tolist()
    return EstimateBounds(position, velocity)
