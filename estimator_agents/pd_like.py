"""PD-like consensus tracking in discrete time, after Cao, Ren and Li.

Y. Cao, W. Ren, Y. Li, Distributed discrete-time coordinated tracking with a time-varying reference
state and limited communication, Automatica 45(5), 1299-1305, 2009. Their law moves a single
integrator by ξ_i[k+1] = ξ_i[k] + T Σ_j a_ij/Σ_j a_ij {(ξ_j[k] − ξ_j[k−1])/T − γ (ξ_i[k] − ξ_j[k])},
the target among the j. An estimate that moves on with ε̇_i = υ_i is such an integrator, with T = h
and what is in braces as its velocity:

    Δε_i = 0,   υ_i(t_k⁺) = Σ_j w_ij/ϖ_i [υ_j + α (ε_j − ε_i)]   at t_k,   α = γ

For a robot j, υ_j(t_k) is the backward difference (ε_j(t_k) − ε_j(t_{k−1}))/h, exactly. For the
target it takes the place of one, which lags behind by half a period. So this is the second-order
DCEA (equation 2.2) at β = 1. The condition is (5.2) there, derived and not quoted: it is necessary
and sufficient. In the terms of their article, with μ for the eigenvalues of D, it is

    T γ < min 2 |1 − μ|² [2 Re(1 − μ) − |1 − μ|²]/(|1 − μ|⁴ + 4 (Im μ)²).
"""

from dataclasses import dataclass

from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectrum
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate
from nrs_cosim.estimator_agents.parameters import parameter
from nrs_cosim.estimator_agents.theory.spectrum import largest_period


@dataclass(frozen=True, slots=True)
class PdLike(Algorithm):
    """The law with gain α; it has no second gain: β is 1."""

    alpha: float = parameter("gain on the positions", unit="1/s", above=0)
    beta: float = parameter("gain on the velocities, which is 1 in this law", 1.0, least=1, most=1)

    def jump(self, estimate: Estimate, disagreement: Disagreement) -> Estimate:
        """Return the estimate right after t_k."""
        return Estimate(
            estimate.position,
            estimate.velocity + (self.alpha * disagreement.position + disagreement.velocity),
        )

    def modes(self, spectrum: Spectrum, h: float) -> Spectrum:
        """Return the roots of λ² + [(α h + 1)(1 − s_i) − 2] λ + s_i."""
        return SecondOrder(self.alpha, 1.0).modes(spectrum, h)

    def conditions(self, spectrum: Spectrum, h: float) -> list[Condition]:
        """Return the bound on the period, min 2 (θ_i − 1)/(α (ϑ_i² + 1))."""
        bound = largest_period(spectrum, self.alpha, 1.0)
        return [Condition("sampling_period", "equation 5.2 at beta = 1", h, bound)]
