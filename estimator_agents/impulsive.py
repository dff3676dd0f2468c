"""Impulsive consensus on a constant value, after Guan, Liu, Feng and Jian.

Z.-H. Guan, Z.-W. Liu, G. Feng, M. Jian, Impulsive consensus algorithms for second-order multi-agent
networks with sampled information, Automatica 48(7), 1397-1404, 2012. Second-order agents, ε̇_i = υ_i
and υ̇_i = 0 between sampling times, whose velocities are damped by impulses until they rest at a
common position. For a leader from whom some agents receive there is Z.-W. Liu, Z.-H. Guan, H. Zhou,
Impulsive consensus for leader-following multiagent systems with fixed and switching topology,
Mathematical Problems in Engineering 2013, 762861, with a necessary and sufficient condition for one
digraph; of it the abstract was at hand. Here one more node is the target, and weights are divided
by their sum; both are ours, and so is the condition, which is derived and not quoted:

    Δε_i = 0,   Δυ_i = α Σ_j w_ij/ϖ_i (ε_j − ε_i) − β υ_i   at t_k

It uses no velocity. A target that moves at υ_0 is followed at a distance that h does not lessen,
for β drags at the estimates: each of the paper's bounds gains h β γ1 (docs/theory.md).
"""

from dataclasses import dataclass

import numpy as np

from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectrum
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate
from nrs_cosim.estimator_agents.parameters import parameter


@dataclass(frozen=True, slots=True)
class Impulsive(Algorithm):
    """The law with gain α on positions and damping β of the own velocity."""

    alpha: float = parameter("gain on the positions", unit="1/s", above=0)
    beta: float = parameter("damping of the own velocity, at each sampling time", above=0)

    def jump(self, estimate: Estimate, disagreement: Disagreement) -> Estimate:
        """Return the estimate right after t_k."""
        return Estimate(
            estimate.position,
            estimate.velocity
            + (self.alpha * disagreement.position - self.beta * estimate.velocity),
        )

    def modes(self, spectrum: Spectrum, h: float) -> Spectrum:
        """Return the roots of λ² − [2 − β − α h (1 − s_i)] λ + 1 − β."""
        half = 1 - (self.beta + self.alpha * h * (1 - spectrum)) / 2
        root = np.sqrt(half**2 - 1 + self.beta)
        return np.concatenate([half + root, half - root])

    def conditions(self, spectrum: Spectrum, h: float) -> list[Condition]:
        """Return β < 2, and with R + j I = 1 − s_i, by the test of Schur and Cohn,

        h < min 2 β² (2 − β) R / (α [β² R² + (2 − β)² I²]).
        """
        away, beta = 1 - spectrum, self.beta
        size = self.alpha * (
            (beta * beta) * away.real**2 + ((2 - beta) * (2 - beta)) * away.imag**2
        )
        bounds = 2 * (beta * beta) * (2 - beta) * away.real / size
        return [
            Condition("beta", "Schur and Cohn", beta, 2.0),
            Condition("sampling_period", "Schur and Cohn", h, float(bounds.min())),
        ]
