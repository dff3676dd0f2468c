"""Third-order DCEA: position, velocity and acceleration jump, and between them υ̇ = a.

    Δε_i = α Σ_j w_ij/ϖ_i (ε_j − ε_i),   Δυ_i = β Σ_j w_ij/ϖ_i (υ_j − υ_i),
    Δa_i = γ Σ_j w_ij/ϖ_i (a_j − a_i);   ε̇_i = υ_i,  υ̇_i = a_i,  ȧ_i = 0

It is the paper's first-order algorithm with one more quantity: a target of constant acceleration is
followed without an error, and one of bounded jerk within a bound. Its error's matrix is block
triangular too, so that each gain has Theorem 1's bound.
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

FIELDS: Fields = {
    **ESTIMATE,
    "acceleration": Field(truth="acceleration", doc="estimate of the target's acceleration"),
}


@dataclass(frozen=True, slots=True)
class ThirdOrder(Algorithm):
    """The third-order algorithm with gains on position, velocity and acceleration."""

    STATE: ClassVar[Fields] = FIELDS
    SENT: ClassVar[Fields] = FIELDS

    alpha: float = parameter("gain on the positions", above=0)
    beta: float = parameter("gain on the velocities", above=0)
    gamma: float = parameter("gain on the accelerations", above=0)

    def flow(self, x: Values, dt: float) -> Values:
        """Return the state a time later, under a constant acceleration."""
        return x.replace(
            position=x.position + dt * (x.velocity + dt / 2 * x.acceleration),
            velocity=x.velocity + dt * x.acceleration,
        )

    def receive(self, now: Now, x: Values, received: Received) -> Values:  # noqa: ARG002
        """Return the state right after t_k."""
        gains = {"position": self.alpha, "velocity": self.beta, "acceleration": self.gamma}
        return x.replace(
            **{
                name: x[name] + gain * received.disagreement(name, x[name])
                for name, gain in gains.items()
            }
        )

    def modes(self, spectrum: Spectrum, h: float) -> Spectrum:  # noqa: ARG002
        """Return the roots 1 − g + g s_i of each gain g."""
        gains = (self.alpha, self.beta, self.gamma)
        return np.concatenate([1 - gain * (1 - spectrum) for gain in gains])

    def conditions(self, spectrum: Spectrum, h: float) -> list[Condition]:  # noqa: ARG002
        """Return Theorem 1's bound on each gain."""
        bound = smallest_theta(spectrum)
        return [
            Condition(name, "as Theorem 1, equation 0.8", getattr(self, name), bound)
            for name in ("alpha", "beta", "gamma")
        ]
