"""Consensus tracking with proportional and integral action, after Freeman, Yang and Lynch.

R. A. Freeman, P. Yang, K. M. Lynch, Stability and convergence properties of dynamic average
consensus estimators, 45th IEEE Conference on Decision and Control, 338-343, 2006. Their estimators
add the integral of what the neighbours disagree about, so that a disagreement that persists is
driven to zero. Here it is the first-order DCEA that is given an integral, of the disagreement with
the in-neighbours, the target among them. What follows is ours, and not quoted:

    s_i⁺ = s_i + dε_i,   Δε_i = α dε_i + κ s_i⁺,   Δυ_i = β dυ_i   at t_k
    dε_i = Σ_j w_ij/ϖ_i (ε_j − ε_i),   dυ_i = Σ_j w_ij/ϖ_i (υ_j − υ_i)

The target's acceleration leaves the DCEA's positions behind by a constant, where it is constant;
here the integrals grow until they make up for it, and all positions are exact. The velocities are
left behind as before: they have no integral. With κ = 0 it is the first-order DCEA.

Of an eigenvalue s_i of D, l = 1 − s_i, the position's error and the integral have the polynomial
λ² − [2 − (α + κ) l] λ + 1 − α l. By the test of Schur and Cohn its roots are within the
unit circle if and only if α < θ_i = 2 Re(1/l), as in Theorem 1, and

    0 < κ < −2 Re(a b*)/|b|²,   a = −2 + α l + (1 − α l)(2 − α l*),   b = l − (1 − α l) l*,

which is κ < 4/l − 2 α for a real l.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nrs_cosim.bus.fields import ESTIMATE, Field, Fields
from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectrum
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.parameters import parameter
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.theory.spectrum import smallest_theta
from nrs_cosim.estimator_agents.values import Values


@dataclass(frozen=True, slots=True)
class PIConsensus(Algorithm):
    """The first-order algorithm with gains α and β, and κ on the integral of the disagreement."""

    SEPARATE_GRAPHS: ClassVar[bool] = True
    STATE: ClassVar[Fields] = {
        **ESTIMATE,
        "integral": Field(doc="sum of the disagreements on the position, one of each sample"),
    }

    alpha: float = parameter("gain on the positions", above=0)
    beta: float = parameter("gain on the velocities", above=0)
    kappa: float = parameter("gain on the integral of the positions' disagreement", above=0)

    def receive(self, now: Now, x: Values, received: Received) -> Values:  # noqa: ARG002
        """Return the state right after t_k."""
        position = received.disagreement("position", x.position)
        velocity = received.disagreement("velocity", x.velocity)
        integral = x["integral"] + position
        return x.replace(
            position=x.position + (self.alpha * position + self.kappa * integral),
            velocity=x.velocity + self.beta * velocity,
            integral=integral,
        )

    def modes(
        self,
        spectrum: Spectrum,
        h: float,  # noqa: ARG002, they do not depend on h
        velocity: Spectrum | None = None,
    ) -> Spectrum:
        """Return the roots of the polynomial above, and 1 − β (1 − s_i)."""
        away = 1 - spectrum
        half = 1 - (self.alpha + self.kappa) * away / 2
        root = np.sqrt(half**2 - 1 + self.alpha * away)
        other = spectrum if velocity is None else velocity
        return np.concatenate([half + root, half - root, 1 - self.beta * (1 - other)])

    def conditions(
        self,
        spectrum: Spectrum,
        h: float,  # noqa: ARG002
        velocity: Spectrum | None = None,
    ) -> list[Condition]:
        """Return the bounds on α and κ of the positions' D, and on β of the velocities'."""
        away, alpha = 1 - spectrum, self.alpha
        a = -2 + alpha * away + (1 - alpha * away) * (2 - alpha * away.conj())
        b = away - (1 - alpha * away) * away.conj()
        bounds = -2 * (a * b.conj()).real / (b * b.conj()).real
        other = spectrum if velocity is None else velocity
        return [
            Condition("alpha", "Schur and Cohn", alpha, smallest_theta(spectrum)),
            Condition("beta", "Theorem 1, equation 0.8", self.beta, smallest_theta(other)),
            Condition("kappa", "Schur and Cohn", self.kappa, float(bounds.min())),
        ]
