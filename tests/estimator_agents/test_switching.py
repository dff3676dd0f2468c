"""Digraphs in turn, and apart for positions and velocities, against dense products."""

from itertools import product

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.bus.topologies import InteractionGraphs, TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.impulsive import Impulsive
from nrs_cosim.estimator_agents.installed import (
    algorithm_names,
    load_algorithm,
    takes_separate_graphs,
)
from nrs_cosim.estimator_agents.sliding import Sliding
from nrs_cosim.estimator_agents.theory import switching
from nrs_cosim.estimator_agents.theory.estimates import steady_motion, worst_case, worst_case_always
from nrs_cosim.estimator_agents.theory.recursion import linear_jump, recursion_of
from nrs_cosim.estimator_agents.theory.spectrum import smallest_theta, spectral_radius, spectrum_of
from nrs_cosim.estimator_agents.theory.switching import (
    any_order,
    contracts_in_any_order,
    period,
    period_radius,
)
from nrs_cosim.estimator_agents.theory.varying import LARGEST
from tests.estimator_agents.agents_without_bus import agents_at, receive
from tests.estimator_agents.digraphs import exchanges, ring
from tests.estimator_agents.paper import HARMONIC

quick = settings(max_examples=40, deadline=None, derandomize=True, database=None)
gains = st.floats(0.05, 2.5)
periods = st.floats(0.01, 2.0)
counts = st.lists(st.integers(1, 4), min_size=3, max_size=3)

CHAIN, OTHER_WAY = Topology.of([[0, 0], [1, 0]], [1, 0]), Topology.of([[0, 1], [0, 0]], [0, 1])
"""Two robots, of which now one and now the other receives the target, and is received."""


def dense(algorithm, exchange, h):
    """Return A of one axis, (2 n, 2 n), written out: Λ or Γ with a D for each quantity."""
    D, other = as_array(exchange.position.D), as_array(exchange.velocity.D)
    one, zero, a, b = np.eye(len(D)), np.zeros_like(D), algorithm.alpha, algorithm.beta
    if isinstance(algorithm, FirstOrder):
        jump = np.block([[one + a * (D - one), zero], [zero, one + b * (other - one)]])
    else:
        jump = np.block([[one, zero], [a * (D - one), one + b * (other - one)]])
    return np.block([[one, h * one], [zero, one]]) @ jump


def in_turn(counts, given):
    return [(e, count) for e, (count, _) in enumerate(zip(counts, given, strict=False))]


def topologies_of(given, counts):
    """Return the topologies in which each exchange holds for so many ticks, over and over."""
    ends = np.cumsum([1, *(count for _, count in in_turn(counts, given))]).tolist()
    return TopologySchedule.of(given, ends[:-1], ends[-1] - 1)


def whole_period(algorithm, given, turns, h):
    A = np.eye(2 * given[0].position.n)
    for e, count in turns:
        A = np.linalg.matrix_power(dense(algorithm, given[e], h), count) @ A
    return A


# Who receives from whom, and when


def test_phases_begin_where_they_say_and_come_again():
    given = [InteractionGraphs.of(CHAIN), InteractionGraphs.of(OTHER_WAY)]
    once = TopologySchedule.of(given, [1, 4])
    again = TopologySchedule.of(given, [1, 4], 5)
    assert [once.at(k) for k in range(1, 13)] == [0, 0, 0, *[1] * 9]
    assert [again.at(k) for k in range(1, 13)] == [0, 0, 0, 1, 1] * 2 + [0, 0]
    assert again.phases() == [(0, 3), (1, 2)]
    links = [*zip(again.links.source.tolist(), again.links.sink.tolist(), strict=True)]
    assert links == [(0, 1), (2, 1), (0, 2), (1, 2)]
    assert TopologySchedule.constant(CHAIN).links is CHAIN


@quick
@given(exchanges())
def test_the_links_are_the_union_of_all_phases(given):
    both = [t for e in given for t in (e.position, e.velocity)]
    full = np.zeros((both[0].n + 1, both[0].n + 1))
    for t in both:
        full[t.sink, t.source] = np.maximum(full[t.sink, t.source], t.weight)
    links = TopologySchedule.of(given, range(1, len(given) + 1)).links
    sink, source = np.nonzero(full)
    assert links.sink.tolist() == sink.tolist()
    assert links.source.tolist() == source.tolist()
    assert links.weight.tolist() == full[sink, source].tolist()


# Jumps


@quick
@given(exchanges(), counts, gains, gains, periods, st.integers(0, 9))
def test_agents_jump_by_the_recursion_of_their_tick(given, counts, alpha, beta, h, seed):
    """Agents that receive from one another and a moving target, against dense matrices in turn."""
    rng, n = np.random.default_rng(seed), given[0].position.n
    topologies = topologies_of(given, counts)
    for algorithm in (FirstOrder(alpha, beta), SecondOrder(alpha, beta)):
        matrices = [dense(algorithm, exchange, h) for exchange in given]
        for exchange, matrix in zip(given, matrices, strict=True):
            ours = recursion_of(algorithm, exchange, h)
            np.testing.assert_allclose(as_array(ours.matrix), matrix, atol=1e-12)
        agents = agents_at(
            np.arange(1, n + 1), topologies, algorithm, Estimate(*rng.normal(size=(2, n, 2)))
        )
        order = [e for e, count in in_turn(counts, given) for _ in range(count)]
        x = None
        for k in range(1, 15):
            now, then = HARMONIC.at(k * h), HARMONIC.at((k + 1) * h)
            left = agents.left(h)
            error = np.concatenate([left.position - now.position, left.velocity - now.velocity])
            if x is not None:
                scale = 1 + np.abs(x).max() + np.abs(now.position).max()
                np.testing.assert_allclose(error, x, atol=1e-11 * scale)
            receive(agents, k, np.array([0]), now.position[None], now.velocity[None])
            receive(agents, k, agents.robots, left.position, left.velocity)
            agents.jump(k, left)
            slip = [now.position + h * now.velocity - then.position, now.velocity - then.velocity]
            x = matrices[order[(k - 1) % len(order)]] @ error + np.repeat(slip, n, axis=0)


# What settles


@quick
@given(exchanges(), counts, gains, gains, periods)
def test_the_spectral_radius_of_a_period_is_that_of_its_product(given, counts, alpha, beta, h):
    turns = in_turn(counts, given)
    ticks = sum(count for _, count in turns)
    for algorithm in (FirstOrder(alpha, beta), SecondOrder(alpha, beta)):
        recursions = [recursion_of(algorithm, exchange, h) for exchange in given]
        product = whole_period(algorithm, given, turns, h)
        expected = np.abs(np.linalg.eigvals(product)).max()
        ours = period_radius(recursions, turns)
        # An eigenvalue of a defective product of order p is off by as much as eps^(1/p).
        assert ours**ticks == pytest.approx(expected, rel=1e-3, abs=0.02)
        copies = np.abs(np.linalg.eigvals(as_array(period(recursions, turns).matrix))).max()
        assert ours == pytest.approx(copies, rel=1e-3, abs=0.15)


def test_the_spectral_radius_is_found_without_forming_the_product(monkeypatch):
    """Of large digraphs it is Arnoldi's method that finds it, where the largest stands out."""
    rng, n = np.random.default_rng(2), 60
    given = []
    for _ in range(2):
        adjacency = (rng.random((n, n)) < 0.1) * (1 - np.eye(n)) + np.eye(n, k=-1)
        given.append(InteractionGraphs.of(Topology.of(adjacency, np.eye(n)[0])))
    turns = [(0, 3), (1, 2)]
    recursions = [recursion_of(SecondOrder(0.5, 0.5), exchange, 0.1) for exchange in given]
    dense = period_radius(recursions, turns)
    monkeypatch.setattr(switching, "DENSE", 10)
    assert period_radius(recursions, turns) == pytest.approx(dense, rel=1e-9)
    monkeypatch.setattr(switching, "WORK", 0)
    both_ways = [recursion_of(SecondOrder(0.5, 0.5), ring(300, both=True), 0.1)] * 2
    assert np.isnan(period_radius(both_ways, turns))


@quick
@given(exchanges(), gains, gains)
def test_positions_and_velocities_converge_each_over_its_own_digraph(given, alpha, beta):
    """Theorem 1, necessary and sufficient, for hetero-information: α and β have bounds apart."""
    algorithm, exchange = FirstOrder(alpha, beta), given[0]
    own = [spectrum_of(t) for t in (exchange.position, exchange.velocity)]
    conditions = algorithm.conditions(own[0], 0.1, own[1])
    for gain, condition, s in zip((alpha, beta), conditions, own, strict=True):
        assert condition.right == smallest_theta(s)
        assume(abs(gain / condition.right - 1) > 1e-3)
    radius = spectral_radius(algorithm.modes(own[0], 0.1, own[1]))
    expected = np.abs(np.linalg.eigvals(dense(algorithm, exchange, 0.1))).max()
    assert radius == pytest.approx(expected, abs=0.02)
    assert all(c.holds for c in conditions) == (radius < 1)
    for radius, settles in ((0.999, True), (1.001, False)):
        bounds = [smallest_theta(s) for s in own]
        at_bounds = FirstOrder(radius * bounds[0], radius * bounds[1])
        assert (spectral_radius(at_bounds.modes(own[0], 0.1, own[1])) < 1) == settles


@pytest.mark.parametrize(("gain", "settles"), [(0.97, True), (0.999, True), (1.001, False)])
def test_gains_below_1_converge_in_any_order_and_above_1_may_not(gain, settles):
    """The digraphs' own bounds are 2; in turn, the position's blocks have trace g² + 2 (1 − g)²."""
    algorithm = FirstOrder(gain, gain)
    recursions = [recursion_of(algorithm, t, 0.1) for t in (CHAIN, OTHER_WAY)]
    assert all(c.holds for t in (CHAIN, OTHER_WAY) for c in algorithm.conditions(spectrum_of(t), 1))
    trace, determinant = gain**2 + 2 * (1 - gain) ** 2, (1 - gain) ** 4
    radius = np.sqrt(trace / 2 + np.sqrt(trace**2 / 4 - determinant))
    assert period_radius(recursions, [(0, 1), (1, 1)]) == pytest.approx(radius, rel=1e-12)
    assert (radius < 1) == settles
    assert contracts_in_any_order(recursions[0].keep, recursions[0].gain) == settles
    bounds = any_order(recursions)
    assert bounds.lower == pytest.approx(radius, rel=1e-9)
    assert bounds.upper == pytest.approx(radius, rel=1.1e-3)


@quick
@given(exchanges(most=4), st.floats(0.05, 0.95), st.floats(0.05, 0.95), st.floats(0.01, 1))
def test_in_any_order_the_target_reaches_all_robots_in_n_ticks(given, alpha, beta, h):
    """‖P_n ⋯ P_1‖∞ ≤ 1 − μ^n of every order: what docs/theory.md proves, by trying all."""
    n = given[0].position.n
    algorithm = FirstOrder(alpha, beta)
    assert contracts_in_any_order(*linear_jump(algorithm))
    for gain, part in ((alpha, "position"), (beta, "velocity")):
        digraphs = [getattr(exchange, part) for exchange in given]
        blocks = [np.eye(n) - gain * (np.eye(n) - as_array(t.D)) for t in digraphs]
        mu = min(1 - gain, *(float(gain * t.normalised.min()) for t in digraphs))
        for order in product(blocks, repeat=n):
            whole = np.linalg.multi_dot([np.eye(n), *order])
            assert np.abs(whole).sum(axis=1).max() <= 1 - mu**n + 1e-12
    bounds = any_order([recursion_of(algorithm, exchange, h) for exchange in given])
    assert bounds.lower < 1


def test_for_other_algorithms_gains_prove_no_order():
    for algorithm in (SecondOrder(0.5, 0.5), Impulsive(0.5, 0.5), FirstOrder(0.5, 1.0)):
        assert not contracts_in_any_order(*linear_jump(algorithm))


# How near


@pytest.mark.parametrize("algorithm", [FirstOrder(0.9, 0.8), SecondOrder(1.1, 0.9)])
def test_the_periodic_steady_state_is_where_long_runs_end(algorithm):
    given = [InteractionGraphs.of(Topology.of([[0, 1, 0], [0.5, 0, 0], [1, 1, 0]], [1, 0, 0]))]
    given += [InteractionGraphs.of(Topology.of([[0, 0, 2], [0.5, 0, 1], [0, 0, 0]], [0, 0, 1]))]
    h, turns, n = 0.1, [(0, 2), (1, 1)], 3
    recursions = [recursion_of(algorithm, exchange, h) for exchange in given]
    radius = period_radius(recursions, turns)
    assert radius < 1
    whole = period(recursions, turns)
    motion = steady_motion(whole, HARMONIC, radius)
    bound, always = (
        of(whole, *HARMONIC.bounds(), radius) for of in (worst_case, worst_case_always)
    )
    x, late = np.zeros((2 * n, 2)), []
    for k in range(1, 600):
        now, then = HARMONIC.at(k * h), HARMONIC.at((k + 1) * h)
        slip = [now.position + h * now.velocity - then.position, now.velocity - then.velocity]
        x = dense(algorithm, given[0 if k % 3 else 1], h) @ x + np.repeat(slip, n, axis=0)
        if k > 400:
            late.append(x.reshape(2, n, 2))
    np.testing.assert_allclose(motion.at(np.arange(402, 601)), late, atol=1e-9)
    np.testing.assert_array_equal(motion.at(402), motion.at(np.arange(402, 601))[0])
    sizes = np.abs(x.reshape(2, n, 2)).max(axis=(1, 2))
    assert sizes[0] <= motion.bound.position <= bound.position <= always.position
    assert sizes[1] <= motion.bound.velocity <= bound.velocity <= always.velocity


def test_an_adversarial_target_comes_near_the_worst_case_bound_of_a_period():
    """|a_0| ≤ 1 with the sign that is worst for one robot at the end, and γ1 out of the way."""
    algorithm, h = FirstOrder(0.9, 0.8), 0.1
    recursions = [recursion_of(algorithm, t, h) for t in (CHAIN, OTHER_WAY)]
    whole = period(recursions, [(0, 1), (1, 1)])
    bound = worst_case(whole, 1e6, 1.0, period_radius(recursions, [(0, 1), (1, 1)]))
    A = [dense(algorithm, InteractionGraphs.of(t), h) for t in (CHAIN, OTHER_WAY)]
    worst = np.zeros(2)
    for last in (0, 1):
        through, total = np.eye(4), np.zeros(4)
        for j in range(400):
            p, r = through[:, :2].sum(axis=1), through[:, 2:].sum(axis=1)
            u = (np.arange(200) + 0.5) / 200 * h
            total += np.abs(u[:, None] * p + r).mean(axis=0) * h
            through = through @ A[(last - j) % 2]
        worst = np.maximum(worst, total.reshape(2, 2).max(axis=1))
    assert bound.position == pytest.approx(worst[0], rel=1e-4)
    assert bound.velocity == pytest.approx(worst[1], rel=1e-4)


# Which algorithms take two digraphs


def test_algorithms_declare_whether_they_support_separate_digraphs():
    apart = {name for name in algorithm_names() if takes_separate_graphs(name)}
    assert apart & {"dcea1", "dcea2", "impulsive", "pd_like", "sliding"} == {"dcea1", "sliding"}
    rng = np.random.default_rng(4)
    for name in apart & {"dcea1", "sliding"}:
        algorithm = load_algorithm(name, {"alpha": 0.7, "beta": 0.6})
        left, received = Estimate(*rng.normal(size=(2, 5, 2))), rng.normal(size=(2, 5, 2))
        whole = algorithm.jump(left, Estimate(*received))
        position = algorithm.jump(left, Estimate(received[0], 0 * received[1]))
        velocity = algorithm.jump(left, Estimate(0 * received[0], received[1]))
        assert np.array_equal(whole.position, position.position)
        assert np.array_equal(whole.velocity, velocity.velocity)
    assert len(Sliding(1, 1).modes(np.zeros(2), 0.1, np.zeros(2))) == 0


# The limits of what is looked for, without waiting for it


@pytest.mark.parametrize(
    ("topology", "is_tried"),
    [
        (ring(LARGEST, True), True),
        (ring(LARGEST + 1, True), False),
        (Topology.of_edges(500, np.arange(500), np.arange(1, 501), np.ones(500)), True),
        (Topology.of_edges(501, np.arange(501), np.arange(1, 502), np.ones(501)), False),
    ],
    ids=["largest part", "part too large", "largest matrix", "matrix too large"],
)
def test_the_joint_spectral_radius_is_computed_up_to_a_size(monkeypatch, topology, is_tried):
    recursion = recursion_of(FirstOrder(0.9, 1.1), topology, 0.1)
    tried = []
    monkeypatch.setattr(switching, "joint_spectral_radius", tried.append)
    assert any_order([recursion, recursion]) is None
    assert len(tried) == is_tried
    for matrices in tried:
        assert [matrix.shape for matrix in matrices] == [recursion.matrix.shape] * 2


@pytest.mark.parametrize("most", [1000, 2], ids=["by the product", "by Arnoldi's method"])
@pytest.mark.parametrize("algorithm", [FirstOrder(0.9, 1.1), SecondOrder(1.1, 0.9)])
def test_the_spectral_radius_of_a_period_agrees_with_the_dense_product(
    monkeypatch, algorithm, most
):
    monkeypatch.setattr(switching, "DENSE", most)
    given = [InteractionGraphs.of(ring(5, both)) for both in (True, False)]
    found = period_radius([recursion_of(algorithm, e, 0.2) for e in given], [(0, 3), (1, 2)])
    first, second = (dense(algorithm, exchange, 0.2) for exchange in given)
    product_ = np.linalg.matrix_power(second, 2) @ np.linalg.matrix_power(first, 3)
    assert found == pytest.approx(np.abs(np.linalg.eigvals(product_)).max() ** (1 / 5), rel=1e-9)
