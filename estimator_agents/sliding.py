"""The distributed sliding-mode observer, under samples, after Cao, Ren, Meng and Mei, Ren, Ma.

Y. Cao, W. Ren, Z. Meng, Decentralized finite-time sliding mode estimators and their applications
in decentralized finite-time formation tracking, Systems & Control Letters 59(9), 522-529, 2010.
J. Mei, W. Ren, G. Ma, Distributed coordinated tracking with a dynamic leader for multiple
Euler-Lagrange systems, IEEE Transactions on Automatic Control 56(6), 1415-1421, 2011.

In continuous time υ̇_i = β' sgn Σ_j a_ij (υ_j − υ_i) reaches υ_0 in finite time when β' > sup |a_0|,
and ε̇_i = υ_i + α' sgn Σ_j a_ij (ε_j − ε_i) then reaches ε_0. Heard at t_k alone and held, a
sign adds h times its gain until t_{k+1}; here it is added at once, at t_k:

    Δε_i = α sgn Σ_j w_ij/ϖ_i (ε_j − ε_i),   Δυ_i = β sgn Σ_j w_ij/ϖ_i (υ_j − υ_i)

With α = h α' and β = h β' that is the observer at the sampling times but for up to h β/2 in ε.
Its jump is not linear: there are no modes.

The demand β > h γ2 is ours, what β' > sup |a_0| comes to. Without it a robot is left behind by a
target that keeps accelerating. With it, in a digraph without cycles, |ῡ| comes to ℓ (β + h γ2) at
most for a robot to which the longest path has ℓ edges, and to that (statement W5): beyond all that
it receives, a jump takes β away and the target gives back h γ2 at most. Of cycles nothing is
proven.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectrum
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate
from nrs_cosim.estimator_agents.parameters import parameter


@dataclass(frozen=True, slots=True)
class Sliding(Algorithm):
    """The observer with steps α of position and β of velocity at each sampling time."""

    SEPARATE_GRAPHS: ClassVar[bool] = True

    alpha: float = parameter("step of the position, at each sampling time", unit="rad", above=0)
    beta: float = parameter("step of the velocity, at each sampling time", unit="rad/s", above=0)

    def jump(self, estimate: Estimate, disagreement: Disagreement) -> Estimate:
        """Return the estimate right after t_k."""
        return Estimate(
            estimate.position + self.alpha * np.sign(disagreement.position),
            estimate.velocity + self.beta * np.sign(disagreement.velocity),
        )

    def modes(
        self,
        spectrum: Spectrum,  # noqa: ARG002, there are none
        h: float,  # noqa: ARG002
        velocity: Spectrum | None = None,  # noqa: ARG002
    ) -> Spectrum:
        """Return none."""
        return np.zeros(0, np.complex128)

    def conditions(
        self,
        spectrum: Spectrum,  # noqa: ARG002
        h: float,  # noqa: ARG002
        velocity: Spectrum | None = None,  # noqa: ARG002
    ) -> list[Condition]:
        """Return none: the observer asks nothing of the digraphs beyond A2."""
        return []

    def demands(self, h: float, gamma_1: float, gamma_2: float) -> list[Condition]:  # noqa: ARG002
        """Return that a step is larger than what the target's velocity changes by meanwhile."""
        return [Condition("acceleration", "keeping up with the target", h * gamma_2, self.beta)]
