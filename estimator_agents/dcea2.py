"""Second-order DCEA (paper, equation 2.2): only the velocity jumps, so ε_i is continuous.

    Δε_i = 0,   Δυ_i = α Σ_j w_ij/ϖ_i (ε_j − ε_i) + β Σ_j w_ij/ϖ_i (υ_j − υ_i)

Its error obeys x(t_{k+1}) = Γ x(t_k) + Δ(k) (equation 2.0).
"""

from dataclasses import dataclass

import numpy as np

from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectrum
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate
from nrs_cosim.estimator_agents.parameters import parameter
from nrs_cosim.estimator_agents.theory.spectrum import largest_period, smallest_theta


@dataclass(frozen=True, slots=True)
class SecondOrder(Algorithm):
    """The second-order algorithm with gains α on position and β on velocity."""

    alpha: float = parameter("gain on the positions", unit="1/s", above=0)
    beta: float = parameter("gain on the velocities", above=0)

    def jump(self, estimate: Estimate, disagreement: Disagreement) -> Estimate:
        """Return the estimate right after t_k."""
        return Estimate(
            estimate.position,
            estimate.velocity
            + (self.alpha * disagreement.position + self.beta * disagreement.velocity),
        )

    def modes(self, spectrum: Spectrum, h: float) -> Spectrum:
        """Return σ(Γ) for m = 1: the two roots of each ψ_i (proof of Theorem 3)."""
        half = 1 - (self.alpha * h + self.beta) * (1 - spectrum) / 2
        root = np.sqrt(half**2 - 1 + self.beta * (1 - spectrum))
        return np.concatenate([half + root, half - root])

    def conditions(self, spectrum: Spectrum, h: float) -> list[Condition]:
        """Return Theorem 3's bounds on β and on the sampling period (equation 5.2)."""
        return [
            Condition("beta", "Theorem 3", self.beta, smallest_theta(spectrum)),
            Condition(
                "sampling_period",
                "Theorem 3, equation 5.2",
                h,
                largest_period(spectrum, self.alpha, self.beta),
            ),
        ]
