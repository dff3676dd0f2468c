"""The error x = col(ε̄, ῡ) obeys x(t_{k+1}) = A x(t_k) + Δ(k), and A is Λ, Γ or another's.

A jump that is linear is [ε; υ]⁺ = K [ε; υ] + G [dε; dυ], with the disagreement d = (D − I) x, and
then comes the flow F = [[1, h], [0, 1]]. Hence, one axis of m (paper, equations 2.3 and 2.0),

    A = F K ⊗ I + F G ⊗ (D − I),   Δ(k) = 1 ⊗ (F K x_0(t_k) − x_0(t_{k+1})),  x_0 = [ε_0; υ_0].

K and G are found by asking the algorithm itself to jump: what is promised is of what runs.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from bus.topology import Topology
from estimator_agents.algorithm import Algorithm
from estimator_agents.estimate import Disagreement, Estimate

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Recursion:
    """A linear estimator on a digraph, under a sampling period."""

    h: float
    """s"""
    keep: Array
    """(2, 2) K; the identity where an estimate stays when all agree."""
    gain: Array
    """(2, 2) G; diag(α, β) for the first-order DCEA."""
    D: sparse.csr_array
    """(n, n)"""

    @property
    def n(self) -> int:
        """The number of robots."""
        return int(self.D.shape[0])

    @property
    def flow(self) -> Array:
        """F, (2, 2)."""
        return np.array([[1.0, self.h], [0.0, 1.0]])

    @property
    def drag(self) -> Array:
        """F (K − I), (2, 2): what the target's own state adds to Δ(k); zero for both DCEA."""
        drag: Array = self.flow @ (self.keep - np.eye(2))
        return drag

    @property
    def jump(self) -> sparse.csr_array:
        """K ⊗ I + G ⊗ (D − I), (2 n, 2 n): x right after a sampling time from x there."""
        alone = sparse.kron(self.keep - self.gain, sparse.eye_array(self.n))
        return sparse.csr_array(alone + sparse.kron(self.gain, self.D))

    @property
    def matrix(self) -> sparse.csr_array:
        """A, (2 n, 2 n)."""
        gain, keep = self.flow @ self.gain, self.flow @ self.keep
        alone = sparse.kron(keep - gain, sparse.eye_array(self.n))
        return sparse.csr_array(alone + sparse.kron(gain, self.D))

    @property
    def velocities_alone(self) -> bool:
        """Whether ῡ does not depend on ε̄: A is block triangular, as Λ is."""
        return not (self.flow @ self.gain)[1, 0] and not (self.flow @ self.keep)[1, 0]

    @property
    def velocity_block(self) -> sparse.csr_array:
        """The part of A from ῡ to ῡ, (n, n): 𝒫 of equation 0.5."""
        return sparse.csr_array(self.matrix[self.n :, self.n :])


def recursion_of(algorithm: Algorithm, topology: Topology, h: float) -> Recursion | None:
    """Return an algorithm's recursion on a digraph; None where its jump is not linear."""
    found = linear_jump(algorithm)
    return Recursion(h, *found, topology.D) if found else None


def linear_jump(algorithm: Algorithm) -> tuple[Array, Array] | None:
    """Return K and G, each (2, 2), of an algorithm that jumps linearly; else None."""
    matrix = _jump(algorithm, np.eye(4))
    tried = np.random.Generator(np.random.Philox(4)).normal(size=(4, 32))
    if not np.allclose(_jump(algorithm, tried), matrix @ tried, rtol=1e-12, atol=1e-12):
        return None
    return matrix[:, :2], matrix[:, 2:]


def _jump(algorithm: Algorithm, given: Array) -> Array:
    """Return [ε; υ]⁺, (2, c), of c cases of [ε; υ; dε; dυ], (4, c)."""
    after = algorithm.jump(Estimate(*given[:2]), Disagreement(*given[2:]))
    return np.stack([after.position, after.velocity])
