"""Robots that are pinned look at the target before they send: what they see, and when."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from scipy import stats

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.links.links import LinkFault, Links
from nrs_cosim.bus.random_streams import keyed_normal, keyed_uniform
from nrs_cosim.bus.topologies import InteractionGraphs, TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Algorithm
from nrs_cosim.estimator_agents.estimate import Estimate
from tests.estimator_agents.agents_without_bus import CLOCK, agents_at, meet

SEEN = []


@dataclass(frozen=True)
class Looking(Algorithm):
    """Goes to where it saw the target, each robot off by a hundredth of its number."""

    MISSING: ClassVar = ("drop",)

    def measure(self, now, target):
        return target.replace(position=target.position + now.robots[:, None] / 100)

    def observe(self, now, x, measured, pinned):
        SEEN.append((now.k, pinned.tolist(), measured.position[:, 0].tolist()))
        return x.replace(position=np.where(pinned[:, None], measured.position, x.position))

    def receive(self, now, x, received):  # noqa: ARG002
        SEEN.append(received.samples.position[:, 0].tolist())
        return x


TOPOLOGY = Topology.of_edges(3, np.array([0, 0, 1, 2]), np.array([1, 2, 3, 3]), np.ones(4))


def looks(fault=None, ticks=3, schedule=None):
    """Return what is seen tick by tick: by whom, and what is then received."""
    SEEN.clear()
    schedule = schedule or TopologySchedule.constant(TOPOLOGY)
    start = Estimate(np.zeros((3, 1)), np.zeros((3, 1)))
    links = None
    if fault:
        links = Links(
            schedule,
            np.arange(1, 4),
            {(0, 2): fault},
            {},
            ticks=CLOCK,
            seed=3,
            codecs=Codecs.of(Sizes(1)),
        )
    agents = agents_at(np.arange(1, 4), schedule, Looking(), start, links, "drop")
    for k in range(1, ticks + 1):
        target = {"position": np.array([10.0 * k]), "velocity": np.zeros(1)}
        meet([agents], k, 0.1, target)
    return list(SEEN)


def test_each_pinned_robot_sees_what_it_measures_and_sends_it_at_once():
    assert looks(ticks=2) == [
        (1, [True, True, False], [10.01, 10.02, 0.0]),
        [10.01, 10.02, 10.01, 10.02],
        (2, [True, True, False], [20.01, 20.02, 0.0]),
        [20.01, 20.02, 20.01, 20.02],
    ]


def test_over_a_late_link_it_sees_what_arrives_when_it_does():
    story = looks(LinkFault(delay=(2, 2)), ticks=4)[::2]
    assert [pinned for _, pinned, _ in story] == [[True, k > 2, False] for k in range(1, 5)]
    assert [values[1] for _, _, values in story] == [0.0, 0.0, 10.02, 20.02]


def test_over_a_link_that_is_cut_it_sees_nothing():
    cut = LinkFault(outages=((200_000_000, 300_000_000),))
    assert [pinned[1] for _, pinned, _ in looks(cut)[::2]] == [True, False, True]


def test_who_is_pinned_follows_the_digraph_of_the_tick():
    other = Topology.of_edges(3, np.array([3, 1, 0]), np.array([1, 2, 3]), np.ones(3))
    both = [InteractionGraphs.of(topology) for topology in (TOPOLOGY, other)]
    schedule = TopologySchedule.of(both, (1, 2))
    pinned = [pinned for _, pinned, _ in looks(ticks=2, schedule=schedule)[::2]]
    assert pinned == [[True, True, False], [False, False, True]]


# Draws


def test_draws_are_the_same_for_a_robot_whoever_else_is_there():
    together = keyed_uniform(5, "noise", np.arange(1, 101), 7, 3)
    for robot in (1, 42, 100):
        alone = keyed_uniform(5, "noise", np.array([robot]), 7, 3)
        assert alone.tobytes() == together[robot - 1].tobytes()
    others = [
        keyed_uniform(6, "noise", np.arange(1, 101), 7, 3),
        keyed_uniform(5, "other", np.arange(1, 101), 7, 3),
        keyed_uniform(5, "noise", np.arange(1, 101), 8, 3),
        keyed_uniform(5, "noise", np.arange(101, 201), 7, 3),
    ]
    for other in others:
        assert not np.isin(other, together).any()


def test_draws_are_uniform_and_one_does_not_tell_the_next():
    draws = np.concatenate([keyed_uniform(1, "x", np.arange(1, 51), k, 2) for k in range(400)])
    assert draws.min() >= 0
    assert draws.max() < 1
    assert stats.kstest(draws.ravel(), "uniform").pvalue > 1e-3
    cells = np.histogram2d(draws[:, 0], draws[:, 1], bins=20, range=[[0, 1], [0, 1]])[0]
    assert stats.chisquare(cells.ravel()).pvalue > 1e-3


def test_normal_draws_have_mean_0_and_variance_1():
    draws = np.concatenate([keyed_normal(1, "x", np.arange(1, 51), k, 2) for k in range(400)])
    assert np.isfinite(draws).all()
    assert stats.kstest(draws.ravel(), "norm").pvalue > 1e-3
    assert draws.var() == pytest.approx(1, abs=0.02)
