"""Periods that are not alike, against dense products, brute force, and targets that try hard."""

from dataclasses import astuple
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.impulsive import Impulsive
from nrs_cosim.estimator_agents.pd_like import PdLike
from nrs_cosim.estimator_agents.sliding import Sliding
from nrs_cosim.estimator_agents.theory.aperiodic import Periods, radius_bounds
from nrs_cosim.estimator_agents.theory.aperiodic_bounds import (
    worst_case_aperiodic,
    worst_case_of_list,
)
from nrs_cosim.estimator_agents.theory.estimates import (
    EstimateBounds,
    largest,
    worst,
    worst_case,
    worst_case_always,
)
from nrs_cosim.estimator_agents.theory.recursion import recursion_of
from nrs_cosim.estimator_agents.theory.spectrum import largest_period, smallest_theta, spectrum_of
from tests.bus.test_topology import PAPER
from tests.estimator_agents.agents_without_bus import agents_at, receive
from tests.estimator_agents.digraphs import digraphs, ring
from tests.estimator_agents.paper import HARMONIC, first_order, second_order
from tests.estimator_agents.test_bounds import error, radius_of

TOPOLOGY = Topology.of(*PAPER)
ALONE = Topology.of(np.zeros((1, 1)), np.ones(1))
quick = settings(max_examples=15, deadline=None, derandomize=True, database=None)
gains = st.floats(0.05, 2.5)
lists = st.lists(st.floats(0.01, 2.0), min_size=1, max_size=6)


def step(algorithm, D, h):
    """Return A(h), dense, of the paper's algorithms and two others; and F K."""
    one, zero, a, b = np.eye(len(D)), np.zeros_like(D), algorithm.alpha, algorithm.beta
    away, stay = one - D, one
    if isinstance(algorithm, FirstOrder):
        jump = np.block([[one - a * away, zero], [zero, one - b * away]])
    elif isinstance(algorithm, Impulsive):
        jump, stay = np.block([[one, zero], [-a * away, (1 - b) * one]]), (1 - b) * one
    else:
        jump = np.block([[one, zero], [-a * away, one - b * away]])
    flow = np.block([[one, h * one], [zero, one]])
    return flow @ jump, flow @ np.block([[one, zero], [zero, stay]])


def radius(matrix):
    return np.abs(np.linalg.eigvals(matrix)).max()


@quick
@given(digraphs(), gains, st.floats(0.05, 1.9), lists, st.integers(0, 9))
def test_agents_jump_by_the_matrices_of_their_periods(topology, alpha, beta, gaps, seed):
    rng, n, D = np.random.default_rng(seed), topology.n, as_array(topology.D)
    times = np.cumsum([0, *np.resize(gaps, 8)])
    states = [HARMONIC.at(t) for t in times]
    for algorithm in (
        FirstOrder(alpha, beta),
        SecondOrder(alpha, beta),
        PdLike(alpha, 1),
        Impulsive(alpha, beta),
    ):
        start = Estimate(*rng.normal(size=(2, n, 2)))
        agents = agents_at(
            np.arange(1, n + 1), TopologySchedule.constant(topology), algorithm, start
        )
        x = error(start.after(times[1]), states[1])
        for k in range(1, 7):
            left = agents.left(times[k] - times[k - 1])
            scale = 1 + np.abs(x).max() + np.abs(states[k].position).max()
            np.testing.assert_allclose(error(left, states[k]), x, atol=1e-11 * scale)
            receive(agents, k, np.array([0]), states[k].position[None], states[k].velocity[None])
            receive(agents, k, agents.robots, left.position, left.velocity)
            agents.jump(k, left)
            A, kept = step(algorithm, D, times[k + 1] - times[k])
            now, then = (np.repeat([s.position, s.velocity], n, axis=0) for s in states[k : k + 2])
            x = A @ x + kept @ now - then


@pytest.mark.parametrize(
    ("algorithm", "matrix"),
    [(FirstOrder(0.9, 1.1), first_order), (SecondOrder(1.1, 0.9), second_order)],
)
def test_the_matrices_are_the_papers(algorithm, matrix):
    ours, _ = step(algorithm, as_array(TOPOLOGY.D), 0.3)
    np.testing.assert_allclose(ours, matrix(algorithm.alpha, algorithm.beta, 0.3), atol=1e-15)


@quick
@given(st.integers(0, 999), gains, gains, lists)
def test_the_growth_of_a_list_is_the_radius_of_its_dense_product(seed, alpha, beta, gaps):
    """On digraphs whose D has no defective eigenvalue, for those are lost in the dense one."""
    rng = np.random.default_rng(seed)
    adjacency = rng.uniform(0.1, 2, (4, 4)) * (1 - np.eye(4))
    topology = Topology.of(adjacency, np.array([1.0, 0, 0, 0]))
    D, spectrum = as_array(topology.D), spectrum_of(topology)
    for algorithm in (FirstOrder(alpha, beta), SecondOrder(alpha, beta), Impulsive(alpha, beta)):
        whole = np.eye(8)
        for h in gaps:
            whole = step(algorithm, D, h)[0] @ whole
        found = radius_bounds(algorithm, spectrum, Periods(tuple(gaps)))
        assert found.lower == found.upper == found.radius
        assert found.radius == pytest.approx(radius(whole) ** (1 / len(gaps)), rel=1e-7, abs=1e-7)


@quick
@given(digraphs(), gains, gains, lists, st.floats(0.1, 1.0))
def test_the_period_does_not_matter_to_the_first_order_algorithm(
    topology, alpha, beta, gaps, early
):
    algorithm, spectrum = FirstOrder(alpha, beta), spectrum_of(topology)
    rho = radius_of(algorithm, topology, 1.0)
    holds = max(alpha, beta) < smallest_theta(spectrum)
    for periods in (Periods(tuple(gaps)), Periods(tuple(gaps[:1]), early * gaps[0])):
        found = radius_bounds(algorithm, spectrum, periods)
        assert found.radius == pytest.approx(rho, rel=1e-9)
        assert (found.status == "proven") == holds


def test_alternating_periods_below_the_bound_of_theorem_3_may_diverge():
    """One robot that receives the target; the trace and determinant of the product by hand."""
    algorithm, spectrum = SecondOrder(1.0, 0.5), np.zeros(1, complex)
    assert largest_period(spectrum, 1.0, 0.5) == 3
    for h in (0.3, 2.7):
        assert radius_bounds(algorithm, spectrum, Periods((h,))).radius == pytest.approx(
            np.sqrt(0.5)
        )
    trace, determinant = 1.25 - 1.5 * (0.3 + 2.7) + 0.3 * 2.7, 0.25
    worst = (-trace + np.sqrt(trace**2 - 4 * determinant)) / 2
    assert worst == pytest.approx(2.33283, abs=1e-5)
    found = radius_bounds(algorithm, spectrum, Periods((0.3, 2.7)))
    assert found.radius == pytest.approx(np.sqrt(worst))
    assert found.status == "refuted"
    jittered = radius_bounds(algorithm, spectrum, Periods((1.5,), 1.2))
    assert jittered.status == "refuted"
    assert np.sqrt(worst) * (1 - 1e-9) <= jittered.lower <= jittered.upper
    earlier, later = (size_of_a_run(algorithm, (0.3, 2.7), ticks) for ticks in (40, 42))
    assert later / earlier == pytest.approx(worst, rel=1e-9)
    for h in (0.3, 1.5, 2.7):
        assert size_of_a_run(algorithm, (h,), 80) < 1e-8


def test_a_period_above_the_bound_may_be_compensated_by_others():
    algorithm, spectrum = SecondOrder(1.0, 0.5), np.zeros(1, complex)
    assert radius_bounds(algorithm, spectrum, Periods((3.3,))).status == "refuted"
    found = radius_bounds(algorithm, spectrum, Periods((3.3, 2.0)))
    assert found.radius == pytest.approx(np.sqrt(0.5))
    assert size_of_a_run(algorithm, (3.3, 2.0), 80) < 1e-8


def size_of_a_run(algorithm, gaps, ticks):
    """Return |x| at the end of a run of one agent that looks for a target that rests at 0."""
    start = Estimate(np.ones((1, 1)), np.ones((1, 1)))
    agents = agents_at(np.array([1]), TopologySchedule.constant(ALONE), algorithm, start)
    for k in range(1, ticks + 1):
        left = agents.left(gaps[k % len(gaps)])
        receive(agents, k, np.array([0]), np.zeros((1, 1)), np.zeros((1, 1)))
        agents.jump(k, left)
    return max(np.abs(left.position).max(), np.abs(left.velocity).max())


@quick
@given(st.floats(0.05, 3.0), st.floats(0, 1, exclude_max=True), gains, st.floats(0, 1))
def test_with_beta_above_1_over_z_a_quadratic_form_decreases_for_all_periods(z, past, alpha, part):
    """docs/theory.md: P = [[1, c], [c, c (1 + c)]] with c = β z − 1 in 0 … 1."""
    c = max(past, 1e-3)
    beta = (1 + c) / z
    h = part * 2 * (1 - c) / (alpha * z)
    form, size = np.array([[1, c], [c, c * (1 + c)]]), np.diag([1, alpha * z])
    scaled = np.linalg.inv(size) @ step(SecondOrder(alpha, beta), np.array([[1 - z]]), h)[0] @ size
    assert np.linalg.eigvalsh(form).min() > 0
    assert np.linalg.eigvalsh(form - scaled.T @ form @ scaled).min() > -1e-12


def test_on_a_path_with_beta_above_1_any_jitter_converges():
    path = Topology.of(np.eye(5, k=-1), np.eye(5)[0])
    algorithm, spectrum = SecondOrder(1.0, 1.2), spectrum_of(path)
    assert largest_period(spectrum, 1.0, 1.2) == pytest.approx(1.6)
    assert radius_bounds(algorithm, spectrum, Periods((0.8,), 0.79)).status == "proven"


@pytest.mark.parametrize(("h", "early"), [(0.1, 0.02), (0.3, 0.27), (0.45, 0.2), (0.45, 0.44)])
def test_the_growth_under_jitter_lies_between_its_bounds(h, early):
    """By the paper's matrices of all turns of six extreme δ, and of thousands at random."""
    algorithm, D = SecondOrder(1.1, 0.9), as_array(TOPOLOGY.D)
    found = radius_bounds(algorithm, spectrum_of(TOPOLOGY), Periods((h,), early))
    most = 0.0
    for length in range(1, 7):
        for deltas in product((0.0, early), repeat=length):
            whole = np.eye(12)
            for k in range(length):
                gap = h + deltas[k] - deltas[(k + 1) % length]
                whole = step(algorithm, D, gap)[0] @ whole
            most = max(most, radius(whole) ** (1 / length))
    assert found.lower <= found.upper <= found.lower * 1.05
    assert most <= found.upper * (1 + 1e-5)  # D has a zero that is defective
    assert most >= found.lower * (1 - 1e-5)
    rng, x, sizes = np.random.default_rng(2), np.ones(12), 0.0
    deltas = rng.uniform(0, early, 3001)
    for now, then in pairwise(deltas):
        x = step(algorithm, D, h + now - then)[0] @ x
        sizes, x = sizes + np.log(np.abs(x).max()), x / np.abs(x).max()
    assert np.exp(sizes / 3000) <= found.upper * 1.01


def test_convergence_of_a_large_ring_under_jitter_is_decided():
    algorithm = SecondOrder(1.1, 0.9)
    spectrum = spectrum_of(ring(1200, True))
    rho = radius_bounds(algorithm, spectrum, Periods((0.1,))).radius
    found = radius_bounds(algorithm, spectrum, Periods((0.1,), 0.02))
    assert found.status == "proven"
    assert rho * (1 - 1e-9) <= found.lower <= found.upper <= (1 + rho) / 2


def test_the_growth_of_a_nonlinear_algorithm_is_unknown():
    found = radius_bounds(Sliding(0.3, 0.3), spectrum_of(TOPOLOGY), Periods((0.1,), 0.05))
    assert np.isnan(found.upper)
    assert found.status == "not decided"


# Bounds on the estimates


BOUNDED = [
    (FirstOrder(0.9, 0.9), 0.1, 0.05),
    (FirstOrder(0.9, 1.1), 0.1, 0.08),
    (FirstOrder(1.1, 1.15), 0.1, 0.03),
    (SecondOrder(1.1, 0.9), 0.1, 0.02),
    (SecondOrder(1.1, 0.9), 0.3, 0.1),
]


@pytest.mark.parametrize(("algorithm", "h", "r"), BOUNDED)
def test_no_target_and_periods_exceed_the_bound(algorithm, h, r):
    """For each sequence the worst target of |a_0| <= 1 by hand; γ1 is no limit."""
    rho = radius_of(algorithm, TOPOLOGY, h)
    bound, always = worst_case_aperiodic(recursion_of(algorithm, TOPOLOGY, h), r, 1e9, 1.0, rho)
    D, rng, past = as_array(TOPOLOGY.D), np.random.default_rng(1), 160
    sequences = [rng.choice([h - r, h + r], past) for _ in range(30)]
    sequences += [rng.uniform(h - r, h + r, past) for _ in range(6)]
    sequences += [np.full(past, h + r), np.resize([h - r, h + r], past)]
    most, after = np.zeros(2), np.zeros(2)
    for gaps in sequences:
        for seen, reached in ((np.eye(12), most), (step(algorithm, D, 0.0)[0], after)):
            reached[:] = np.maximum(reached, worst_target(algorithm, D, gaps, seen))
    assert np.all(most <= [bound.position * (1 + 1e-9), bound.velocity * (1 + 1e-9)])
    assert np.all(after <= [always.position * (1 + 1e-9), always.velocity * (1 + 1e-9)])
    assert np.all(most >= [0.25 * bound.position, 0.25 * bound.velocity])


@pytest.mark.parametrize(
    "algorithm", [FirstOrder(0.9, 1.1), FirstOrder(1.1, 1.15), SecondOrder(1.1, 0.9)]
)
def test_the_worst_target_of_a_list_reaches_the_bound(algorithm):
    gaps, D = (0.03, 0.12, 0.1), as_array(TOPOLOGY.D)
    radius = radius_bounds(algorithm, spectrum_of(TOPOLOGY), Periods(gaps)).radius
    recursion = recursion_of(algorithm, TOPOLOGY, 1.0)
    bound, always = worst_case_of_list(recursion, gaps, 1e9, 1.0, radius)
    most, after = np.zeros(2), np.zeros(2)
    for start in range(3):
        sequence = np.resize(np.roll(gaps, start), 480)
        for seen, reached in ((np.eye(12), most), (step(algorithm, D, 0.0)[0], after)):
            reached[:] = np.maximum(reached, worst_target(algorithm, D, sequence, seen))
    assert (bound.position, bound.velocity) == pytest.approx(tuple(most), rel=1e-3)
    total = np.maximum(most, after)
    assert (always.position, always.velocity) == pytest.approx(tuple(total), rel=1e-3)


@pytest.mark.parametrize("algorithm", [FirstOrder(0.9, 1.1), SecondOrder(1.1, 0.9)])
def test_a_list_of_one_has_the_bounds_of_a_period(algorithm):
    recursion, rho = recursion_of(algorithm, TOPOLOGY, 0.1), radius_of(algorithm, TOPOLOGY, 0.1)
    for gammas in ((1e9, 1.0), (0.02, 1.0)):
        pairs = worst_case_of_list(recursion, (0.1, 0.1), *gammas, rho)
        for pair, seen in zip(pairs, (np.eye(12), recursion.jump), strict=True):
            one = largest(worst(recursion, *gammas, rho, seen, 0.1))
            more = EstimateBounds(*np.maximum(astuple(one), astuple(pairs[0])))
            assert astuple(pair) == pytest.approx(astuple(more), rel=1e-9)
    theirs = (way(recursion, 1e9, 1.0, rho) for way in (worst_case, worst_case_always))
    pairs = worst_case_of_list(recursion, (0.1, 0.1), 1e9, 1.0, rho)
    for pair, other in zip(pairs, theirs, strict=True):
        assert astuple(pair) == pytest.approx(astuple(other), rel=1e-9)


def worst_target(algorithm, D, gaps, seen):
    """Return the largest of |seen x| of positions and velocities at the end, (2,)."""
    rows, total = seen, np.zeros(12)
    for h in gaps[::-1]:
        p, r = rows[:, :6].sum(axis=1), rows[:, 6:].sum(axis=1)
        u = (np.arange(100) + 0.5) * h / 100
        total += np.abs(p[:, None] * u + r[:, None]).sum(axis=1) * h / 100
        rows = rows @ step(algorithm, D, h)[0]
    return total.reshape(2, 6).max(axis=1)


def test_with_gains_up_to_1_the_bound_is_that_of_the_longest_period():
    for algorithm in (FirstOrder(0.9, 0.9), FirstOrder(1.0, 0.4)):
        for r in (0.0, 0.03, 0.09):
            rho = radius_of(algorithm, TOPOLOGY, 0.1)
            ours, _ = worst_case_aperiodic(recursion_of(algorithm, TOPOLOGY, 0.1), r, 1e3, 1.0, rho)
            longest = worst_case(recursion_of(algorithm, TOPOLOGY, 0.1 + r), 1e3, 1.0, rho)
            assert ours.position == pytest.approx(longest.position, rel=1e-12)
            assert ours.velocity == pytest.approx(longest.velocity, rel=1e-12)


@pytest.mark.parametrize("algorithm", [FirstOrder(1.1, 1.15), SecondOrder(1.1, 0.9)])
def test_without_jitter_the_bound_is_the_worst_case_bound(algorithm):
    recursion, rho = recursion_of(algorithm, TOPOLOGY, 0.1), radius_of(algorithm, TOPOLOGY, 0.1)
    ours, _ = worst_case_aperiodic(recursion, 0.0, 3.0, 1.0, rho)
    found = worst_case(recursion, 3.0, 1.0, rho)
    assert ours.position == pytest.approx(found.position, rel=1e-12)
    assert ours.velocity == pytest.approx(found.velocity, rel=1e-12)


def test_without_a_proof_there_is_no_bound():
    algorithm = SecondOrder(1.0, 0.5)
    recursion, rho = recursion_of(algorithm, ALONE, 1.5), radius_of(algorithm, ALONE, 1.5)
    assert worst_case_aperiodic(recursion, 0.05, 3.0, 1.0, rho) is not None
    assert worst_case_aperiodic(recursion, 1.2, 3.0, 1.0, rho) is None
    large = ring(300, True)
    recursion = recursion_of(SecondOrder(1.1, 0.9), large, 0.1)
    assert worst_case_aperiodic(recursion, 0.01, 3.0, 1.0, 0.9) is None
    recursion = recursion_of(FirstOrder(0.9, 0.9), large, 0.1)
    assert worst_case_aperiodic(recursion, 0.01, 3.0, 1.0, 0.9999) is not None
