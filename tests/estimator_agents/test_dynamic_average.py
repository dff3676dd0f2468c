"""Robots come to the average of their own signals, or stay off it by what is known."""

import numpy as np
import pytest

from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dynamic_average import DynamicAverage
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import measure
from nrs_cosim.recordings.mcap.reader import Reader
from tests.estimator_agents.agents_without_bus import agents_at, meet
from tests.scenarios import example

H = 0.1
PI = DynamicAverage(0.5, 0.1, 0.15)
PROPORTIONAL = DynamicAverage(0.0, 0.12, follows_signal=True)


def network(rng, n):
    """Return a connected graph of robots, links both ways, of which the target reaches one."""
    pairs = {(int(rng.integers(1, i)), i) for i in range(2, n + 1)}
    pairs |= {
        (min(a, b), max(a, b)) for a, b in rng.integers(1, n + 1, (2 * n, 2)).tolist() if a != b
    }
    edges = [(0, 1), *pairs, *((b, a) for a, b in pairs)]
    source, sink = np.array(sorted(edges, key=lambda edge: edge[::-1])).T
    return Topology.of_edges(n, source, sink, rng.uniform(0.5, 2, len(source)))


def laplacian(topology):
    L = np.zeros((topology.n, topology.n))
    for j, i in zip(topology.source - 1, topology.sink - 1, strict=True):
        if j >= 0:
            L[i, j] -= 1
            L[i, i] += 1
    return L


def estimates(algorithm, topology, start, ticks):
    """Return the left limits of the estimates at the last tick, (n, m)."""
    robots = np.arange(1, topology.n + 1)
    agents = agents_at(robots, TopologySchedule.constant(topology), algorithm, start)
    m = start["signal"].shape[1]
    for k in range(1, ticks + 1):
        left = agents.left(H)
        meet([agents], k, H, {"position": np.full(m, 1e3), "integral": np.zeros(m)})
    return left.position


@pytest.mark.parametrize("seed", range(3))
def test_the_pi_estimator_finds_the_average_from_anywhere(seed):
    rng = np.random.default_rng(seed)
    names = ("position", "velocity", "signal", "integral")
    start = {name: rng.normal(size=(5, 2)) * 5 for name in names}
    found = estimates(PI, network(rng, 5), start, 600)
    np.testing.assert_allclose(found, [start["signal"].mean(axis=0)] * 5, rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_proportional_one_keeps_what_it_began_with(seed):
    rng = np.random.default_rng(seed)
    signal, off = rng.normal(size=(2, 5, 2)) * 5
    topology, zeros = network(rng, 5), np.zeros((5, 2))
    for error in (zeros, off):
        start = {"position": signal + error, "velocity": zeros, "signal": signal}
        found = estimates(PROPORTIONAL, topology, start, 600)
        expected = (signal + error).mean(axis=0)
        np.testing.assert_allclose(found, [expected] * 5, rtol=0, atol=1e-9)


def test_of_signals_that_move_they_are_off_by_what_the_laplacian_says():
    """Of ramps: h L⁺ (ρ − ρ̄)/k_p, and γ h (L⁺)² (ρ − ρ̄)/k_i² − h ρ̄/γ."""
    rng = np.random.default_rng(3)
    topology, ticks = network(rng, 5), 600
    signal, rate = rng.normal(size=(2, 5, 1))
    inverse, mean = np.linalg.pinv(laplacian(topology)), rate.mean()
    start = {"position": signal, "signal": signal, "signal_rate": rate, "velocity": rate}
    average = signal.mean() + ticks * H * mean
    found = estimates(PROPORTIONAL, topology, start, ticks)
    expected = average + H * inverse @ (rate - mean) / PROPORTIONAL.kp
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
    found = estimates(PI, topology, start, ticks)
    apart = PI.gamma * H * inverse @ inverse @ (rate - mean) / PI.ki**2
    np.testing.assert_allclose(found, average + apart - H * mean / PI.gamma, rtol=0, atol=1e-8)


def test_its_conditions_hold_exactly_where_its_recursion_is_stable():
    rng = np.random.default_rng(5)
    many = np.zeros(2, int)
    for _ in range(300):
        n = int(rng.integers(2, 7))
        topology = network(rng, n)
        gamma, kp, ki = rng.uniform(0.01, [2.5, 0.8, 0.6])
        L, unit = laplacian(topology), np.eye(n)
        A = np.block([[(1 - gamma) * unit - kp * L, ki * L], [-ki * L, unit]])
        sizes = np.sort(abs(np.linalg.eigvals(A)))  # the sum of all integrals never changes
        stable = sizes[-1] < 1 + 1e-9 and sizes[-2] < 1
        of_gains = DynamicAverage(gamma, kp, ki).graph_conditions(topology, frozenset())
        assert all(condition.holds for condition in of_gains) == stable
        many[int(stable)] += 1
    assert many.min() > 50


def test_links_one_way_and_robots_in_two_parts_are_told():
    one_way = Topology.of_edges(3, [0, 1, 2, 1], [1, 2, 1, 3], np.ones(4))
    apart = Topology.of_edges(4, [0, 2, 1, 0, 4, 3], [1, 1, 2, 3, 3, 4], np.ones(6))
    for topology, violated in ((one_way, "one-way links"), (apart, "parts")):
        found = PI.graph_conditions(topology, frozenset())
        assert [condition.name for condition in found if not condition.holds] == [violated]


def test_of_many_robots_gains_are_held_against_any_laplacian_of_such_a_degree():
    n = 150
    ring = [(i % n + 1, (i + 1) % n + 1) for i in range(n)]
    source, sink = np.array(sorted([(0, 1), *ring, *((b, a) for a, b in ring)])).T
    topology = Topology.of_edges(n, source, sink, np.ones(len(source)))
    of_gains = {c.name: c for c in PI.graph_conditions(topology, frozenset())}
    whole = of_gains["gamma + kp l"]
    assert (whole.left, whole.right) == pytest.approx((0.5 + 0.1 * 4, 2 + 0.6**2 / 2))
    assert of_gains["ki"].right == pytest.approx((0.5 + 0.1 * 4) ** 0.5 / 4)
    assert all(condition.holds for condition in of_gains.values())


def test_the_example_meets_at_the_average(tmp_path):
    experiment = example("average_pi")
    with Reader(run(experiment, tmp_path / "run.mcap").path) as reader:
        assert measure(reader, experiment).position_estimate < 1e-9
