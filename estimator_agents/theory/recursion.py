"""The error x = col(ε̄, ῡ) obeys x(t_{k+1}) = A x(t_k) + Δ(k), and A is Λ, Γ or another's.

A jump that is linear is [ε; υ]⁺ = K [ε; υ] + G [dε; dυ], with the disagreement d = (D − I) x, and
then comes the flow F = [[1, h], [0, 1]]. Hence, one axis of m (paper, equations 2.3 and 2.0),

    A = F K ⊗ I + F G ⊗ (D − I),   Δ(k) = 1 ⊗ (F K x_0(t_k) − x_0(t_{k+1})),  x_0 = [ε_0; υ_0].

Where positions and velocities have digraphs of their own, each has its D in its column of G.

K and G are found by asking the algorithm itself to jump: what is proven is of what runs.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import Matrix, identity_like, kron
from nrs_cosim.bus.topologies import InteractionGraphs
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Algorithm, jumps, name_of
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate

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
    D: Matrix
    """(n, n), over which positions travel."""
    D_velocity: Matrix
    """(n, n), over which velocities travel; the same but for hetero-information."""
    own: Matrix
    """(n, n), whose state a jump is added to: mostly the identity."""
    copies: int = 1
    """How often each robot is among the n: once for each tick of a `theory.switching.period`."""

    @property
    def n(self) -> int:
        """The number of robots, with their copies."""
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
    def jump(self) -> Matrix:
        """K ⊗ I + G ⊗ (D − I), (2 n, 2 n): x right after a sampling time from x there."""
        return self._of(self.keep, self.gain)

    @property
    def matrix(self) -> Matrix:
        """A, (2 n, 2 n)."""
        return self._of(self.flow @ self.keep, self.flow @ self.gain)

    def _of(self, keep: Array, gain: Array) -> Matrix:
        alone = kron(keep - gain, self.own)
        if self.D is self.D_velocity:
            return alone + kron(gain, self.D)
        of_position, of_velocity = gain * [1, 0], gain * [0, 1]
        received = kron(of_position, self.D) + kron(of_velocity, self.D_velocity)
        return alone + received

    @property
    def velocities_alone(self) -> bool:
        """Whether ῡ does not depend on ε̄: A is block triangular, as Λ is."""
        return not (self.flow @ self.gain)[1, 0] and not (self.flow @ self.keep)[1, 0]

    @property
    def velocity_block(self) -> Matrix:
        """The part of A from ῡ to ῡ, (n, n): 𝒫 of equation 0.5."""
        return self.matrix[self.n :, self.n :]


def recursion_of(
    algorithm: Algorithm, over: Topology | InteractionGraphs, h: float
) -> Recursion | None:
    """Return an algorithm's recursion on a digraph, or on two; None if its jump is not linear."""
    found = linear_jump(algorithm)
    if found is None:
        return None
    exchange = over if isinstance(over, InteractionGraphs) else InteractionGraphs.of(over)
    D = exchange.position.D
    other = exchange.velocity.D if exchange.has_two_digraphs else D
    return Recursion(h, *found, D, other, identity_like(D))


def linear_jump(algorithm: Algorithm) -> tuple[Array, Array] | None:
    """Return K and G, each (2, 2), of an algorithm that only jumps, and linearly; else None."""
    if not jumps(algorithm):
        return None
    matrix = _jump(algorithm, np.eye(4))
    if not np.isfinite(matrix).all():
        raise AlgorithmError(
            f"algorithm {name_of(algorithm)}: jump returned "
            f"{matrix[~np.isfinite(matrix)][0]} where it was given zeros and ones"
        )
    tried = np.random.Generator(np.random.Philox(4)).normal(size=(4, 32))
    if not np.allclose(_jump(algorithm, tried), matrix @ tried, rtol=1e-12, atol=1e-12):
        return None
    return matrix[:, :2], matrix[:, 2:]


def _jump(algorithm: Algorithm, given: Array) -> Array:
    """Return [ε; υ]⁺, (2, c), of c cases of [ε; υ; dε; dυ], (4, c)."""
    after = algorithm.jump(Estimate(*given[:2]), Disagreement(*given[2:]))
    return np.stack([after.position, after.velocity])
