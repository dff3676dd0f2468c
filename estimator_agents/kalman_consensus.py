"""The Kalman consensus filter, after Olfati-Saber: neighbours share what they measured.

R. Olfati-Saber, Distributed Kalman filtering for sensor networks, 46th IEEE Conference on Decision
and Control, 5492-5498, 2007; and Kalman-consensus filter: optimality, stability, and performance,
48th, 7036-7042, 2009, from which the size of the pull is. Each robot has a Kalman filter of a
target that it takes to move at nearly constant velocity, its acceleration being a white noise of
density q, on every axis alike:

    x = [ε; υ],   F = [[1, τ], [0, 1]],   Q = q [[τ³/3, τ²/2], [τ²/2, τ]],   H = [1, 0]

Between sampling times x_i ← F x_i and P_i ← F P_i Fᵀ + Q, over any time τ. A pinned robot measures
the target's position, z = H x_0 + v with v of variance r, and sends its information u_i = Hᵀ z/r
and U_i = Hᵀ H/r with its estimate; one that is not pinned sends zeros. At t_k, of itself and of the
robots j from which it receives,

    y_i = u_i + Σ_j u_j,   S_i = U_i + Σ_j U_j,   P_i⁺ = (P_i⁻¹ + S_i)⁻¹
    x_i⁺ = x_i + P_i⁺ (y_i − S_i x_i) + γ_i P_i⁺ Σ_j (x_j − x_i),   γ_i = ε/(1 + ‖P_i⁺‖)

with the Frobenius norm. Of u_i one row is not zero and of U_i one number, which alone are sent; and
P_i⁺ is P_i − P_i Hᵀ H P_i s/(1 + s H P_i Hᵀ), with s that number of S_i. Weights of the digraph are
of no account, and the target's own sample is only measured. A sample that is late or lost is left
out, since old information must not count again.

Without a pull, ε = 0, P_i obeys the Riccati equation of one sensor whose variance is r over the
number of those in the neighbourhood that measure. A robot that neither measures nor receives from
one that does has no information: its P_i grows for ever, and its estimate follows the pull alone.
No condition is computed: the filter is the best one where q and r are true and no measurement
comes to a robot in two ways, and neither is checked. Nor is that ε is small: a pull of more than 1
over the number of robots that one receives from may overshoot. x_i⁺ is not linear in x_i and P_i:
there are no modes.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nrs_cosim.bus.fields import ESTIMATE, Field, Fields
from nrs_cosim.estimator_agents.algorithm import Algorithm, Mask, Missing
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.parameters import parameter
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.values import Values

_INFORMATION: Fields = {
    "information": Field(doc="u, the measured position over its variance"),
    "precision": Field((), doc="U, one over that variance; 0 where nothing is measured"),
}


@dataclass(frozen=True, slots=True)
class KalmanConsensus(Algorithm):
    """A Kalman filter for each robot, of a target of nearly constant velocity."""

    STATE: ClassVar[Fields] = {
        **ESTIMATE,
        "position_variance": Field((), initial=100.0, doc="of the estimated position, any axis"),
        "covariance": Field((), doc="of the estimated position and velocity"),
        "velocity_variance": Field((), initial=100.0, doc="of the estimated velocity"),
        **_INFORMATION,
    }
    SENT: ClassVar[Fields] = {**ESTIMATE, **_INFORMATION}
    MISSING: ClassVar[tuple[Missing, ...]] = ("drop",)

    q: float = parameter("density of the acceleration's noise", unit="rad^2/s^3", above=0)
    r: float = parameter("variance of a measured position", unit="rad^2", above=0)
    epsilon: float = parameter("pull of the neighbours' estimates", 0.1, least=0)

    def flow(self, x: Values, dt: float) -> Values:
        """Return the state a time later: variances grow."""
        a, b, c = x["position_variance"], x["covariance"], x["velocity_variance"]
        return x.replace(
            position=x.position + dt * x.velocity,
            position_variance=a + dt * (2 * b + dt * (c + self.q * dt / 3)),
            covariance=b + dt * (c + self.q * dt / 2),
            velocity_variance=c + self.q * dt,
        )

    def measure(self, now: Now, target: Values) -> Values:
        """Return the target's position with noise of variance r on every axis."""
        noise = now.normal("measured position", target.position.shape[-1])
        return target.replace(position=target.position + np.sqrt(self.r) * noise)

    def observe(self, now: Now, x: Values, measured: Values, pinned: Mask) -> Values:  # noqa: ARG002
        """Return the state with the information of t_k: none, of robots that measure nothing."""
        return x.replace(
            information=np.where(pinned[:, None], measured.position / self.r, 0.0),
            precision=np.where(pinned, 1 / self.r, 0.0),
        )

    def receive(self, now: Now, x: Values, received: Received) -> Values:  # noqa: ARG002
        """Return the state right after t_k."""
        y = x["information"] + received.sum(received.samples["information"])
        s = x["precision"] + received.sum(received.samples["precision"])
        a, b, c = x["position_variance"], x["covariance"], x["velocity_variance"]
        rest = 1 / (1 + s * a)
        a, b, c = rest * a, rest * b, c - s * rest * (b * b)
        robots = (received.source > 0)[:, None]
        apart = [
            received.sum(np.where(robots, received.difference(name, x[name]), 0.0))
            for name in ("position", "velocity")
        ]
        gain = self.epsilon / (1 + np.sqrt(a * a + 2 * (b * b) + c * c))
        innovation = y - s[:, None] * x.position
        push = innovation + gain[:, None] * apart[0], gain[:, None] * apart[1]
        return x.replace(
            position=x.position + (a[:, None] * push[0] + b[:, None] * push[1]),
            velocity=x.velocity + (b[:, None] * push[0] + c[:, None] * push[1]),
            position_variance=a,
            covariance=b,
            velocity_variance=c,
        )
