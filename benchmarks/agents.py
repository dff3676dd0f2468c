"""What agents do at a sampling time, beside the bare arithmetic of the same estimates.

First-order DCEA of a thousand robots, of which each receives from four: the bare loop gathers what
is sent, sums it by robot, and adds; agents do that behind what an algorithm declares, by a native
call as in a run.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from nrs_cosim.bus.clock import Clock
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.values import Values
from nrs_cosim.orchestrator.engine.native.tick import NativeDisagreements, load_tick

N, IN_NEIGHBOURS, M, H, TICKS = 1000, 4, 2, 0.1, 60
ALPHA, BETA = 0.7, 0.6


def _topology() -> Topology:
    rng = np.random.Generator(np.random.Philox(1))
    sink = np.repeat(np.arange(1, N + 1), IN_NEIGHBOURS)
    others = (np.delete(np.arange(N + 1), robot) for robot in range(1, N + 1))
    source = np.concatenate(
        [np.sort(rng.choice(of, IN_NEIGHBOURS, replace=False)) for of in others]
    )
    return Topology.of_edges(N, source, sink, np.ones(len(sink)))


def _start() -> Values:
    rng = np.random.Generator(np.random.Philox(2))
    return Values(position=rng.normal(size=(N, M)), velocity=rng.normal(size=(N, M)))


TOPOLOGY, START = _topology(), _start()


def bare() -> Values:
    """Return the estimates after some ticks, by arithmetic alone."""
    source, row = TOPOLOGY.source, TOPOLOGY.sink - 1
    weight, first = TOPOLOGY.normalised[:, None], np.searchsorted(row, np.arange(N))
    position, velocity = START.position, START.velocity
    sent_positions, sent_velocities = np.zeros((2, N + 1, M))
    for _ in range(TICKS):
        position = position + H * velocity
        sent_positions[1:], sent_velocities[1:] = position, velocity
        apart = sent_positions[source] - position[row]
        veer = sent_velocities[source] - velocity[row]
        position = position + ALPHA * np.add.reduceat(weight * apart, first, axis=0)
        velocity = velocity + BETA * np.add.reduceat(weight * veer, first, axis=0)
    return Values(position=position, velocity=velocity)


def prepared() -> Callable[[], Values]:
    """Return what lets agents do the same, and returns their estimates."""
    topologies = TopologySchedule.constant(TOPOLOGY)
    robots, clock = np.arange(1, N + 1), Clock((round(H * 1e9),), 1, TICKS)
    still = {name: np.zeros((1, M)) for name in START}
    native = load_tick()

    def run() -> Values:
        agents = Agents(robots, topologies, FirstOrder(ALPHA, BETA), START, clock)
        if native:
            agents.disagree_by(partial(NativeDisagreements, native))
        for k in range(1, TICKS + 1):
            agents.receive(k, np.array([0]), still)
            left, messages, _ = agents.send(k, agents.left(H))
            agents.receive(k, robots, messages)
            agents.jump(k, left)
        return agents.state

    return run
