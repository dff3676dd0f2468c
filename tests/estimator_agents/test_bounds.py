"""What is promised, against dense matrices, the paper's numbers, and targets that try hard."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate
from nrs_cosim.estimator_agents.impulsive import Impulsive
from nrs_cosim.estimator_agents.pd_like import PdLike
from nrs_cosim.estimator_agents.sliding import Sliding
from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.theory.estimates import (
    paper_bound,
    steady_motion,
    worst_case,
    worst_case_always,
)
from nrs_cosim.estimator_agents.theory.network import network_of
from nrs_cosim.estimator_agents.theory.norms import small_value_norm
from nrs_cosim.estimator_agents.theory.recursion import linear_jump, recursion_of
from nrs_cosim.estimator_agents.theory.spectrum import (
    largest_period,
    smallest_theta,
    spectral_radius,
    spectrum_of,
)
from tests.bus.test_topology import PAPER
from tests.estimator_agents.agents_without_bus import agents_at, receive
from tests.estimator_agents.digraphs import digraphs, ring
from tests.estimator_agents.paper import HARMONIC

TOPOLOGY = Topology.of(*PAPER)
SPECTRUM = spectrum_of(TOPOLOGY)
quick = settings(max_examples=40, deadline=None, derandomize=True, database=None)
gains = st.floats(0.05, 2.5)
periods = st.floats(0.01, 2.0)


def radius_of(algorithm, topology, h):
    return spectral_radius(algorithm.modes(spectrum_of(topology), h))


def holds(algorithm, topology, h):
    return all(c.holds for c in algorithm.conditions(spectrum_of(topology), h))


# The paper's numbers


@pytest.mark.parametrize(
    ("algorithm", "h", "position", "velocity"),
    [
        (FirstOrder(0.9, 1.1), 0.05, 0.04018, 0.22535),
        (FirstOrder(0.9, 1.1), 0.1, 0.15131, 0.43971),
        (FirstOrder(0.9, 1.1), 0.5, 1.3575, 1.3545),
        (SecondOrder(1.1, 0.9), 0.1, 0.38275, 0.42193),
        (SecondOrder(1.1, 0.9), 0.45, 2.4192, 2.6095),
    ],
)
def test_the_papers_steady_states_agree_to_the_printed_digits(algorithm, h, position, velocity):
    motion = steady_motion(recursion_of(algorithm, TOPOLOGY, h), HARMONIC, 0.9)
    for ours, printed in ((motion.bound.position, position), (motion.bound.velocity, velocity)):
        assert round(ours, 5 if printed < 1 else 4) == pytest.approx(printed, abs=1e-12)


def test_the_papers_target_has_the_papers_bounds():
    assert HARMONIC.bounds() == (3.0, 1.0)


@pytest.mark.parametrize(
    ("algorithm", "h"), [(FirstOrder(1.18, 1.18), 0.1), (SecondOrder(1.1, 0.9), 0.5)]
)
def test_a_diverging_example_has_no_bounds(algorithm, h):
    recursion, rho = recursion_of(algorithm, TOPOLOGY, h), radius_of(algorithm, TOPOLOGY, h)
    assert rho > 1
    assert worst_case(recursion, 3, 1, rho) is None
    assert steady_motion(recursion, HARMONIC, rho) is None
    assert paper_bound(recursion, 3, 1) is None


def test_the_papers_network_has_the_papers_matrices():
    network = network_of(TOPOLOGY)
    assert network.pinned == (3,)
    assert network.components == ((3,), (1, 2), (6,), (4,), (5,))
    assert set(network.edges) == {(0, 1), (0, 2), (0, 3), (0, 4), (1, 3), (1, 4), (3, 4)}
    assert (network.depth, network.spanning_tree) == (3, True)
    assert network.D[:3] == ((1, 2, 0.5), (1, 3, 0.5), (2, 1, 1.0))
    dense = np.zeros((6, 6))
    for i, j, d in network.D:
        dense[i - 1, j - 1] = d
    np.testing.assert_array_equal(dense, as_array(TOPOLOGY.D))


# Recursions


@quick
@given(digraphs(), gains, gains, periods)
def test_the_recursion_is_that_of_the_paper(topology, alpha, beta, h):
    dense, n = as_array(topology.D), topology.n
    one = np.eye(n)
    P = (1 - beta) * one + beta * dense
    Lambda = np.block([[(1 - alpha) * one + alpha * dense, h * P], [0 * one, P]])
    Gamma = np.block(
        [[(1 - alpha * h) * one + alpha * h * dense, h * P], [-alpha * (one - dense), P]]
    )
    for algorithm, matrix in ((FirstOrder(alpha, beta), Lambda), (SecondOrder(alpha, beta), Gamma)):
        ours = recursion_of(algorithm, topology, h)
        np.testing.assert_allclose(as_array(ours.matrix), matrix, atol=1e-12)
    assert recursion_of(FirstOrder(alpha, beta), topology, h).velocities_alone
    assert not recursion_of(SecondOrder(alpha, beta), topology, h).velocities_alone


@quick
@given(digraphs(), gains, st.floats(0.05, 1.9), periods, st.integers(0, 9))
def test_agents_jump_by_the_recursion(topology, alpha, beta, h, seed):
    """Agents that receive from one another and a moving target, against A x + Δ, dense."""
    rng, n = np.random.default_rng(seed), topology.n
    for algorithm in (
        FirstOrder(alpha, beta),
        SecondOrder(alpha, beta),
        PdLike(alpha, 1),
        Impulsive(alpha, beta),
    ):
        recursion = recursion_of(algorithm, topology, h)
        A = as_array(recursion.matrix)
        start = Estimate(*rng.normal(size=(2, n, 2)))
        agents = agents_at(
            np.arange(1, n + 1), TopologySchedule.constant(topology), algorithm, start
        )
        states = [HARMONIC.at(k * h) for k in range(8)]
        x = error(start.after(h), states[1])
        for k in range(1, 7):
            left = agents.left(h)
            scale = 1 + np.abs(x).max() + np.abs(states[k].position).max()
            np.testing.assert_allclose(error(left, states[k]), x, atol=1e-11 * scale)
            receive(agents, k, np.array([0]), states[k].position[None], states[k].velocity[None])
            receive(agents, k, agents.robots, left.position, left.velocity)
            agents.jump(k, left)
            now, then = (np.array([s.position, s.velocity]) for s in states[k : k + 2])
            delta = recursion.flow @ recursion.keep @ now - then
            x = A @ x + np.repeat(delta, n, axis=0)


def error(estimate, target):
    return np.concatenate(
        [estimate.position - target.position, estimate.velocity - target.velocity]
    )


def test_a_nonlinear_algorithm_has_no_recursion():
    assert linear_jump(Sliding(0.3, 0.3)) is None
    keep, gain = linear_jump(Impulsive(1.1, 0.9))
    np.testing.assert_allclose(keep, [[1, 0], [0, 0.1]])
    np.testing.assert_allclose(gain, [[0, 0], [1.1, 0]])


# Conditions: sufficient and necessary


@quick
@given(digraphs(), gains, gains, periods)
def test_conditions_hold_exactly_when_the_spectral_radius_is_below_1(topology, alpha, beta, h):
    """Of the matrix, not of our modes: by powers, for its eigenvalues may be defective."""
    algorithms = [FirstOrder(alpha, beta), SecondOrder(alpha, beta), PdLike(alpha, 1.0)]
    if beta != 1:
        algorithms.append(Impulsive(alpha, beta))
    for algorithm in algorithms:
        rho = radius_of(algorithm, topology, h)
        if abs(rho - 1) < 1e-3:
            continue
        assert holds(algorithm, topology, h) == (rho < 1)
        A = as_array(recursion_of(algorithm, topology, h).matrix)
        far = np.linalg.matrix_power(A / rho, 4096)  # of order k^(2n) at most, and not less than 1
        assert 0.5 <= np.linalg.norm(far, 2) <= 4096.0 ** (2 * len(A))


@pytest.mark.parametrize("factor", [0.999, 1.001])
def test_the_spectral_radius_crosses_1_at_every_bound(factor):
    theta = smallest_theta(SPECTRUM)
    longest = {beta: largest_period(SPECTRUM, 1.1, beta) for beta in (0.9, 1.0)}
    impulsive = Impulsive(1.1, 0.9).conditions(SPECTRUM, 0.1)[1].right
    cases = [
        (FirstOrder(factor * theta, 0.9), 0.1),
        (FirstOrder(0.9, factor * theta), 0.1),
        (SecondOrder(1.1, factor * theta), 1e-5),
        (SecondOrder(1.1, 0.9), factor * longest[0.9]),
        (PdLike(1.1, 1.0), factor * longest[1.0]),
        (Impulsive(1.1, 0.9), factor * impulsive),
        (Impulsive(1.1, factor * 2.0), 1e-5),
    ]
    for algorithm, h in cases:
        assert holds(algorithm, TOPOLOGY, h) == (factor < 1), algorithm
        assert (radius_of(algorithm, TOPOLOGY, h) < 1) == (factor < 1), algorithm


@quick
@given(st.floats(0.01, 3), st.floats(0.01, 2), st.floats(1e-3, 0.999), st.integers(0, 2**32 - 1))
def test_a_sliding_robot_that_only_receives_the_target_follows_it(h, gamma_2, share, seed):
    """|ῡ| ≤ β + h γ2 once β > h γ2, whatever the target does; below it may be left behind."""
    rng, most = np.random.default_rng(seed), h * gamma_2
    beta = most / share
    (demand,) = Sliding(1.0, beta).demands(h, 1.0, gamma_2)
    assert demand.holds
    apart, here = rng.uniform(-50, 50) * beta, np.zeros(1)
    for k in range(400):
        received = Disagreement(here, np.array([-apart]))
        apart = Sliding(1.0, beta).jump(Estimate(here, np.array([apart])), received).velocity.item()
        apart += most * rng.choice([-1, 1, rng.uniform(-1, 1)])
        if k * (beta - most) > 50 * beta:
            assert abs(apart) <= (beta + most) * (1 + 1e-12)
    slow, left = Sliding(1.0, share * most), 0.0
    assert not slow.demands(h, 1.0, gamma_2)[0].holds
    for _ in range(400):
        received = Disagreement(here, np.array([-left]))
        left = slow.jump(Estimate(here, np.array([left])), received).velocity.item() + most
    assert left >= 400 * (1 - share) * most * (1 - 1e-9)


def test_sliding_robots_without_loops_stay_within_their_depth():
    """|ῡ_i| ≤ ℓ_i (β + h γ2), with the longest path to i of ℓ_i edges, is never left again."""
    rng = np.random.default_rng(11)
    for case in range(300):
        n, beta = int(rng.integers(1, 6)), 1.0
        most = beta * rng.uniform(0.05, 0.95)
        weights = np.tril(rng.random((n, n + 1)) * (rng.random((n, n + 1)) < 0.6))
        weights[~weights.any(axis=1), 0] = 1.0
        weights /= weights.sum(axis=1, keepdims=True)
        depth = np.zeros(n + 1)
        for i in range(n):
            depth[i + 1] = 1 + depth[: i + 1][weights[i, : i + 1] > 0].max()
        bound = depth[1:] * (beta + most)
        x = rng.uniform(-1, 1, (50, n)) * bound
        for _ in range(30):
            apart = np.column_stack([np.zeros(50), x]) @ weights.T - x
            zero = np.zeros_like(x)
            jumped = Sliding(1.0, beta).jump(Estimate(zero, x), Disagreement(zero, apart)).velocity
            x = jumped - most * rng.choice([-1, 1, rng.uniform(-1, 1)], (50, 1))
            assert np.all(np.abs(x) <= bound * (1 + 1e-9)), case


def test_two_sliding_robots_in_a_row_are_driven_to_twice_what_one_comes_to():
    """ῡ just below 0 in both, robot 2 lower: up by β, by h γ2, and by both again."""
    beta, most, near = 0.11, 0.1, 1e-9
    x, largest = np.array([-near, -2 * near]), 0.0
    for change in [-most, most] * 50 + [-most, -most]:
        apart, zero = np.array([-x[0], x[0] - x[1]]), np.zeros(2)
        x = Sliding(1.0, beta).jump(Estimate(zero, x), Disagreement(zero, apart)).velocity - change
        largest = max(largest, x[1])
    assert largest == pytest.approx(2 * (beta + most), abs=1e-6)


@quick
@given(digraphs(), gains)
def test_pd_like_has_the_condition_of_its_article(topology, alpha):
    mu = np.linalg.eigvals(as_array(topology.D))
    away = np.abs(1 - mu) ** 2
    bound = 2 * away * (2 * (1 - mu).real - away) / (away**2 + 4 * mu.imag**2)
    (ours,) = PdLike(alpha, 1.0).conditions(mu, 0.1)
    assert alpha * ours.right == pytest.approx(bound.min())


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_runs_converge_below_and_diverge_above_every_bound(factor):
    theta = smallest_theta(SPECTRUM)
    longest = largest_period(SPECTRUM, 1.1, 0.9)
    for algorithm, h in [
        (FirstOrder(factor * theta, 0.9), 0.1),
        (FirstOrder(0.9, factor * theta), 0.1),
        (SecondOrder(1.1, factor * theta), 0.02),
        (SecondOrder(1.1, 0.9), factor * longest),
    ]:
        first, last = ends_of_a_run(algorithm, h, 1200)
        assert (last < first) == (factor < 1), (algorithm, h)


def ends_of_a_run(algorithm, h, ticks):
    """Return ‖x‖∞ at t_1 and t_ticks of agents that look for a target that rests at 0."""
    rng = np.random.default_rng(1)
    agents = agents_at(
        np.arange(1, 7),
        TopologySchedule.constant(TOPOLOGY),
        algorithm,
        Estimate(*rng.uniform(-25, 25, (2, 6, 2))),
    )
    sizes = []
    for k in range(1, ticks + 1):
        left = agents.left(h)
        sizes.append(max(np.abs(left.position).max(), np.abs(left.velocity).max()))
        receive(agents, k, np.array([0]), np.zeros((1, 2)), np.zeros((1, 2)))
        receive(agents, k, agents.robots, left.position, left.velocity)
        agents.jump(k, left)
    return sizes[0], sizes[-1]


@quick
@given(digraphs())
def test_gains_up_to_1_always_converge(topology):
    assert smallest_theta(spectrum_of(topology)) > 1


# Small-value norms


@quick
@given(digraphs(4), gains, gains, periods, st.integers(0, 9))
def test_small_value_norms_are_norms(topology, alpha, beta, h, seed):
    algorithm = FirstOrder(alpha, beta) if seed % 2 else SecondOrder(alpha, beta)
    A = recursion_of(algorithm, topology, h).matrix
    norm = small_value_norm(A)
    if radius_of(algorithm, topology, h) > 1 - 1e-3:
        return
    assert norm is not None
    assert norm.value < 1
    assert norm.of_matrix(as_array(A)) == pytest.approx(norm.value, rel=1e-6)
    rng, p = np.random.default_rng(seed), A.shape[0]
    X, Y = rng.normal(size=(2, p, p))
    x, y = rng.normal(size=(2, p))
    least = 1 + 1e-9
    assert norm.of_matrix(X @ Y) <= norm.of_matrix(X) * norm.of_matrix(Y) * least
    assert norm.of_matrix(X + Y) <= (norm.of_matrix(X) + norm.of_matrix(Y)) * least
    assert norm.of_vector(X @ x) <= norm.of_matrix(X) * norm.of_vector(x) * least
    assert norm.of_vector(x + y) <= (norm.of_vector(x) + norm.of_vector(y)) * least
    assert norm.of_vector(-2.5 * x) == pytest.approx(2.5 * norm.of_vector(x), rel=1e-9)
    assert norm.of_vector(x) > 0
    assert np.abs(x).max() <= norm.b * norm.of_vector(x) * least
    assert norm.of_vector(x) <= norm.c * np.abs(x).max() * least


@pytest.mark.parametrize("matrix", [np.diag([0.5, -0.9]), np.array([[0.9, 50.0], [0.0, 0.9]])])
def test_small_value_norms_of_known_matrices(matrix):
    norm = small_value_norm(sparse.csr_array(matrix))
    assert norm is not None
    assert np.abs(np.linalg.eigvals(matrix)).max() <= norm.value < 1
    assert small_value_norm(sparse.csr_array(matrix / 0.9)) is None


@pytest.mark.parametrize("beta", [0.5, 0.9, 1.1])
def test_the_norm_of_robots_in_a_row_is_near_the_best_of_all_geometric_weights(beta):
    p, ahead, stays = 6, beta, abs(1 - beta)
    matrix = (1 - beta) * np.eye(p) + beta * np.eye(p, k=-1)
    ratios = np.linspace(1e-3, 1 - 1e-3, 9999)  # of one weight to the next
    gains = ratios ** (1.0 - p) / np.maximum(1 - stays - ahead * ratios, 1e-12)
    norm = small_value_norm(matrix)
    assert norm is not None
    assert norm.gain <= 1.05 * gains.min()


# exact ≤ sharp ≤ paper


@settings(quick, max_examples=15)
@given(digraphs(5), gains, gains, periods, st.integers(0, 99))
def test_measured_errors_and_bounds_are_ordered(topology, alpha, beta, h, seed):
    algorithm = FirstOrder(alpha, beta) if seed % 2 else SecondOrder(alpha, beta)
    rho = radius_of(algorithm, topology, h)
    if rho > 0.95:
        return
    rng = np.random.default_rng(seed)
    target = Harmonic(rng.normal(size=2), rng.normal(size=2), *rng.normal(size=(3, 2, 2)))
    recursion = recursion_of(algorithm, topology, h)
    motion = steady_motion(recursion, target, rho)
    worst = worst_case(recursion, *target.bounds(), rho)
    paper = paper_bound(recursion, *target.bounds()).bound
    x, n = np.zeros((2, topology.n, 2)), topology.n
    steady, measured = [], np.zeros(2)
    for k in range(1, 701):
        if k > 550:
            measured = np.maximum(measured, np.abs(x).max(axis=(1, 2)))
            steady.append(np.abs(x - motion.at(k)).max())
        now, then = target.at(k * h), target.at((k + 1) * h)
        delta = [now.position - then.position + h * now.velocity, now.velocity - then.velocity]
        x = (recursion.matrix @ x.reshape(2 * n, 2)).reshape(2, n, 2) + np.array(delta)[:, None]
    scale = 1 + np.abs(motion.phasor).max()
    assert max(steady) < 1e-6 * scale
    found = [(bound.position, bound.velocity) for bound in (motion.bound, worst, paper)]
    for loose, tight in zip(found, [measured, *found[:2]], strict=True):
        assert np.all(np.array(tight) <= np.array(loose) * (1 + 1e-9) + 1e-6 * scale)


@pytest.mark.parametrize("algorithm", [FirstOrder(1.1, 1.15), SecondOrder(1.1, 0.9)])
def test_between_samples_errors_are_within_the_worst_case_bound(algorithm):
    h = 0.1
    recursion, rho = recursion_of(algorithm, TOPOLOGY, h), radius_of(algorithm, TOPOLOGY, h)
    before, always = (way(recursion, 3, 1, rho) for way in (worst_case, worst_case_always))
    assert always.position >= before.position
    assert always.velocity >= before.velocity
    rng, x, most = np.random.default_rng(0), np.zeros((2, 6)), np.zeros(2)
    pushes = np.where(rng.random((2000, 10)) < 0.5, -1.0, 1.0)
    for push in pushes:
        x = (recursion.jump @ x.ravel()).reshape(2, 6)
        most = np.maximum(most, np.abs(x).max(axis=1))
        for a in push:
            x = np.array([x[0] + h / 10 * x[1] - a * (h / 10) ** 2 / 2, x[1] - a * h / 10])
            most = np.maximum(most, np.abs(x).max(axis=1))
    assert most[0] <= always.position
    assert most[1] <= always.velocity


@pytest.mark.parametrize("algorithm", [FirstOrder(0.9, 1.1), SecondOrder(1.1, 0.9)])
def test_a_target_reaches_the_worst_case_bound(algorithm):
    """Its acceleration is ±γ2 as A^j has it, backwards, changing 40 times an interval at most."""
    h, parts, past = 0.1, 40, 150
    recursion = recursion_of(algorithm, TOPOLOGY, h)
    bound = worst_case(recursion, 1e9, 1.0, radius_of(algorithm, TOPOLOGY, h))
    A = as_array(recursion.matrix)
    kernels = [np.kron(np.eye(2), np.ones((6, 1)))]
    for _ in range(past - 1):
        kernels.append(A @ kernels[-1])
    w = (np.arange(parts) + 0.5) * h / parts
    for rows, most in ((slice(0, 6), bound.position), (slice(6, 12), bound.velocity)):
        reached = 0.0
        for row in range(*rows.indices(12)):
            worst = sum(np.abs((h - w) * k[row, 0] + k[row, 1]).sum() * h / parts for k in kernels)
            reached = max(reached, worst)
        assert 0.999 * most <= reached <= most * (1 + 1e-3)


# Large digraphs


@pytest.mark.parametrize(("n", "both"), [(1200, True), (1200, False)])
def test_a_large_ring_has_the_spectrum_of_its_dense_matrix(n, both):
    topology = ring(n, both)
    ours = np.sort_complex(np.round(spectrum_of(topology), 9))
    small = np.sort(np.abs(np.linalg.eigvals(as_array(ring(300, both).D))))
    assert len(ours) == n
    assert np.abs(ours).max() < 1
    traces = [np.sum(spectrum_of(topology) ** power).real for power in (1, 2, 3)]
    D = topology.D
    exact = [D.trace(), (D @ D).trace(), (D @ D @ D).trace()]
    np.testing.assert_allclose(traces, exact, atol=1e-8 * n)
    assert small.max() < np.abs(ours).max()


def test_a_ring_of_10000_robots_takes_10_seconds_and_1_gigabyte():
    """In a process of its own that says its own peak: that of all children may be another's.

    In one thread, since those that wait for one another on a busy machine use time as well.
    """
    code = (
        "import sys, numpy as np; from tests.estimator_agents.digraphs import ring\n"
        "from nrs_cosim.estimator_agents.dcea1 import FirstOrder as F\n"
        "from nrs_cosim.estimator_agents.theory.network import network_of\n"
        "from nrs_cosim.estimator_agents.theory.estimates import *\n"
        "from nrs_cosim.estimator_agents.theory.recursion import recursion_of\n"
        "from nrs_cosim.estimator_agents.theory.spectrum import *\n"
        "from tests.estimator_agents.paper import HARMONIC\n"
        "t, f = ring(10_000, True), F(0.9, 0.9)\n"
        "s = spectrum_of(t); r = recursion_of(f, t, 0.1); rho = spectral_radius(f.modes(s, 0.1))\n"
        "assert network_of(t).depth == 5001 and len(s) == 10_000 and rho < 1\n"
        "assert steady_motion(r, HARMONIC, rho).bound.position < 2\n"
        "assert worst_case(r, 3, 1, rho) and paper_bound(r, 3, 1)\n"
        "from benchmarks.memory import peak; import time\n"
        "print(time.process_time(), peak())\n"
    )
    alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, check=True, cwd=root, env=alone, stdout=subprocess.PIPE)
    seconds, memory = map(float, done.stdout.split())
    assert seconds < 10
    assert memory < 1e9
