"""W-MSR: consensus by means from which outliers are left out, so that some may lie.

H. J. LeBlanc, H. Zhang, X. Koutsoukos, S. Sundaram, Resilient asymptotic consensus in robust
networks, IEEE Journal on Selected Areas in Communications 31(4), 766-781, 2013. At t_k a robot
leaves out the F largest of the values above its own, or all if there are fewer, and the F smallest
of those below, on each axis, and takes the mean of its own and what is left, J_i:

    ε_i⁺ = (ε_i + Σ_{j in J_i} ε_j) / (1 + |J_i|),   and so υ_i⁺

Where at most F in-neighbours of each robot lie, the others stay within the interval of their own
values (statement B1); they agree where the digraph is (F + 1, F + 1)-robust. A target's value is a
sensor's reading: it is trusted, and never left out, unless the scenario says otherwise. Then they
come to a target that moves straight if it reaches all by 2 F + 1 in-neighbours (statement B2).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import ClassVar

import numpy as np

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Algorithm, Missing
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.parameters import parameter
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.theory.robustness import out_of_reach, robustness
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

    def graph_conditions(
        self, topology: Topology, byzantine: frozenset[int]
    ) -> Sequence[Condition]:
        """Return that the digraph among the robots is (F + 1, F + 1)-robust, and F lie at most.

        And that the target reaches all, if it is trusted.
        """
        found = robustness(topology)
        of_liar, to_liar = (
            np.isin(nodes, [*byzantine]) for nodes in (topology.source, topology.sink)
        )
        many = int(np.bincount(topology.sink[of_liar & ~to_liar], minlength=1).max())
        r = nan if found is None else float(found)
        source = "r of (r, r)-robustness, LeBlanc 2013"
        conditions = [
            Condition("F", source, self.F, r, of_liars=True),
            Condition("liars received by one robot", "F + 1", many, self.F + 1, of_liars=True),
        ]
        if self.trusts_target:
            beyond = out_of_reach(topology, 2 * self.F + 1)
            source = "the bound of statement B2"
            conditions.append(Condition("robots not reached", source, beyond, 1, of_liars=True))
        return conditions

    def stays_within(self, liars: int) -> bool:
        """Return that no more lie than outliers are left out."""
        return liars <= self.F
