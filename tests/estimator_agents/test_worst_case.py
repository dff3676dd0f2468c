"""The worst case against linear programmes, recursions of the target found, and closed forms."""

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import linprog

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.impulsive import Impulsive
from nrs_cosim.estimator_agents.target import Sampled
from nrs_cosim.estimator_agents.theory.estimates import (
    slip,
    worst,
    worst_case,
    worst_case_always,
)
from nrs_cosim.estimator_agents.theory.recursion import recursion_of
from nrs_cosim.estimator_agents.theory.spectrum import spectral_radius, spectrum_of
from nrs_cosim.estimator_agents.theory.worst_case import (
    ErrorRecursion,
    responses,
    worst_case_of,
    worst_motion,
)
from nrs_cosim.estimator_agents.theory.worst_target import worst_targets
from tests.bus.test_topology import PAPER
from tests.cases import cases

ALONE = Topology.of(np.zeros((1, 1)), np.ones(1))


def drawn(rng, of):
    """Return a recursion that forgets soon, its ρ, and bounds on a target."""
    while True:
        n = int(rng.integers(1, 5))
        adjacency = np.where(rng.random((n, n)) < 0.4, rng.uniform(0.1, 3, (n, n)), 0)
        np.fill_diagonal(adjacency, 0)
        pinning = np.where(rng.random(n) < 0.4, 1.0, 0.0)
        pinning[0] = 1
        for i in range(1, n):
            adjacency[i, rng.integers(0, i)] = 1
        first = FirstOrder(*rng.uniform(0.3, 1.3, 2))
        second = SecondOrder(rng.uniform(0.3, 1.2), rng.uniform(0.3, 1))
        algorithm = (first, second, Impulsive(rng.uniform(0.3, 1.2), rng.uniform(0.3, 1.4)))[of % 3]
        topology, h = Topology.of(adjacency, pinning), 10 ** rng.uniform(-1, 0.3)
        rho = spectral_radius(algorithm.modes(spectrum_of(topology), h))
        if rho < 0.7:
            return recursion_of(algorithm, topology, h), rho, 1.0, 10 ** rng.uniform(-2, 1.2)


def programme(recursion, row, held, gamma_1, gamma_2, parts=4):
    """Return the most that |υ_0| ≤ γ1 and |Δυ_0| ≤ γ2 dt on a grid make of an error."""
    n, A, step = recursion.n, recursion.matrix, recursion.h / parts
    kept = recursion.flow @ recursion.keep
    responses = []
    while np.abs(row).max() > 1e-9:
        responses.append((row[:n].sum(), row[n:].sum()))
        row = row @ A
    cost = np.zeros(len(responses) * parts + 1)
    for j, (p, r) in enumerate(responses):
        last = len(cost) - 1 - j * parts
        first = last - parts
        cost[first] += p * kept[0, 1] + r * kept[1, 1]
        cost[last] -= r
        cost[first:last] -= p * step / 2
        cost[first + 1 : last + 1] -= p * step / 2
    cost[-1] += held
    shape = (len(cost) - 1, len(cost))
    change = sparse.diags_array(
        [-np.ones(shape[0]), np.ones(shape[0])], offsets=[0, 1], shape=shape
    )
    scale, most = np.abs(cost).max(), gamma_1 / (gamma_2 * step)
    found = linprog(  # of υ_0/(γ2 dt), for HiGHS is within 1e-7 of what it is asked for
        -cost / scale,
        A_ub=sparse.vstack([change, -change]),
        b_ub=np.ones(2 * shape[0]),
        bounds=(-most, most),
        method="highs",
    )
    return -found.fun * scale * gamma_2 * step


@pytest.mark.parametrize("seed", cases(range(6), range(3)))
def test_no_target_of_a_linear_programme_is_beyond_the_worst_case_and_one_is_near(seed):
    rng = np.random.default_rng(seed)
    for case in range(50):
        recursion, rho, gamma_1, gamma_2 = drawn(rng, case)
        row = int(rng.integers(0, 2 * recursion.n))
        after = case % 2
        seen = recursion.jump if after else np.eye(2 * recursion.n)
        held = (recursion.keep - np.eye(2))[row // recursion.n, 1] * after
        (response,) = responses(ErrorRecursion.of(recursion), seen[[row]], held, 10_000)
        found = worst_case_of(response, gamma_1, gamma_2)
        most = programme(recursion, seen[row], held, gamma_1, gamma_2)
        assert most <= found.bound * (1 + 1e-6) + 1e-7
        assert found.reached <= found.bound * (1 + 1e-12) + 1e-12
        assert found.reached >= most * (1 - 2e-3) - 1e-7
        assert found.bound <= found.reached * 1.02
        loose = worst(recursion, gamma_1, gamma_2, rho, seen, recursion.h)[row]
        assert found.reached <= (loose + abs(held) * gamma_1) * (1 + 1e-9)
        before_end, velocity = worst_motion(found, gamma_1, gamma_2)
        assert np.abs(velocity).max() <= gamma_1 * (1 + 1e-9)
        assert np.all(
            np.abs(np.diff(velocity)) <= gamma_2 * -np.diff(before_end) * (1 + 1e-6) + 1e-12
        )
        x = error_at_the_end(recursion, seen[row], held, before_end, velocity)
        assert x == pytest.approx(found.reached, rel=1e-5, abs=1e-9)


def error_at_the_end(recursion, row, held, before_end, velocity):
    """Return a row's error by the recursion, for a velocity that is straight between times."""
    n, h = recursion.n, recursion.h
    periods = round(before_end[0] / h)
    times = -before_end
    moved = np.append(0, np.cumsum(np.diff(times) * (velocity[1:] + velocity[:-1]) / 2))

    def at(t):
        v = np.interp(t, times, velocity)
        i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 1)
        return np.array([moved[i] + (t - times[i]) * (v + velocity[i]) / 2, v])

    x, state = np.zeros(2 * n), at(-periods * h)
    steady = np.eye(2 * n) - recursion.matrix
    x = np.linalg.solve(steady, np.kron(recursion.drag[:, 1] * state[1], np.ones(n)))
    for k in range(periods):
        then = at((k + 1 - periods) * h)
        delta = recursion.flow @ recursion.keep @ state - then
        x, state = recursion.matrix @ x + np.kron(delta, np.ones(n)), then
    return row @ x + held * velocity[-1]


@pytest.mark.parametrize(("h", "gamma_1", "gamma_2"), [(0.1, 3.0, 1.0), (1.0, 0.2, 5.0)])
def test_an_error_that_is_forgotten_at_once_is_what_the_target_slips_by(h, gamma_1, gamma_2):
    recursion = recursion_of(FirstOrder(1.0, 1.0), ALONE, h)
    found = worst_case(recursion, gamma_1, gamma_2, 0.0)
    # ε̄ of before learns of ῡ of one period ago: x = Δ(k) + A Δ(k − 1), with A² = 0.
    assert found.velocity == pytest.approx(min(2 * gamma_1, h * gamma_2), rel=1e-3)
    assert found.position >= slip(h, gamma_1, gamma_2) * (1 - 1e-9)


def test_a_response_of_one_sign_is_filled_to_the_level_of_its_longest_times():
    """W3: u = min(N, λ), of the λ above which N stays for 2 γ1/γ2."""
    gamma_1, gamma_2, h = 1.0, 1.0, 0.05
    recursion = recursion_of(FirstOrder(0.05, 0.05), ALONE, h)
    (response,) = responses(ErrorRecursion.of(recursion), np.array([[1.0, 0.0]]), 0.0, 10_000)
    widths, begin, end, _ = response.pieces(0.001)
    N = np.sort((begin + end) / 2)[::-1]
    order = np.argsort(-(begin + end) / 2)
    above = np.cumsum(widths[order])
    level = N[np.searchsorted(above, 2 * gamma_1 / gamma_2)]
    expected = gamma_2 * widths[order] @ np.maximum(N - level, 0) + 2 * gamma_1 * level
    assert worst_case_of(response, gamma_1, gamma_2).bound == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize(
    ("algorithm", "gamma_1", "gamma_2"),
    [
        (FirstOrder(0.9, 1.1), 3.0, 1.0),
        (FirstOrder(0.5, 0.5), 0.3, 2.0),
        (SecondOrder(1.1, 0.9), 0.5, 1.0),
        (Impulsive(1.1, 0.9), 1.0, 1.0),
    ],
)
def test_the_spline_of_a_worst_target_is_within_its_bounds_and_attains_the_worst_case(
    algorithm, gamma_1, gamma_2
):
    h, topology = 0.1, Topology.of(*PAPER)
    recursion = recursion_of(algorithm, topology, h)
    rho = spectral_radius(algorithm.modes(spectrum_of(topology), h))
    bound = worst_case(recursion, gamma_1, gamma_2, rho)
    always = worst_case_always(recursion, gamma_1, gamma_2, rho, bound)
    both = worst_targets(recursion, gamma_1, gamma_2, rho)
    for half, (one, most) in enumerate(zip(both, (bound.position, bound.velocity), strict=True)):
        target = Sampled.of(one.times, one.positions[:, None])
        speed, pull = target.bounds()
        assert speed <= gamma_1
        assert pull <= gamma_2
        x = np.zeros((2, 6))
        for k in range(1, one.tick + 1):
            after = (recursion.jump @ x.ravel()).reshape(2, 6)
            # What is after a jump has the target's own state to lose too, where it drags.
            now, then = target.at((k - 1) * h), target.at(k * h)
            lost = (recursion.keep - np.eye(2)) @ [now.position[0], now.velocity[0]]
            assert np.all(
                np.abs(after + lost[:, None]) <= np.c_[[always.position, always.velocity]]
            )
            kept = recursion.flow @ recursion.keep @ [now.position[0], now.velocity[0]]
            delta = kept - [then.position[0], then.velocity[0]]
            x = (recursion.matrix @ x.ravel()).reshape(2, 6) + delta[:, None]
            assert np.all(np.abs(x[half]) <= most * (1 + 1e-6) + 1e-9)
        assert x[half, one.robot - 1] >= 0.99 * most


def test_velocities_that_are_means_of_the_targets_err_by_twice_its_speed_at_most():
    pinned = np.zeros(100)
    pinned[0] = 1
    topology = Topology.of(np.roll(np.eye(100), 1, axis=0), pinned)
    algorithm = FirstOrder(0.9, 0.9)
    rho = spectral_radius(algorithm.modes(spectrum_of(topology), 0.1))
    recursion = recursion_of(algorithm, topology, 0.1)
    bound = worst_case_always(recursion, 3.0, 1.0, rho)
    assert bound.velocity == pytest.approx(6.0, rel=1e-3)
    assert bound.velocity <= 6.0
