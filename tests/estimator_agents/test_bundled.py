"""Bundled algorithms that keep, send or receive more than an estimate, against values by hand."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.links.links import LinkFault, Links
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea3 import ThirdOrder
from nrs_cosim.estimator_agents.declarations import wrong_declarations
from nrs_cosim.estimator_agents.edges import field_sizes
from nrs_cosim.estimator_agents.event_triggered import EventTriggered
from nrs_cosim.estimator_agents.installed import algorithm_class, bundled_algorithms
from nrs_cosim.estimator_agents.max_consensus import MaxConsensus
from nrs_cosim.estimator_agents.theory.spectrum import spectrum_of
from nrs_cosim.estimator_agents.values import Values
from tests.bus.test_topology import PAPER
from tests.estimator_agents.agents_without_bus import CLOCK, agents_at, meet, whole

H = 0.1


def schedule(n, edges):
    """Return n robots with edges (j, i) of equal weights."""
    source, sink = np.array(sorted(edges, key=lambda edge: edge[::-1])).T
    topology = Topology.of_edges(n, source, sink, np.ones(len(source)))
    return TopologySchedule.constant(topology)


def chain(n):
    return schedule(n, [(i, i + 1) for i in range(n)])


def complete(n):
    return schedule(n, [(j, i) for i in range(1, n + 1) for j in range(1, n + 1) if i != j])


def links_of(topologies, robots, algorithm, fault=None, seed=0):
    """Return links that all have one fault, or none."""
    sizes = field_sizes(topologies, 1)
    links = zip(topologies.links.source.tolist(), topologies.links.sink.tolist(), strict=True)
    return Links(
        topologies,
        np.asarray(robots),
        dict.fromkeys(links, fault or LinkFault()),
        {},
        ticks=CLOCK,
        seed=seed,
        codecs=Codecs.of(sizes, "Tried", algorithm.SENT, algorithm.STATE),
        every=True,
    )


def made(algorithm, topologies, start, parts=None, fault=None, missing=None, seed=0):
    """Return agents in some parts, with one axis; `start` is by field."""
    parts = parts or [np.arange(1, topologies.n + 1)]
    start = {name: np.asarray(value, float) for name, value in start.items()}
    start.setdefault("position", np.zeros((topologies.n, 1)))
    buffered = fault or algorithm.TRIGGERED or algorithm.ARRIVALS == "every"
    return [
        agents_at(
            robots,
            topologies,
            algorithm,
            {name: value[np.asarray(robots) - 1] for name, value in start.items()},
            links_of(topologies, robots, algorithm, fault, seed) if buffered else None,
            missing or algorithm.MISSING[0],
            seed=seed,
        )
        for robots in parts
    ]


def target_of(algorithm, position=0.0, velocity=0.0, acceleration=0.0):
    """Return what the target sends, on one axis."""
    truths = {"position": position, "velocity": velocity, "acceleration": acceleration}
    return {
        name: np.full([1] * len(field.shape), truths[field.truth] if field.truth else field.initial)
        for name, field in algorithm.SENT.items()
    }


@pytest.mark.parametrize("name", bundled_algorithms())
def test_bundled_classes_declare_nothing_wrong(name):
    assert wrong_declarations(algorithm_class(name)) == []


# Third order


def third_order_errors(n, gains, ticks, jerk=6.0):
    """Return left limits of errors in position, velocity, acceleration, after some ticks."""
    algorithm = ThirdOrder(*gains)
    agents = made(algorithm, chain(n), {})

    def truth(t):
        return jerk * t**3 / 6, jerk * t**2 / 2, jerk * t

    for k in range(1, ticks):
        meet(agents, k, H, target_of(algorithm, *truth(k * H)))
    left = agents[0].left(H)
    names = ("position", "velocity", "acceleration")
    return [left[name][:, 0] - z for name, z in zip(names, truth(ticks * H), strict=True)]


def test_a_target_of_constant_jerk_is_followed_at_the_distance_of_the_recursion():
    """ā = −Jh/γ; what each of the others adds over a period comes off over its gain."""
    position, velocity, acceleration = (float(e[0]) for e in third_order_errors(1, [0.5] * 3, 400))
    assert acceleration == pytest.approx(-1.2, abs=1e-9)
    assert velocity == pytest.approx(-0.18, abs=1e-9)
    assert position == pytest.approx(-0.026, abs=1e-8)


def test_each_hop_of_a_chain_adds_the_same_error_of_the_acceleration():
    errors = third_order_errors(3, [0.5] * 3, 800)[2]
    np.testing.assert_allclose(errors, [-1.2, -2.4, -3.6], atol=1e-8)


def test_with_gains_of_one_a_chain_forgets_its_beginning_in_as_many_ticks_as_it_has_robots():
    rng = np.random.default_rng(3)
    algorithm = ThirdOrder(1, 1, 1)
    start = {name: rng.normal(size=(3, 1)) for name in algorithm.STATE}
    agents = made(algorithm, chain(3), start)
    sizes = []
    for k in range(1, 7):
        meet(agents, k, H, target_of(algorithm))
        sizes.append(max(np.abs(value).max() for value in agents[0].left(H).values()))
    assert min(sizes[:2]) > 1e-3
    assert max(sizes[2:]) < 1e-15


def test_third_order_modes_are_the_eigenvalues_of_the_agents_matrix():
    topologies = TopologySchedule.constant(Topology.of(*PAPER))
    algorithm, n = ThirdOrder(0.7, 0.6, 0.5), 6
    columns = []
    for unit in np.eye(3 * n):
        start = dict(zip(algorithm.STATE, unit.reshape(3, n, 1), strict=True))
        agents = made(algorithm, topologies, start)
        left = agents[0].left(0.0)
        agents[0].receive(1, np.array([0]), {q: v[None] for q, v in target_of(algorithm).items()})
        agents[0].receive(1, np.arange(1, n + 1), left)
        agents[0].jump(1, left)
        columns.append(np.concatenate([v[:, 0] for v in agents[0].left(H).values()]))
    found = np.linalg.eigvals(np.array(columns).T)
    want = algorithm.modes(spectrum_of(topologies.links), H)
    for z in want:
        assert np.abs(found - z).min() < 1e-4  # zero is a multiple eigenvalue of D
    assert np.abs(want).max() == pytest.approx(0.853553390593, abs=1e-10)


# Max-consensus


def test_the_largest_value_reaches_all_of_a_ring_in_one_round():
    ring = schedule(7, [*((i, i % 7 + 1) for i in range(1, 8)), (0, 4)])
    agents = made(MaxConsensus(), ring, {"value": np.arange(7.0)[::-1, None]})
    everywhere = []
    for k in range(1, 9):
        meet(agents, k, 1.0, target_of(MaxConsensus()))
        everywhere.append(bool((whole(agents, "position") == 6).all()))
    assert everywhere.index(True) + 1 == 6


# W-MSR


# Event-triggered


def ramp(algorithm, k):
    return target_of(algorithm, 2 * k * H, 2.0)


def test_event_triggered_estimates_stay_within_the_trigger_bound():
    n, c0 = 6, 0.05
    rng = np.random.default_rng(1)
    start = {"position": rng.normal(size=(n, 1)) * 5, "velocity": rng.normal(size=(n, 1))}
    algorithm = EventTriggered(0.7, 0.6, c0=c0, d0=1e9)
    agents = made(algorithm, chain(n), start)
    worst, sent = np.zeros(n), 0
    for k in range(1, 601):
        if k > 200:
            errors = np.abs(agents[0].left(H).position[:, 0] - 2 * k * H)
            worst = np.maximum(worst, errors)
        sent += len(meet(agents, k, H, ramp(algorithm, k)))
    assert (worst <= c0 * np.arange(n) + 1e-9).all()
    assert n <= sent < 600 * n / 10


def test_a_trigger_of_zero_agrees_with_dcea1():
    topologies = TopologySchedule.constant(Topology.of(*PAPER))
    rng = np.random.default_rng(2)
    start = {name: rng.normal(size=(6, 1)) for name in ("position", "velocity")}
    triggered, plain = EventTriggered(0.7, 0.6, c0=0.0, d0=0.0), FirstOrder(0.7, 0.6)
    parts = made(triggered, topologies, start), made(plain, topologies, start)
    for k in range(1, 101):
        for agents in parts:
            meet(agents, k, H, target_of(plain, 2 * k * H + np.sin(k * H), 2 + np.cos(k * H)))
        ours, theirs = (whole(agents, "position") for agents in parts)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)


def test_the_longest_silence_bounds_the_time_between_messages():
    algorithm = EventTriggered(0.5, 0.5, c0=1e9, d0=1e9, longest_silence=0.25)
    agents = made(algorithm, chain(1), {})
    sent = [k for k in range(1, 20) if len(meet(agents, k, H, ramp(algorithm, k)))]
    assert np.diff(sent).tolist() == [3] * (len(sent) - 1)


@dataclass(frozen=True)
class ThirdOrderTriggered(ThirdOrder):
    """Third order, sent when a guess of constant velocity is off by more than c0."""

    STATE: ClassVar = {**ThirdOrder.STATE, **EventTriggered.STATE}
    TRIGGERED: ClassVar = True

    c0: float = 0.05

    def flow(self, x, dt):
        moved = ThirdOrder.flow(self, x, dt)
        return moved.replace(sent_position=x.sent_position + dt * x.sent_velocity)

    def send(self, now, x):
        sends = np.abs(x.position - x.sent_position).max(axis=1) > self.c0
        sends |= x.sent_at[:, 0] < 0
        fields = {"sent_position": x.position, "sent_velocity": x.velocity}
        fields["sent_at"] = np.full_like(x.sent_at, now.t)
        after = {name: np.where(sends[:, None], new, x[name]) for name, new in fields.items()}
        return x.replace(**after), Values({name: x[name] for name in self.SENT}), sends


@pytest.mark.parametrize(("c0", "gap", "messages"), [(0.05, 3, 21), (0.2, 5, 13)])
def test_the_time_between_messages_agrees_with_the_closed_form(c0, gap, messages):
    """Along t² a guess of constant velocity is off by (j h)² after j ticks."""
    algorithm = ThirdOrderTriggered(1, 1, 1, c0=c0)
    agents = made(algorithm, chain(1), {"acceleration": [[2.0]]})
    sent = []
    for k in range(1, 62):
        t = k * H
        if len(meet(agents, k, H, target_of(algorithm, t**2, 2 * t, 2.0))):
            sent.append(k)
    assert np.diff(sent).tolist() == [gap] * (messages - 1)


# Push-sum


# The same bits, wherever and however often


# Every sample that arrives, or the newest


# Outages, and digraphs that are switched
