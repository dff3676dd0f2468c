"""Late links, beside recursions written out edge by edge and powers of their matrices."""

from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.dcea3 import ThirdOrder
from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.theory import delays
from nrs_cosim.estimator_agents.theory.delays import (
    LateStep,
    common_radius,
    contraction,
    delay_margin,
    switching_radius,
)
from nrs_cosim.estimator_agents.theory.late_states import block_radius, is_proven
from nrs_cosim.estimator_agents.theory.linear_step import linear_step
from tests.cases import cases as number
from tests.estimator_agents.digraphs import digraphs, drawn, ring
from tests.estimator_agents.paper import ADJACENCY, PINNING, D
from tests.estimator_agents.powers import growth

EXAMPLE = Topology.of(ADJACENCY, PINNING)
SPECTRUM = np.linalg.eigvals(D).astype(complex)
CASES = number(1000, 300)


def laws(rng):
    """Return an algorithm with random gains, and F, K and G as its own module has them."""
    alpha, beta, gamma = rng.uniform(0.05, 1.4, 3)
    h = rng.uniform(0.05, 0.6)
    flow = np.array([[1, h], [0, 1]])
    which = rng.integers(3)
    if which == 0:
        return FirstOrder(alpha, beta), h, flow, np.diag([alpha, beta])
    if which == 1:
        return SecondOrder(alpha, beta), h, flow, np.array([[0, 0], [alpha, beta]])
    flow = np.array([[1, h, h * h / 2], [0, 1, h], [0, 0, 1]])
    return ThirdOrder(alpha, beta, gamma), h, flow, np.diag([alpha, beta, gamma])


def by_edges(flow, gain, topology, delay, longest):
    """Return the matrix of all robots' states of the last longest + 1 ticks, robot by robot."""
    n, s = topology.n, len(flow)
    whole = np.zeros(((longest + 1) * n, s, (longest + 1) * n, s))
    for i in range(n):
        whole[i, :, i] += flow @ (np.eye(s) - gain)
    for j, i, w, d in zip(topology.source, topology.sink, topology.normalised, delay, strict=True):
        if j:
            whole[i - 1, :, d * n + j - 1] += w * flow @ gain
    for row in range(n, (longest + 1) * n):
        whole[row, :, row - n] = np.eye(s)
    return whole.reshape((longest + 1) * n * s, -1)


@cache
def cases():
    """Return periods of laws over random digraphs, whose edges are late by times of their own."""
    rng, found = np.random.default_rng(1), []
    for _ in range(CASES):
        algorithm, h, flow, gain = laws(rng)
        topology = drawn(rng, rng.integers(1, 4))
        delay = rng.integers(0, 4, len(topology.source))
        found.append((LateStep(linear_step(algorithm, h), topology, delay), flow, gain))
    return found


def eigenvalues(late):
    return np.linalg.eigvals(late.topology.D).astype(complex)


def test_the_radius_is_the_growth_of_a_recursion_written_out_by_edges():
    for late, flow, gain in cases():
        expected = growth(by_edges(flow, gain, late.topology, late.delay, 3))
        assert late.radius(eigenvalues(late)) == pytest.approx(expected, abs=2e-6)
        common = int(late.delay[0])
        expected = growth(by_edges(flow, gain, late.topology, 0 * late.delay + common, 3))
        found = common_radius(late.step, eigenvalues(late), common)
        assert found == pytest.approx(expected, abs=2e-6)


def test_errors_settle_to_the_steady_motion_over_late_links():
    """All cases are simulated at once: what agents keep, what is under way, and the target."""
    rng, n, longest, ticks = np.random.default_rng(2), 3, 3, 500
    waves = rng.uniform(-1, 1, (2, 2)), rng.uniform(0.1, 3, (2, 2)), rng.uniform(0, 6, (2, 2))
    target = Harmonic(np.array([1.0, -2.0]), np.array([0.7, 0.0]), *waves)
    found = [
        (late, flow, gain, late.topology)
        for late, flow, gain in cases()
        if late.radius(eigenvalues(late)) < 0.95
    ]
    assert len(found) > CASES // 2
    size = (longest + 1) * n * 3
    A, received = np.zeros((len(found), size, size)), np.zeros((len(found), longest + 1, size, 3))
    for case, (late, flow, gain, topology) in enumerate(found):
        whole, s = by_edges(flow, gain, topology, late.delay, longest), len(flow)
        A[case, : len(whole), : len(whole)] = whole
        for e in np.flatnonzero(topology.source == 0):
            rows = (topology.sink[e] - 1) * s + np.arange(s)
            received[case, late.delay[e], rows, :s] += topology.normalised[e] * flow @ gain
    periods = np.array([late.step.h for late, *_ in found])

    def truth(k):
        motion = target.at(k * periods)
        return np.stack([motion.position, motion.velocity, target.acceleration(k * periods)], 1)

    x = np.zeros((len(found), size, 2))
    for k in range(ticks):
        x = A @ x
        for d in range(longest + 1):
            x += received[:, d] @ truth(k - d)
    last = truth(ticks)
    for case, (late, flow, _, topology) in enumerate(found):
        s = len(flow)
        error = x[case, : topology.n * s].reshape(topology.n, s, 2) - last[case, :s]
        motion = late.steady_motion(target)
        assert error.transpose(1, 0, 2) == pytest.approx(motion.at(ticks), abs=1e-7)
        assert np.abs(motion.at(ticks)[:2]).max(axis=(1, 2)).tolist() <= [
            motion.bound.position * (1 + 1e-9),
            motion.bound.velocity * (1 + 1e-9),
        ]


def test_what_remains_of_errors_goes_on_as_it_is_written_out_by_edges():
    rng = np.random.default_rng(3)
    for late, flow, gain in cases():
        topology, delay, s = late.topology, late.delay, len(flow)
        recent = [rng.normal(size=(s, topology.n, 2)) for _ in range(4)]
        given = np.concatenate([x.transpose(1, 0, 2).reshape(-1, 2) for x in recent[::-1]])
        after = (by_edges(flow, gain, topology, delay, 3) @ given)[: topology.n * s]
        found = late.advance(recent, late.parts())
        assert found.transpose(1, 0, 2).reshape(-1, 2) == pytest.approx(after, abs=1e-12)


def test_no_delays_that_change_at_each_tick_and_link_break_the_contraction():
    """The bound is that of the proof: a factor q in as many ticks as the longest delay and one."""
    tried, rng = 0, np.random.default_rng(4)
    for late, flow, gain in cases():
        step, topology, longest = late.step, late.topology, int(rng.integers(1, 4))
        r = contraction([step], eigenvalues(late))
        if not r < 0.999:
            continue
        tried += 1
        q, s, n = (1 + r) / 2, len(flow), topology.n
        M = np.kron(np.abs(step.own), np.eye(n)) + np.kron(np.abs(step.received), topology.D)
        w = np.linalg.solve(q * np.eye(s * n) - M, np.ones(s * n)).reshape(s, n).T.ravel()
        assert w.min() > 0
        x = np.tile(w, longest + 1) * rng.choice([-1, 1], len(w) * (longest + 1))
        for _ in range(3):
            for _ in range(longest + 1):
                delay = rng.integers(0, longest + 1, len(topology.source))
                x = by_edges(flow, gain, topology, delay, longest) @ x
            assert np.abs(x / np.tile(w, longest + 1)).max() <= q * (1 + 1e-12)
            x = np.tile(w, longest + 1) * np.sign(x)
    assert tried > CASES // 3


def test_gains_up_to_one_contract_on_every_digraph():
    step = linear_step(FirstOrder(1.0, 1.0), 0.3)
    assert all(contraction([step], eigenvalues(late)) < 1 for late, *_ in cases())


def test_the_margin_is_the_last_delay_up_to_which_all_powers_vanish(monkeypatch):
    monkeypatch.setattr(delays, "MOST", 4)
    kinds = []
    for late, flow, gain in cases():
        margin = delay_margin(late.step, eigenvalues(late))
        kinds.append(margin.kind)
        last = -1 if margin.periods is None else margin.periods
        for d in range(5 if margin.kind != "exact" else last + 2):
            recursion = by_edges(flow, gain, late.topology, 0 * late.delay + d, d)
            assert (growth(recursion) < 1) == (margin.kind != "exact" or d <= last)
    assert {*kinds} == {"exact", "at least", "any"}


@pytest.mark.parametrize(
    ("h", "periods", "radius"),
    [
        (0.4, 0, 0.890128), (0.4, 1, 1.011777), (0.4, 2, 1.018898),
        (0.1, 0, 0.883173), (0.1, 1, 0.895397), (0.1, 2, 0.914885),
    ],
)  # fmt: skip
def test_with_delays_the_radius_of_the_paper_s_example_is_known(h, periods, radius):
    step = linear_step(SecondOrder(1.1, 0.9), h)
    assert common_radius(step, SPECTRUM, periods) == pytest.approx(radius, abs=5e-7)
    late = LateStep(step, EXAMPLE, np.full(len(EXAMPLE.source), periods))
    assert block_radius(late.matrix()) == pytest.approx(radius, abs=5e-7)


def test_of_many_robots_with_delays_of_their_own_the_radius_is_that_of_the_dense_matrix():
    topology, rng = ring(60, both=True), np.random.default_rng(7)
    step = linear_step(SecondOrder(0.5, 0.9), 0.1)
    late = LateStep(step, topology, rng.integers(0, 3, len(topology.source)))
    matrix = late.matrix()
    assert not isinstance(matrix, np.ndarray)
    dense = np.abs(np.linalg.eigvals(matrix.toarray())).max()
    assert late.radius(np.zeros(0, complex)) == pytest.approx(dense, rel=1e-8)


@pytest.mark.parametrize(
    ("algorithm", "proven"), [(FirstOrder(0.9, 0.8), True), (SecondOrder(0.5, 0.9), False)]
)
def test_of_a_large_block_the_radius_is_proven_where_nothing_is_negative(algorithm, proven):
    """Arnoldi's method alone proves nothing; a positive vector that shrinks does."""
    topology, rng = ring(400, both=True), np.random.default_rng(7)
    delay = rng.integers(0, 3, len(topology.source))
    matrix = LateStep(linear_step(algorithm, 0.1), topology, delay).matrix()
    radius = block_radius(matrix)
    assert radius < 1
    assert is_proven(matrix, radius) is proven
    assert not is_proven(matrix, 1.0)


def test_delays_too_long_to_be_looked_at_have_no_radius(monkeypatch):
    monkeypatch.setattr(delays, "WORK", 1e5)
    step = linear_step(ThirdOrder(0.7, 0.6, 0.5), 0.4)
    assert np.isnan(common_radius(step, SPECTRUM, 1000))


def test_delays_that_are_drawn_lie_between_the_bounds_of_switching_ages():
    """Of two robots that receive from one another, beside all products of up to five recursions."""
    topology, rng = Topology.of([[0, 1], [1, 0]], [1, 0]), np.random.default_rng(6)
    least, most = np.array([0, 0, 0]), np.array([1, 1, 1])
    for case in range(number(300, 2)):
        h, alpha, beta = (
            rng.uniform([0.1, 0.3, 0.3], [0.6, 1.4, 1.4])
            if case > 1
            else (
                0.3,
                (0.5, 1.3)[case],
                1.2,
            )
        )
        flow, gain = np.array([[1, h], [0, 1]]), np.array([[0, 0], [alpha, beta]])
        step = linear_step(SecondOrder(alpha, beta), h)
        found = switching_radius(step, topology, least, most)
        matrices = np.array(
            [
                by_edges(flow, gain, topology, np.array([0, *ages]), 1)
                for ages in product((0, 1), repeat=2)
            ]
        )
        worst, words = 0.0, np.eye(8)[None]
        for length in range(1, 6):
            words = (words[:, None] @ matrices).reshape(-1, 8, 8)
            radii = np.abs(np.linalg.eigvals(words))
            worst = max(worst, radii.max() ** (1 / length))
        assert worst <= found.upper * (1 + 1e-9)
        assert found.lower <= found.upper
        assert found.lower >= worst * (1 - 1e-3)
    assert (
        switching_radius(step, ring(10, both=True), *np.array([[0], [1]]) * np.ones(21, int))
        is None
    )


@given(digraphs(most=3), st.floats(0.05, 1.5), st.floats(0.05, 1.5), st.floats(0.01, 1), st.data())
@settings(max_examples=60, deadline=None, derandomize=True, database=None)
def test_on_any_digraph_with_any_delays_the_radius_is_the_growth(topology, alpha, beta, h, data):
    edges = len(topology.source)
    delay = np.array(data.draw(st.lists(st.integers(0, 2), min_size=edges, max_size=edges)))
    flow, gain = np.array([[1, h], [0, 1]]), np.array([[0, 0], [alpha, beta]])
    late = LateStep(linear_step(SecondOrder(alpha, beta), h), topology, delay)
    expected = growth(by_edges(flow, gain, topology, delay, 2))
    assert late.radius(eigenvalues(late)) == pytest.approx(expected, abs=2e-6)
