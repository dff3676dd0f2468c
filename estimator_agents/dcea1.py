"""First-order DCEA (paper, equation 3.3): position and velocity both jump.

    Δε_i = α Σ_j w_ij/ϖ_i (ε_j − ε_i),   Δυ_i = β Σ_j w_ij/ϖ_i (υ_j − υ_i)

Its error obeys x(t_{k+1}) = Λ x(t_k) + Δ(k), with Λ block triangular (equation 2.3).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectrum
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate
from nrs_cosim.estimator_agents.parameters import parameter
from nrs_cosim.estimator_agents.theory.spectrum import smallest_theta


@dataclass(frozen=True, slots=True)
class FirstOrder(Algorithm):
    """The first-order algorithm with gains α on position and β on velocity."""

    SEPARATE_GRAPHS: ClassVar[bool] = True

    alpha: float = parameter("gain on the positions", above=0)
    beta: float = parameter("gain on the velocities", above=0)

    def jump(self, estimate: Estimate, disagreement: Disagreement) -> Estimate:
        """Return the estimate right after t_k."""
        return Estimate(
            estimate.position + self.alpha * disagreement.position,
            estimate.velocity + self.beta * disagreement.velocity,
        )

    def modes(
        self,
        spectrum: Spectrum,
        h: float,  # noqa: ARG002, Λ's do not depend on h
        velocity: Spectrum | None = None,
    ) -> Spectrum:
        """Return σ(Λ) for m = 1: the roots 1 − α + α s_i and 1 − β + β s_i of φ_i (appendix A)."""
        other = spectrum if velocity is None else velocity
        return np.concatenate([1 - self.alpha * (1 - spectrum), 1 - self.beta * (1 - other)])

    def conditions(
        self,
        spectrum: Spectrum,
        h: float,  # noqa: ARG002
        velocity: Spectrum | None = None,
    ) -> list[Condition]:
        """Return Theorem 1's bound on both gains (equation 0.8), each by its own digraph."""
        other = spectrum if velocity is None else velocity
        return [
            Condition("alpha", "Theorem 1, equation 0.8", self.alpha, smallest_theta(spectrum)),
            Condition("beta", "Theorem 1, equation 0.8", self.beta, smallest_theta(other)),
        ]
