"""What errors of `sliding` come to at most, of robots none of which receives in a loop (W5)."""

from math import inf

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.sliding import Sliding
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.orchestrator.analysis.convergence import periods_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment

DEEPEST = 1000
"""Edges of a path that are followed."""


def sliding_bounds(experiment: Experiment) -> EstimateBounds | None:
    """Return the most of ℓ (β + h γ2), ℓ the longest path, and of positions, over sound links.

    None where it is not proven; infinite for positions where that is not proven of these.
    """
    algorithm, topologies = experiment.algorithm, experiment.topologies
    troubled = experiment.impaired or experiment.byzantine or topologies.switching
    if not isinstance(algorithm, Sliding) or troubled:
        return None
    h = periods_of(experiment).longest
    change = h * experiment.target.bounds()[1]
    last, ones = topologies.exchanges[-1], np.ones(topologies.n)
    depth = heaviest_paths(last.velocity, ones)
    if depth is None or not algorithm.beta > change:
        return None
    velocities = depth * (algorithm.beta + change)
    moved = h * velocities
    positions = None
    if algorithm.alpha > moved.max():
        positions = heaviest_paths(last.position, algorithm.alpha + moved)
    position = inf if positions is None else float(positions.max())
    return EstimateBounds(position, float(velocities.max()))


def heaviest_paths(topology: Topology, weight: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the most that robots, each with its weight, add up to on paths to each, (n,).

    None of a loop, or of too long paths, and where a robot is not reached, which A2 wants.
    """
    most = np.where(np.arange(topology.n + 1) > 0, -inf, 0.0)
    for _ in range(min(DEEPEST, topology.n) + 1):
        before = most.copy()
        np.maximum.at(most, topology.sink, most[topology.source] + weight[topology.sink - 1])
        if np.array_equal(most, before):
            return most[1:] if (most > -inf).all() else None
    return None
