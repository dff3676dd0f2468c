"""The Kalman consensus filter, against Riccati equations and the matrices of its articles."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.kalman_consensus import KalmanConsensus
from tests.estimator_agents.agents_without_bus import agents_at, meet, whole

H = np.array([[1.0, 0.0]])
VARIANCES = ("position_variance", "covariance", "velocity_variance")


def topology(edges):
    source, sink = np.array(sorted(edges, key=lambda edge: (edge[1], edge[0]))).T
    return TopologySchedule.constant(
        Topology.of_edges(int(sink.max()), source, sink, np.ones(len(sink)))
    )


def complete(n):
    """Every robot receives from every other one, and from the target."""
    return topology([(j, i) for i in range(1, n + 1) for j in range(n + 1) if i != j])


def sample(t, m):
    """Return the sample of a target that moves at a constant velocity."""
    rate = np.array([2.0, -1.0])[:m]
    return {
        "position": rate * t,
        "velocity": rate,
        "information": np.zeros(m),
        "precision": np.zeros(()),
    }


def start(n, m, seed=0):
    rng = np.random.default_rng(seed)
    return {"position": rng.normal(size=(n, m)), "velocity": rng.normal(size=(n, m))}


def model(q, h):
    F = np.array([[1.0, h], [0.0, 1.0]])
    return F, q * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])


@pytest.mark.parametrize(
    ("n", "known"),
    [(1, [0.015072, 0.035305, 0.188449]), (5, [0.004055, 0.014044, 0.119383])],
)
def test_of_n_that_all_share_the_variances_are_those_of_one_sensor_n_times_as_good(n, known):
    q, r, h = 0.5, 0.04, 0.1
    agents = agents_at(np.arange(1, n + 1), complete(n), KalmanConsensus(q, r, 0.0), start(n, 2))
    for k in range(1, 401):
        meet([agents], k, h, sample(k * h, 2))
    F, Q = model(q, h)
    P = solve_discrete_are(F.T, H.T, Q, np.array([[r / n]]))
    P = P - P @ H.T @ np.linalg.inv(H @ P @ H.T + r / n) @ H @ P
    true = (P[0, 0], P[0, 1], P[1, 1])
    for name, value, rounded in zip(VARIANCES, true, known, strict=True):
        np.testing.assert_allclose(agents.state[name], value, rtol=1e-12)
        assert agents.state[name][0] == pytest.approx(rounded, abs=5e-7)


RING = topology([(0, 1), (0, 4), *((i, i % 5 + 1) for i in range(1, 6)), (2, 5), (5, 2)])


@pytest.mark.parametrize("epsilon", [0.0, 0.3])
def test_the_filter_agrees_with_the_articles_matrices(epsilon):
    q, r, h, m, n = 0.5, 0.04, 0.1, 2, 5
    algorithm = KalmanConsensus(q, r, epsilon)
    agents = agents_at(np.arange(1, n + 1), RING, algorithm, start(n, m), seed=3)
    digraph = RING.digraphs[0]
    x = [np.stack([agents.state.position[i], agents.state.velocity[i]]) for i in range(n)]
    P = [100.0 * np.eye(2) for _ in range(n)]
    F, Q = model(q, h)
    for k in range(1, 31):
        meet([agents], k, h, sample(k * h, m))
        x, P = [F @ one for one in x], [F @ one @ F.T + Q for one in P]
        # What a robot measured is what it went by: the noise has a stream of its own.
        z = agents.state["information"] * r
        u = [H.T @ z[[i]] / r if i in {0, 3} else np.zeros((2, m)) for i in range(n)]
        U = [H.T @ H / r if i in {0, 3} else np.zeros((2, 2)) for i in range(n)]
        after = []
        for i in range(n):
            js = [j - 1 for j in digraph.source[digraph.sink == i + 1].tolist() if j]
            S = U[i] + sum(U[j] for j in js)
            y = u[i] + sum(u[j] for j in js)
            M = np.linalg.inv(np.linalg.inv(P[i]) + S)
            pull = epsilon / (1 + np.linalg.norm(M)) * M @ sum(x[j] - x[i] for j in js)
            after.append((x[i] + M @ (y - S @ x[i]) + pull, M))
        x, P = map(list, zip(*after, strict=True))
        np.testing.assert_allclose(agents.state.position, [one[0] for one in x], rtol=1e-9)
        np.testing.assert_allclose(agents.state.velocity, [one[1] for one in x], rtol=1e-9)
        for name, at in zip(VARIANCES, ((0, 0), (0, 1), (1, 1)), strict=True):
            np.testing.assert_allclose(agents.state[name], [one[at] for one in P], rtol=1e-9)


def test_measured_positions_have_the_variance_that_is_given_and_each_robot_its_own():
    r, n, ticks = 0.25, 8, 400
    agents = agents_at(np.arange(1, n + 1), complete(n), KalmanConsensus(1.0, r), start(n, 2))
    errors = []
    for k in range(1, ticks + 1):
        meet([agents], k, 0.1, sample(k * 0.1, 2))
        errors.append(agents.state["information"] * r - sample(k * 0.1, 2)["position"])
    noise = np.array(errors).reshape(ticks, -1)
    assert noise.mean() == pytest.approx(0, abs=5 * np.sqrt(r / noise.size))
    assert noise.var() == pytest.approx(r, rel=5 * np.sqrt(2 / noise.size))
    correlation = np.corrcoef(noise.T) - np.eye(2 * n)
    assert abs(correlation).max() < 5 / np.sqrt(ticks)


def test_errors_are_as_large_as_the_variances_say():
    """Of a filter that is right the squared errors over P have the mean of a χ² of 2."""
    q, r, h, n, m = 0.5, 0.04, 0.1, 4, 1
    rng = np.random.default_rng(8)
    F, Q = model(q, h)
    root, ratios = np.linalg.cholesky(Q), []
    for seed in range(60):
        agents = agents_at(
            np.arange(1, n + 1), complete(n), KalmanConsensus(q, r, 0.0), start(n, m), seed=seed
        )
        x = np.zeros(2)
        for k in range(1, 41):
            x = F @ x + root @ rng.normal(size=2)
            meet([agents], k, h, {**sample(0, m), "position": x[:1], "velocity": x[1:]})
        error = np.array([agents.state.position[0, 0] - x[0], agents.state.velocity[0, 0] - x[1]])
        a, b, c = (
            agents.state[name][0]
            for name in ("position_variance", "covariance", "velocity_variance")
        )
        ratios.append(error @ np.linalg.solve([[a, b], [b, c]], error))
    assert np.mean(ratios) == pytest.approx(2, abs=4 * 2 / np.sqrt(60))


def test_one_without_information_follows_the_pull_of_its_neighbour():
    path = topology([(0, 1), (1, 2), (2, 3)])
    agents = agents_at(np.arange(1, 4), path, KalmanConsensus(0.5, 0.04, 0.5), start(3, 1))
    for k in range(1, 301):
        meet([agents], k, 0.1, sample(k * 0.1, 1))
    variances = agents.state["position_variance"]
    assert variances[0] < variances[1] * 1.01
    assert variances[2] > 100 * variances[0]
    apart = abs(agents.state.position[:, 0] - 2 * 30.0)
    assert apart[:2].max() < 1
    assert apart[2] < 3


def test_any_partition_of_the_robots_gives_the_same_bits():
    parts = [[[1, 2, 3, 4, 5]], [[1, 4], [2, 3, 5]], [[1], [2], [3], [4], [5]]]
    found = []
    for partition in parts:
        begin = start(5, 2)
        agents = [
            agents_at(
                np.array(robots),
                RING,
                KalmanConsensus(0.5, 0.04, 0.3),
                {name: value[np.array(robots) - 1] for name, value in begin.items()},
            )
            for robots in partition
        ]
        for k in range(1, 21):
            meet(agents, k, 0.1, sample(k * 0.1, 2))
        found.append([whole(agents, name).tobytes() for name in agents[0].state])
    assert found[0] == found[1] == found[2]
