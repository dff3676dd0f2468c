"""The noise floor and the most that rounding adds, against plain simulation and linear algebra."""

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.theory.linear_step import linear_step
from nrs_cosim.estimator_agents.theory.noise import noise_floor, received_covariance
from nrs_cosim.estimator_agents.theory.received_errors import rounding_errors
from tests.cases import cases
from tests.estimator_agents.digraphs import digraphs

CHAINS = 1000
FUZZ = settings(
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=300,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
KINDS = {1: FirstOrder, 2: SecondOrder}
extent = st.sampled_from([0.0, 0.01, 0.3, 2.0])


@st.composite
def noisy(draw):
    """Draw an algorithm, a digraph, and standard deviations by field and edge."""
    order, h = draw(st.sampled_from([1, 2])), draw(st.sampled_from([0.05, 0.2, 0.5]))
    alpha, beta = draw(st.floats(0.2, 1.3)), draw(st.floats(0.3, 1.2))
    topology = draw(digraphs(4))
    edges = len(topology.source)
    of = {
        name: np.array(draw(st.lists(extent, min_size=edges, max_size=edges)))
        for name in ("position", "velocity")
    }
    return order, alpha, beta, h, topology, of


def floor_of(order, alpha, beta, h, topology, deviations):
    step = linear_step(KINDS[order](alpha, beta), h)
    A = step.matrix(topology.D)
    radius = np.abs(np.linalg.eigvals(A)).max()
    over = dict.fromkeys(("position", "velocity"), topology)
    Q = received_covariance(step, over, {name: one**2 for name, one in deviations.items()})
    return A, Q, radius


@settings(FUZZ)
@given(noisy())
def test_the_covariance_is_what_solves_the_equation_as_it_stands(case):
    A, Q, radius = floor_of(*case)
    assume(radius < 0.995)
    floor = noise_floor([(A, Q)], case[4].n)
    order = len(A)
    Sigma = np.linalg.solve(np.eye(order**2) - np.kron(A, A), Q.ravel()).reshape(order, order)
    assert floor.covariances[0] == pytest.approx(Sigma, rel=1e-8, abs=1e-10 * np.abs(Sigma).max())
    assert floor.deviation.ravel() ** 2 == pytest.approx(floor.covariances[0].diagonal())


def simulated(order, alpha, beta, h, topology, deviations, ticks, rng):
    """Return errors of estimates of many runs, (2, chains, n): the paper's laws link by link."""
    n = topology.n
    p, v = np.zeros((2, CHAINS, n))
    links = [*zip(topology.source, topology.sink, topology.normalised, strict=True)]
    for _ in range(ticks):
        dp, dv = -p, -v
        for edge, (j, i, weight) in enumerate(links):
            draw = rng.normal(size=(2, CHAINS))
            theirs = (p[:, j - 1], v[:, j - 1]) if j else (0.0, 0.0)
            dp[:, i - 1] += weight * (theirs[0] + deviations["position"][edge] * draw[0])
            dv[:, i - 1] += weight * (theirs[1] + deviations["velocity"][edge] * draw[1])
        if order == 1:
            p, v = p + alpha * dp, v + beta * dv
        else:
            v = v + (alpha * dp + beta * dv)
        p = p + h * v
    return np.stack([p, v])


@settings(FUZZ, max_examples=cases(300, 60))
@given(noisy(), st.integers(0, 2**32))
def test_many_simulated_runs_spread_as_the_covariance_says(case, seed):
    A, Q, radius = floor_of(*case)
    assume(0 < radius < 0.9)
    ticks = min(int(np.ceil(np.log(1e-3) / np.log(radius))) + 2 * len(A), 120)
    assume(np.abs(np.linalg.matrix_power(A, ticks)).max() < 0.05)
    floor = noise_floor([(A, Q)], case[4].n)
    found = (simulated(*case, ticks, np.random.default_rng(seed)) ** 2).mean(axis=1)
    assert (
        np.abs(found - floor.variance) <= (6 * np.sqrt(2 / CHAINS) + 0.003) * floor.variance
    ).all()


@settings(FUZZ, max_examples=cases(100, 30))
@given(noisy(), st.data())
def test_of_digraphs_in_turn_the_covariance_comes_again_after_a_period(case, data):
    order, alpha, beta, h, topology, _ = case
    other = data.draw(digraphs(topology.n, topology.n))
    A, Q, _ = floor_of(*case)
    step = linear_step(KINDS[order](alpha, beta), h)
    B = step.matrix(other.D)
    R = received_covariance(
        step,
        dict.fromkeys(("position", "velocity"), other),
        {"position": np.full(len(other.source), 0.04), "velocity": np.zeros(len(other.source))},
    )
    assume(np.abs(np.linalg.eigvals(B @ A @ A)).max() < 0.99)
    floor = noise_floor([(A, Q), (A, Q), (B, R)], topology.n)
    Sigma = np.zeros_like(A)
    for _ in range(2000):  # as long as it takes, tick by tick
        for one, added in ((A, Q), (A, Q), (B, R)):
            Sigma = one @ Sigma @ one.T + added
    assert floor.covariances[0] == pytest.approx(Sigma, rel=1e-6, abs=1e-9 * np.abs(Sigma).max())
    second = A @ Sigma @ A.T + Q
    third = A @ second @ A.T + Q
    mean = (Sigma + second + third).diagonal() / 3
    assert floor.variance.ravel() == pytest.approx(mean, rel=1e-6, abs=1e-9 * mean.max())


@settings(FUZZ, max_examples=cases(40, 15))
@given(noisy(), st.integers(0, 2**32))
def test_means_of_squares_over_ticks_spread_as_their_standard_error_says(case, seed):
    A, Q, radius = floor_of(*case)
    assume(0 < radius < 0.8)
    floor, n, count = noise_floor([(A, Q)], case[4].n), case[4].n, 50
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(floor.covariances[0] + 1e-14 * np.eye(2 * n))
    x = rng.normal(size=(4000, 2 * n)) @ root.T
    noise = np.linalg.cholesky(Q + 1e-14 * np.eye(2 * n))
    squares = np.zeros_like(x)
    for _ in range(count):
        squares += x**2 / count
        x = x @ A.T + rng.normal(size=x.shape) @ noise.T
    spread = squares.std(axis=0).reshape(2, n)
    expected = floor.standard_error(count, 1)
    seen = floor.deviation > 1e-3
    assert spread[seen] == pytest.approx(expected[seen], rel=0.15)


def test_of_one_robot_it_is_the_variance_of_a_sum_of_powers():
    """dcea1 beside the target: ε̄ ← (1 − α) ε̄ + α n, of variance α² σ²/(1 − (1 − α)²)."""
    topology = Topology.of(np.zeros((1, 1)), np.array([1.0]))
    zero = np.zeros(1)
    A, Q, _ = floor_of(1, 0.5, 1.0, 0.1, topology, {"position": np.full(1, 0.2), "velocity": zero})
    floor = noise_floor([(A, Q)], 1)
    assert floor.variance[:, 0] == pytest.approx([0.25 * 0.04 / 0.75, 0.0], rel=1e-12)


def test_where_errors_do_not_fall_there_is_no_floor():
    A = np.array([[1.1]])
    assert noise_floor([(A, np.eye(1))], 1) is None


@settings(FUZZ, max_examples=cases(300, 40))
@given(noisy(), st.integers(0, 2**32))
def test_no_rounding_takes_errors_further_than_its_bound_and_the_worst_comes_near_it(case, seed):
    order, alpha, beta, h, topology, steps = case
    A, _, radius = floor_of(*case)
    assume(radius < 0.9)
    step = linear_step(KINDS[order](alpha, beta), h)
    bound = rounding_errors(step, A, topology, steps, radius).sampled
    n, rng = topology.n, np.random.default_rng(seed)
    links = [*zip(topology.source, topology.sink, topology.normalised, strict=True)]

    def after(x, off):
        """One period, link by link: off is (2, E, chains) of what is received."""
        p, v = x
        dp, dv = -p, -v
        for edge, (j, i, weight) in enumerate(links):
            theirs = (p[j - 1], v[j - 1]) if j else (0.0, 0.0)
            dp[i - 1] += weight * (theirs[0] + off[0, edge])
            dv[i - 1] += weight * (theirs[1] + off[1, edge])
        p, v = (p + alpha * dp, v + beta * dv) if order == 1 else (p, v + (alpha * dp + beta * dv))
        return p + h * v, v

    half = np.stack([steps["position"], steps["velocity"]])[..., None] / 2
    # What each error of one period comes to later; the worst has the signs of all of these.
    edges = len(links)
    unit = np.zeros((2, edges, 2 * edges))
    unit[np.repeat([0, 1], edges), np.tile(np.arange(edges), 2), np.arange(2 * edges)] = 1
    x, most = after(np.zeros((2, n, 2 * edges)), unit * half), 0.0
    zero = np.zeros((2, edges, 2 * edges))
    for _ in range(400):
        most = most + np.abs(np.array(x)).sum(axis=-1)
        x = after(x, zero)
    assert max(bound.position, 1e-300) == pytest.approx(max(most[0].max(), 1e-300), rel=1e-6)
    assert max(bound.velocity, 1e-300) == pytest.approx(max(most[1].max(), 1e-300), rel=1e-6)
    x = np.zeros((2, n, 50))
    for _ in range(60):
        x = after(x, half * rng.uniform(-1, 1, size=(2, edges, 50)))
        assert np.abs(x[0]).max() <= bound.position * (1 + 1e-9) + 1e-300
        assert np.abs(x[1]).max() <= bound.velocity * (1 + 1e-9) + 1e-300
