"""The integral takes away what the first-order DCEA leaves behind; its bound is the true one."""

import numpy as np
import pytest

from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.pi_consensus import PIConsensus
from tests.estimator_agents.agents_without_bus import agents_at, meet, whole
from tests.estimator_agents.paper import PAPER

H = 0.1


def path(n):
    return TopologySchedule.constant(
        Topology.of_edges(n, np.arange(n), np.arange(1, n + 1), np.ones(n))
    )


def parabola(t):
    """Return the sample of a target of constant acceleration 2."""
    return {"position": np.array([t**2]), "velocity": np.array([2 * t])}


def errors_of(algorithm, n, ticks):
    """Return the errors of position and velocity at the last sampling time, before the jump."""
    zeros = {"position": np.zeros((n, 1)), "velocity": np.zeros((n, 1))}
    agents = agents_at(np.arange(1, n + 1), path(n), algorithm, zeros)
    for k in range(1, ticks + 1):
        left = agents.left(H)
        meet([agents], k, H, parabola(k * H))
    target = parabola(ticks * H)
    return left.position[:, 0] - target["position"], left.velocity[:, 0] - target["velocity"]


def test_one_robot_is_exact_where_the_dcea_is_left_behind():
    position, velocity = errors_of(FirstOrder(0.5, 0.5), 1, 300)
    assert (position[0], velocity[0]) == pytest.approx((-0.06, -0.4), abs=1e-9)
    position, velocity = errors_of(PIConsensus(0.5, 0.5, 0.1), 1, 300)
    assert (position[0], velocity[0]) == pytest.approx((0.0, -0.4), abs=1e-9)


def test_on_a_path_all_positions_are_exact():
    position, velocity = errors_of(PIConsensus(0.5, 0.5, 0.1), 3, 1000)
    np.testing.assert_allclose(position, 0, atol=1e-8)
    np.testing.assert_allclose(velocity, [-0.4, -0.8, -1.2], rtol=1e-9)


def test_the_modes_of_one_robot_are_those_by_hand():
    modes = PIConsensus(0.5, 0.5, 0.1).modes(np.zeros(1, complex), H)
    np.testing.assert_allclose(sorted(abs(modes)), [0.5, 0.5**0.5, 0.5**0.5])


def digraph(rng, n):
    """Return D of a random digraph that the target reaches, and its spectrum."""
    w = rng.uniform(0.2, 2, (n, n)) * (rng.random((n, n)) < 0.4)
    np.fill_diagonal(w, 0)
    pinned = rng.uniform(0.2, 2, n) * (rng.random(n) < 0.5)
    pinned[0] = 1.0
    for i in range(1, n):
        w[i, i - 1] = max(w[i, i - 1], 0.3)
    D = w / (w.sum(axis=1) + pinned)[:, None]
    return D, np.linalg.eigvals(D).astype(complex)


@pytest.mark.parametrize("seed", range(20))
def test_within_its_bounds_it_converges_and_beyond_each_it_does_not(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 7))
    D, spectrum = digraph(rng, n)
    L, one = np.eye(n) - D, np.eye(n)
    theta = (2 / (1 - spectrum)).real.min()
    alpha = rng.uniform(0.1, 0.95) * theta

    def radius(alpha, kappa):
        A = np.block([[one - (alpha + kappa) * L, kappa * one], [-L, one]])
        return max(abs(np.linalg.eigvals(A)))

    own = {c.name: c for c in PIConsensus(alpha, 0.5, 1.0).conditions(spectrum, H)}
    bound = own["kappa"].bound
    assert own["alpha"].bound == pytest.approx(theta)
    assert bound > 0
    assert radius(alpha, bound * (1 - 1e-4)) < 1 < radius(alpha, bound * (1 + 1e-4))
    assert radius(theta * (1 + 1e-4), bound * 1e-3) > 1
    modes = PIConsensus(alpha, 0.5, bound / 2).modes(spectrum, H)[: 2 * n]
    assert max(abs(modes)) == pytest.approx(radius(alpha, bound / 2), rel=1e-6)


def test_any_partition_of_the_robots_gives_the_same_bits():
    topology = TopologySchedule.constant(Topology.of(*PAPER))
    rng = np.random.default_rng(1)
    start = {name: rng.normal(size=(6, 2)) for name in ("position", "velocity")}
    found = []
    for partition in ([[1, 2, 3, 4, 5, 6]], [[2, 5], [1, 3, 4, 6]]):
        agents = [
            agents_at(
                np.array(robots),
                topology,
                PIConsensus(0.5, 0.5, 0.1),
                {name: value[np.array(robots) - 1] for name, value in start.items()},
            )
            for robots in partition
        ]
        for k in range(1, 21):
            target = {"position": np.full(2, k * H), "velocity": np.ones(2)}
            meet(agents, k, H, target)
        found.append([whole(agents, name).tobytes() for name in agents[0].state])
    assert found[0] == found[1]
