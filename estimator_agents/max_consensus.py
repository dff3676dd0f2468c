"""Max-consensus: all robots come to the largest of the values that they have at t_0.

    v_i⁺ = max(v_i, max_j v_j) on each axis,   ε_i⁺ = v_i⁺,  υ_i⁺ = 0

After as many ticks as the longest of the shortest paths between robots has edges, all have it. The
values are the scenario's `[initial] value`; a robot then goes to where the largest is. The target
has no value, and counts for nothing.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nrs_cosim.bus.fields import ESTIMATE, Field, Fields
from nrs_cosim.estimator_agents.algorithm import Algorithm
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.values import Values

VALUE = Field(doc="the largest value that is known")


@dataclass(frozen=True, slots=True)
class MaxConsensus(Algorithm):
    """Agreement on the largest value."""

    STATE: ClassVar[Fields] = {**ESTIMATE, "value": VALUE}
    SENT: ClassVar[Fields] = {"value": VALUE}

    def receive(self, now: Now, x: Values, received: Received) -> Values:  # noqa: ARG002
        """Return the state right after t_k."""
        of_robots = np.where(received.source[:, None] > 0, received.samples.value, -np.inf)
        value = np.maximum(x.value, received.maximum(of_robots))
        return x.replace(value=value, position=value, velocity=np.zeros_like(value))
