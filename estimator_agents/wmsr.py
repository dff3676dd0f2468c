"""W-MSR: consensus by means from which outliers are left out, so that some may lie.

H. J. LeBlanc, H. Zhang, X. Koutsoukos, S. Sundaram, Resilient asymptotic consensus in robust
networks, IEEE Journal on Selected Areas in Communications 31(4), 766-781, 2013. At t_k a robot
leaves out the F largest of the values above its own, or all if there are fewer, and the F smallest
of those below, on each axis, and takes the mean of its own and what is left, J_i:

    ε_i⁺ = (ε_i + Σ_{j in J_i} ε_j) / (1 + |J_i|),   and so υ_i⁺

Where at most F in-neighbours of each robot lie, the others stay within the interval of their own
values; they agree where the digraph is (F + 1, F + 1)-robust. A target's value is a sensor's
reading: it is trusted, and never left out, unless the scenario says otherwise.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nrs_cosim.estimator_agents.algorithm import Algorithm, Missing
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.parameters import parameter
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.values import Values


@dataclass(frozen=True, slots=True)
class Wmsr(Algorithm):
    """Weighted mean-subsequence-reduced consensus, with equal weights."""

    MISSING: ClassVar[tuple[Missing, ...]] = ("drop", "hold")

    F: int = parameter("how many in-neighbours of a robot may lie", 1, least=0)
    trusts_target: bool = parameter("whether the target's own value is never left out", True)

    def receive(self, now: Now, x: Values, received: Received) -> Values:  # noqa: ARG002
        """Return the state right after t_k."""
        trusted = received.source == 0 if self.trusts_target else None
        after = {}
        for name, own in (("position", x.position), ("velocity", x.velocity)):
            kept = received.trim(received.samples[name], own, self.F, trusted)
            apart = np.where(kept, received.difference(name, own), 0.0)
            after[name] = own + received.sum(apart) / (1 + received.sum(kept.astype(float)))
        return x.replace(**after)
