"""What velocities of `sliding` come to at most, of robots none of which receives in a loop (W5)."""

import numpy as np

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.sliding import Sliding
from nrs_cosim.orchestrator.analysis.convergence import periods_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment

DEEPEST = 1000
"""Edges of a path that are followed."""


def sliding_velocity(experiment: Experiment) -> float | None:
    """Return ℓ (β + h γ2) of the longest path ℓ, over sound links; None where it is not proven."""
    algorithm, topologies = experiment.algorithm, experiment.topologies
    troubled = experiment.impaired or experiment.byzantine or topologies.switching
    if not isinstance(algorithm, Sliding) or troubled:
        return None
    change = periods_of(experiment).longest * experiment.target.bounds()[1]
    depth = longest_path(topologies.exchanges[-1].velocity)
    if depth is None or not algorithm.beta > change:
        return None
    return depth * (algorithm.beta + change)


def longest_path(topology: Topology) -> int | None:
    """Return how many edges the longest path from the target has; None of a loop, or of too many.

    None too where a robot is not reached, which A2 wants.
    """
    depth = np.where(np.arange(topology.n + 1) > 0, -1, 0)
    for _ in range(min(DEEPEST, topology.n) + 1):
        reached, before = depth[topology.source] >= 0, depth.copy()
        longer = depth[topology.source[reached]] + 1
        np.maximum.at(depth, topology.sink[reached], longer)
        if np.array_equal(depth, before):
            return int(depth.max()) if (depth >= 0).all() else None
    return None
