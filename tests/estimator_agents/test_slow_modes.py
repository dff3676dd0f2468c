"""The worst case at short periods, whose past is long: closed forms, and sums period by period."""

import numpy as np
import pytest

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.impulsive import Impulsive
from nrs_cosim.estimator_agents.theory import estimates, slow_modes
from nrs_cosim.estimator_agents.theory.estimates import worst, worst_case
from nrs_cosim.estimator_agents.theory.recursion import recursion_of
from nrs_cosim.estimator_agents.theory.spectrum import spectral_radius, spectrum_of
from tests.bus.test_topology import PAPER
from tests.estimator_agents.digraphs import ring

ALONE, TOPOLOGY = Topology.of([[0.0]], [1.0]), Topology.of(*PAPER)


def radius_of(algorithm, topology, h):
    return spectral_radius(algorithm.modes(spectrum_of(topology), h))


def summed(recursion, gamma_1, gamma_2, radius):
    """Return the bounds, (2 n,), by both sums over A^j, j by j, 1024 powers at a time."""
    A, h, n = as_array(recursion.matrix), recursion.h, recursion.n
    powers, whole = np.kron(np.eye(2), np.ones((n, 1)))[:, :, None], A
    while powers.shape[2] < 1024:
        powers = np.concatenate([powers, np.tensordot(whole, powers, axes=1)], axis=2)
        whole = whole @ whole
    kink = min(2 * gamma_1 / gamma_2, h)
    slipped = gamma_2 * kink**2 / 2 + 2 * gamma_1 * (h - kink)
    jumped = min(2 * gamma_1, gamma_2 * h)
    a, b = recursion.drag[:, 1]
    bounded = driven = 0.0
    for _ in range(int(34 / (1 - radius) / 1024) + 2):
        p, r = powers[:, 0], powers[:, 1]
        q = r + h * p
        drag = gamma_1 * np.abs(a * p + b * r)
        crossing = (r**2 + q**2) / np.where(r == q, 1, 2 * np.abs(q - r))
        moved = h * np.where(r * q < 0, crossing, np.abs(r + q) / 2)
        bounded = bounded + (np.abs(p) * slipped + np.abs(r) * jumped + drag).sum(axis=1)
        driven = driven + (gamma_2 * moved + drag).sum(axis=1)
        powers = np.tensordot(whole, powers, axes=1)
    return np.minimum(bounded, driven)


@pytest.mark.parametrize("alpha", [0.3, 1.1])
@pytest.mark.parametrize("h", [1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9])
def test_of_a_robot_that_receives_the_target_it_is_the_closed_form(alpha, h):
    """At β = 1, p_j = (1 − α h)^j and r_j = 0 of the position; −α p_{j−1} and 0 of the velocity."""
    algorithm = SecondOrder(alpha, 1.0)
    recursion, rho = recursion_of(algorithm, ALONE, h), radius_of(algorithm, ALONE, h)
    rounding = 1e-15 / (1 - rho)
    for gamma_2 in (1.0, 7.0):
        found = worst_case(recursion, 1e9, gamma_2, rho)
        assert found.position == pytest.approx(gamma_2 * h / (2 * alpha), rel=rounding)
        assert found.velocity == pytest.approx(1.5 * gamma_2 * h, rel=rounding)
    slow = h / 8  # a target that cannot do in a period what its acceleration would let it
    found = worst_case(recursion, slow, 1.0, rho)
    slip = 2 * slow * h - 2 * slow**2
    assert found.position == pytest.approx(slip / (alpha * h), rel=rounding)
    assert found.velocity == pytest.approx(slip / h + 2 * slow, rel=rounding)


@pytest.mark.parametrize(
    ("algorithm", "topology", "h"),
    [
        (SecondOrder(1.1, 0.9), TOPOLOGY, 1e-3),
        (SecondOrder(1.1, 0.9), TOPOLOGY, 1e-4),
        (SecondOrder(1.1, 1.15), TOPOLOGY, 1e-4),
        (Impulsive(1.1, 0.9), TOPOLOGY, 1e-3),
        (SecondOrder(10.0, 2e-3), ALONE, 1e-3),
        (SecondOrder(40.0, 2e-3), TOPOLOGY, 1e-5),
        (SecondOrder(1.1, 0.9), ring(9, True), 2e-4),
    ],
    ids=[
        "dcea2, 1 ms",
        "0.1 ms",
        "opposite signs",
        "impulsive",
        "one, round",
        "six, round",
        "ring",
    ],
)
def test_it_is_what_a_sum_over_each_period_of_the_past_comes_to(algorithm, topology, h):
    """In the third r and r + h p of a robot have opposite signs for ever.

    In the fifth and the sixth all modes are slow, and go round: all signs change again and again.
    """
    recursion, rho = recursion_of(algorithm, topology, h), radius_of(algorithm, topology, h)
    seen = np.eye(2 * recursion.n)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimates, "WORK", 5e3)
        found = worst(recursion, 3.0, 1.0, rho, seen, h)
    np.testing.assert_allclose(found, summed(recursion, 3.0, 1.0, rho), rtol=1e-9)


def test_of_any_digraph_it_is_that_sum_and_never_less(monkeypatch):
    monkeypatch.setattr(estimates, "WORK", 5e3)
    rng, known = np.random.default_rng(1), 0
    for _ in range(30):
        n, h = int(rng.integers(1, 9)), 1e-3
        adjacency = rng.random((n, n)) * (rng.random((n, n)) < 0.4)
        adjacency[np.arange(1, n), np.arange(n - 1)] = 1.0
        np.fill_diagonal(adjacency, 0.0)
        topology = Topology.of(adjacency, np.eye(n)[0])
        algorithm = SecondOrder(*rng.uniform([0.3, 0.3], [3.0, 1.1]).tolist())
        recursion, rho = recursion_of(algorithm, topology, h), radius_of(algorithm, topology, h)
        gamma_1 = float(rng.choice([3.0, h / 6]))
        found = worst(recursion, gamma_1, 1.0, rho, np.eye(2 * n), h)
        if found is None:
            continue
        known += 1
        expected = summed(recursion, gamma_1, 1.0, rho)
        largest = expected.reshape(2, -1).max(axis=1).repeat(n)
        assert (found >= expected - 1e-10 * largest).all()
        assert (found <= expected + 1e-7 * largest).all()
    assert known >= 28


def test_with_h_it_comes_to_a_multiple_of_h():
    """As the docs' table has it: dcea2 at 0.01 s is 0.0414 and 0.0968."""
    algorithm = SecondOrder(1.1, 0.9)
    found = []
    for h in (1e-2, 1e-4, 1e-6, 1e-8):
        rho = radius_of(algorithm, TOPOLOGY, h)
        bound = worst_case(recursion_of(algorithm, TOPOLOGY, h), 3.0, 1.0, rho)
        found.append((bound.position / h, bound.velocity / h))
    assert found[0] == pytest.approx((4.14, 9.68), rel=1e-2)
    assert found[1] == pytest.approx(found[2], rel=5e-3)
    assert found[2] == pytest.approx(found[3], rel=1e-4)


@pytest.mark.parametrize(
    ("algorithm", "h"),
    [(FirstOrder(2 - 1e-6, 0.9), 0.1), (SecondOrder(1.1, 2 - 1e-6), 1e-7)],
    ids=["alternating", "slow and alternating"],
)
def test_of_modes_near_minus_1_nothing_is_known(algorithm, h):
    recursion, rho = recursion_of(algorithm, ALONE, h), radius_of(algorithm, ALONE, h)
    assert rho < 1
    assert worst_case(recursion, 3.0, 1.0, rho) is None


def test_where_signs_change_too_often_nothing_is_known(monkeypatch):
    algorithm, h = SecondOrder(40.0, 2e-3), 1e-5
    recursion, rho = recursion_of(algorithm, TOPOLOGY, h), radius_of(algorithm, TOPOLOGY, h)
    monkeypatch.setattr(estimates, "WORK", 5e3)
    monkeypatch.setattr(slow_modes, "MOST", 100)
    assert worst_case(recursion, 3.0, 1.0, rho) is None
