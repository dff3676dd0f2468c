"""The terms of the bounds on estimates, each by hand: drag, slip, integrals, and their sums."""

from dataclasses import replace

import numpy as np
import pytest

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.impulsive import Impulsive
from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.theory.estimates import (
    EstimateBounds,
    always,
    largest,
    paper_bound,
    slip,
    steady_motion,
    worst,
    worst_case,
)
from nrs_cosim.estimator_agents.theory.recursion import recursion_of
from nrs_cosim.estimator_agents.theory.slow_modes import modulus
from nrs_cosim.estimator_agents.theory.spectrum import spectral_radius, spectrum_of
from tests.bus.test_topology import PAPER

TOPOLOGY = Topology.of(*PAPER)


def radius_of(algorithm, topology, h):
    return spectral_radius(algorithm.modes(spectrum_of(topology), h))


# The drag of an algorithm whose estimates do not stay where all agree


@pytest.mark.parametrize("beta", [0.4, 0.9, 1.3])
def test_a_target_of_constant_velocity_alone_drags_by_its_steady_motion(beta):
    """x = A x + (1 ⊗ d) υ_0 with d = −β [h; 1], dense, and |υ_0| = γ1: no other has γ2 = 0."""
    algorithm, h, gamma_1 = Impulsive(0.6, beta), 0.1, 3.0
    recursion = recursion_of(algorithm, TOPOLOGY, h)
    np.testing.assert_allclose(recursion.drag, [[0, -beta * h], [0, -beta]])
    rho = radius_of(algorithm, TOPOLOGY, h)
    A = as_array(recursion.matrix)
    alone = np.linalg.solve(np.eye(12) - A, np.kron([beta * h, beta], np.ones(6))) * gamma_1
    bound = worst_case(recursion, gamma_1, 0.0, rho)
    assert bound.position == pytest.approx(np.abs(alone[:6]).max(), rel=1e-9)
    assert bound.velocity == pytest.approx(np.abs(alone[6:]).max(), abs=1e-9)
    none = np.zeros((1, 1))
    motion = steady_motion(
        recursion, Harmonic(np.zeros(1), np.array([-gamma_1]), none, none, none), rho
    )
    np.testing.assert_allclose(motion.constant[..., 0].ravel(), alone, atol=1e-9)


def test_the_drag_adds_to_each_bound_of_the_paper():
    """|Δ_1| / h gains β γ1 and |Δ_2| / h gains β γ1 / h (docs/theory.md)."""
    beta, h = 0.9, 0.1
    recursion = recursion_of(Impulsive(0.6, beta), TOPOLOGY, h)
    for gamma_1, gamma_2 in ((3.0, 1.0), (0.1, 40.0)):
        found = paper_bound(recursion, gamma_1, gamma_2)
        most = max((2 + beta) * gamma_1, gamma_2 + beta * gamma_1 / h)
        assert found.kappa == pytest.approx(found.norm.gain * most)


def test_after_a_jump_the_drag_adds_to_the_bound():
    """ε⁺ = ε + 0.2 υ and υ⁺ = 0.1 υ where all agree: |K − I| of [0; γ1] is 0.2 γ1 and 0.9 γ1."""
    recursion = replace(
        recursion_of(Impulsive(0.6, 0.9), TOPOLOGY, 0.1), keep=np.array([[1, 0.2], [0, 0.1]])
    )
    found = always(EstimateBounds(1.0, 1.0), EstimateBounds(0.9, 0.5), recursion, 3.0)
    assert (found.position, found.velocity) == pytest.approx((0.9 + 0.6, 0.5 + 2.7))
    found = always(EstimateBounds(7.0, 8.0), EstimateBounds(0.9, 0.5), recursion, 3.0)
    assert (found.position, found.velocity) == (7.0, 8.0)


@pytest.mark.parametrize(("h", "gamma_1", "gamma_2"), [(0.1, 3.0, 1.0), (1.0, 0.2, 5.0)])
def test_the_targets_motion_in_a_period_is_an_integral(h, gamma_1, gamma_2):
    w = (np.arange(100_000) + 0.5) * h / 100_000
    expected = np.minimum(2 * gamma_1, gamma_2 * w).mean() * h
    assert slip(h, gamma_1, gamma_2) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("first", "last"), [(1.0, 3.0), (-1.0, 3.0), (2.0, -0.5), (0.0, 0.0)])
def test_the_integral_of_the_size_of_a_line_is_the_area_of_its_triangles(first, last):
    t = (np.arange(100_000) + 0.5) / 100_000
    expected = np.abs(first + (last - first) * t).mean() * 0.3
    found = modulus(np.array([first]), np.array([last]), 0.3)
    assert found == pytest.approx([expected], rel=1e-6)


def test_the_largest_of_bounds_is_that_of_positions_and_of_velocities():
    assert largest(np.array([1.0, 5.0, 2.0, 4.0, 9.0, 3.0])) == EstimateBounds(5.0, 9.0)


@pytest.mark.parametrize(("h", "gamma_1", "gamma_2"), [(0.1, 1e6, 1.0), (1.0, 0.2, 5.0)])
def test_without_cancellation_a_bound_is_the_sum_of_largest_steps(h, gamma_1, gamma_2):
    """Δ_1 is at most what a target slips by, Δ_2 what its velocity may change by in h."""
    algorithm = FirstOrder(0.9, 0.8)
    recursion = recursion_of(algorithm, TOPOLOGY, h)
    A = as_array(recursion.matrix)
    assert A.min() >= 0
    step = np.kron([slip(h, gamma_1, gamma_2), min(2 * gamma_1, h * gamma_2)], np.ones(6))
    expected = np.linalg.solve(np.eye(12) - A, step)
    rho = radius_of(algorithm, TOPOLOGY, h)
    most = worst(recursion, gamma_1, gamma_2, rho, np.eye(12), h)
    np.testing.assert_allclose(most, expected, rtol=1e-9)
    found = worst_case(recursion, gamma_1, gamma_2, rho)
    if gamma_1 > 1e5:
        assert found.position == pytest.approx(expected[:6].max(), rel=1e-9)
        assert found.velocity == pytest.approx(expected[6:].max(), rel=1e-9)
    else:
        assert found.position < 0.9 * expected[:6].max()
        assert found.velocity < 0.9 * expected[6:].max()
