"""Dynamic average consensus: the average of signals of which each robot has its own.

R. A. Freeman, P. Yang, K. M. Lynch, Stability and convergence properties of dynamic average
consensus estimators, 45th IEEE Conference on Decision and Control, 338-343, 2006, and S. S. Kia,
B. Van Scoy, J. Cortés, R. A. Freeman, K. M. Lynch, S. Martínez, Tutorial on dynamic average
consensus, IEEE Control Systems Magazine 39(3), 40-72, 2019; at sampling times. Robot i has a signal
r_i, which moves at a constant rate, an estimate ε_i and an integral q_i. With sums over the robots
from which it receives, at t_k

    ε_i⁺ = ε_i + γ (r_i − ε_i) + k_p Σ_j (ε_j − ε_i) − k_i Σ_j (q_j − q_i)
    q_i⁺ = q_i + k_i Σ_j (ε_j − ε_i)

The *PI estimator* has γ, k_p, k_i > 0: whatever ε and q are at first, ε_i comes to the average of
signals that stand still, and is off by constants where they move. The *proportional* one, γ = k_i
= 0, starts at ε_i = r_i and moves with r_i in between, υ_i = ṙ_i (`follows_signal`): the sum of
all ε_i − r_i stays what it was, and so does any error in it.

Robots receive from one another both ways, and are connected; the target has no share in it. On an
eigenvector of the Laplacian with l the recursion is [[1 − γ − k_p l, k_i l], [−k_i l, 1]]. For
l > 0 its eigenvalues are within the unit circle if and only if, by Schur and Cohn,

    γ + k_p l < 2 + k_i² l²/2   and   k_i² l² < γ + k_p l,

the second for k_i > 0: of all l if of the largest. Of the first a smaller l may be the worst, and
γ < 2 is that of l = 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nrs_cosim.bus.fields import ESTIMATE, Field, Fields
from nrs_cosim.bus.matrices import FEW, as_array, components, matrix_of
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Algorithm
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.parameters import parameter
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.values import Values

INTEGRAL = Field(doc="sum of the disagreements between robots")


@dataclass(frozen=True, slots=True)
class DynamicAverage(Algorithm):
    """The average of the robots' own signals, by a PI or a proportional estimator."""

    STATE: ClassVar[Fields] = {
        **ESTIMATE,
        "signal": Field(doc="the robot's own signal, of all of which the average is sought"),
        "signal_rate": Field(doc="how fast it moves"),
        "integral": INTEGRAL,
    }
    SENT: ClassVar[Fields] = {"position": ESTIMATE["position"], "integral": INTEGRAL}

    gamma: float = parameter("gain on the own signal", least=0)
    kp: float = parameter("gain on the disagreement between robots", above=0)
    ki: float = parameter("gain on its integral", 0.0, least=0)
    follows_signal: bool = parameter("whether an estimate moves with its own signal", False)

    def flow(self, x: Values, dt: float) -> Values:
        """Return the state a time later."""
        moved = Algorithm.flow(self, x, dt)
        return moved.replace(signal=x.signal + dt * x.signal_rate)

    def receive(self, now: Now, x: Values, received: Received) -> Values:  # noqa: ARG002
        """Return the state right after t_k."""
        of_robots = received.source[:, None] > 0
        apart, integrals = (
            received.sum(np.where(of_robots, received.difference(name, x[name]), 0.0))
            for name in self.SENT
        )
        pull = self.gamma * (x.signal - x.position)
        return x.replace(
            position=x.position + (pull + self.kp * apart - self.ki * integrals),
            velocity=x.signal_rate if self.follows_signal else np.zeros_like(x.velocity),
            integral=x.integral + self.ki * apart,
        )

    def graph_conditions(
        self,
        topology: Topology,
        byzantine: frozenset[int],  # noqa: ARG002
    ) -> Sequence[Condition]:
        """Return that links go both ways, that robots are connected, and the bounds on gains.

        Of more than 100 robots they are of any l up to twice the largest number of links of one.
        """
        n, among = topology.n, topology.source > 0
        source, sink = topology.source[among] - 1, topology.sink[among] - 1
        there = {*zip(source.tolist(), sink.tolist(), strict=True)}
        one_way = sum((j, i) not in there for i, j in there)
        links = matrix_of(sink, source, np.ones(len(sink)), n)
        most = 2.0 * np.bincount(sink, minlength=n).max()
        modes = np.array([0.0, min(most, self.kp / self.ki**2) if self.ki else most, most])
        if n <= FEW:
            L = np.diag(np.bincount(sink, minlength=n)) - as_array(links)
            modes = np.linalg.eigvalsh((L + L.T) / 2).clip(0)
        whole, bound = self.gamma + self.kp * modes, 2 + (self.ki * modes) ** 2 / 2
        worst = int((whole - bound).argmax())
        with np.errstate(divide="ignore"):
            of_integral = np.sqrt(whole[-1]) / modes[-1]
        source_of = "Schur and Cohn, l of the Laplacian"
        return [
            Condition("one-way links", "none among robots", one_way, 1),
            Condition("parts", "one, of robots", len(components(links + links.T)), 2),
            Condition("gamma + kp l", source_of, float(whole[worst]), float(bound[worst])),
            Condition("ki", source_of, self.ki, float(of_integral)),
        ]
