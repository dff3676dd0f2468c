"""What a robot runs beside its own algorithm looks at the target, and moves on, for itself."""

from dataclasses import dataclass

import numpy as np
import pytest

from nrs_cosim.bus.clock import Clock
from nrs_cosim.bus.lies import Lie, Lies
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Algorithm
from nrs_cosim.estimator_agents.lying_agents import LyingAgents, OtherAlgorithm
from nrs_cosim.estimator_agents.values import Values
from tests.estimator_agents.agents_without_bus import agents_at, meet

CLOCK = Clock((100_000_000, 400_000_000, 900_000_000), 1, 100)
"""Periods of 0.1 s, 0.3 s and 0.5 s in turn."""
SEEN, WEIGHTS = 7.0, {"position": 1.0, "velocity": 0.5}


@dataclass(frozen=True)
class Still(Algorithm):
    """Stays what it is."""

    def receive(self, now, x, received):  # noqa: ARG002
        return x


@dataclass(frozen=True)
class Looking(Still):
    """Takes the target's position where it sees it."""

    def observe(self, now, x, measured, pinned):  # noqa: ARG002
        return x.replace(position=np.where(pinned[:, None], measured.position, x.position))


def lying(own, *by):
    """Return two robots, of which 1 alone is pinned, and lies to 2 by other algorithms."""
    topologies = TopologySchedule.constant(Topology.of_edges(2, [0, 1], [1, 2], np.ones(2)))
    start = Values(position=np.array([[1.0], [2.0]]), velocity=np.array([[0.5], [0.0]]))
    mine, robots = [Lie(number, "algorithm", {}) for number in range(len(by))], np.array([1, 2])
    others = [
        OtherAlgorithm(
            lie,
            agents_at([1], topologies, other, start.at([0]), ticks=CLOCK),
            True,
            frozenset({1}),
        )
        for lie, other in zip(mine, by, strict=True)
    ]
    lies = Lies(0, [mine, []], robots)
    return LyingAgents(others, robots, topologies, own, start, CLOCK, None, "hold", 0, lies)


@pytest.mark.parametrize("own", [Still(), Looking()], ids=["blind", "looks"])
@pytest.mark.parametrize("other", [Still(), Looking()], ids=["lies blind", "lies by looking"])
def test_each_of_its_algorithms_looks_if_it_does(own, other):
    agents = lying(own, other)
    assert agents.observes == (Looking() in (own, other))
    left = agents.left(0.1)
    agents.receive(1, np.array([0]), {name: np.array([[SEEN]]) for name in WEIGHTS})
    left = agents.observe(1, left) if agents.observes else left
    after, messages, who = agents.send(1, left)
    assert messages.position.tolist() == [[SEEN if other == Looking() else 1.05], [2.0]]
    assert after.position.tolist() == [[SEEN if own == Looking() else 1.05], [2.0]]
    assert who is None


def test_one_of_several_that_looks_is_waited_for():
    assert lying(Still(), Still(), Looking()).observes


def test_it_moves_on_by_the_periods_as_they_are():
    agents, t = lying(Still(), Still()), 0.0
    for k, h in enumerate((0.1, 0.3, 0.5, 0.1, 0.3), 1):
        t += h
        left = agents.left(h)
        _, messages, _ = agents.send(k, left)
        np.testing.assert_allclose(messages.position, left.position, rtol=1e-14)
        assert messages.position[0, 0] == pytest.approx(1 + 0.5 * t)
        meet([agents], k, h, {name: np.zeros(1) for name in WEIGHTS})
