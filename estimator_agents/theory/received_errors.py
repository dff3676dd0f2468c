"""What it adds to the bounds that samples of robots are not what is received, but near it.

Where each number that is received from robot j may be off by δ, x(t_{k+1}) = A x + F G ⊗ D δ + Δ(k)
with the recursion of what would be received. In the long run δ adds at most Σ_j |A^j F G ⊗ D| δ to
the error, which is (I − A)⁻¹ F G ⊗ D δ where nothing in it is negative. So it is with samples that
are sent only when they say something new (`event_triggered`).
"""

from itertools import count

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import FEW, as_array, identity_like, kron
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds, largest
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.solving import solve

LEFT = 1e-13
"""The part of the sum at which it ends."""
MOST = 200_000
"""Sampling periods of the past that a sum may take."""


def received_errors(
    recursion: Recursion, off: NDArray[np.float64], radius: float
) -> EstimateBounds | None:
    """Return what errors of up to `off`, of positions and of velocities, add in the long run.

    None where ρ = `radius` ≥ 1, and of many robots where something in A is negative.
    """
    if radius >= 1 or recursion.copies > 1 or recursion.D is not recursion.D_velocity:
        return None
    n, A = recursion.n, recursion.matrix
    received = kron(recursion.flow @ recursion.gain, recursion.D)
    errors = np.kron(off, np.ones(n))
    if A.min() >= 0 and received.min() >= 0:
        return largest(solve(identity_like(A) - A, received @ errors))
    if n > FEW:
        return None
    dense, kernel = as_array(A), as_array(received)
    most = np.zeros(2 * n)
    for j in count():
        added = np.abs(kernel) @ errors
        most += added
        if added.max() <= LEFT * (1 - radius) * most.max():
            return largest(most)
        if j == MOST:
            return None
        kernel = dense @ kernel
    return None
