"""The theory against the paper's printed numbers and against the eigenvalues of dense matrices."""

import numpy as np
import pytest

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.theory.spectrum import smallest_theta, spectral_radius, spectrum_of
from tests.bus.test_topology import PAPER
from tests.estimator_agents.paper import HARMONIC, first_order, second_order, target

SPECTRUM = spectrum_of(Topology.of(*PAPER))


def test_spectrum_of_the_paper_is_exact():
    s = np.sort(SPECTRUM.real)
    assert SPECTRUM.imag.tolist() == [0] * 6
    assert s[1:5].tolist() == [0, 0, 0, 0]
    np.testing.assert_allclose(s[[0, 5]], [-np.sqrt(0.5), np.sqrt(0.5)], rtol=4e-16)


def test_the_bound_on_the_gains_is_that_of_theorem_1():
    assert smallest_theta(SPECTRUM) == pytest.approx(4 - 2 * np.sqrt(2), rel=1e-15)


def test_a_condition_is_strict():
    condition = Condition("alpha", "", 1.0, 1.0)
    assert not condition.holds
    assert condition.margin == 0


def test_the_bound_on_the_period_is_that_of_theorem_3():
    by_name = {c.name: c for c in SecondOrder(1.1, 0.9).conditions(SPECTRUM, 0.1)}
    assert by_name["sampling_period"].right == pytest.approx(0.493769, abs=5e-7)
    assert by_name["sampling_period"].margin == pytest.approx(0.393769, abs=5e-7)
    assert by_name["beta"].holds


@pytest.mark.parametrize(
    ("alpha", "beta", "radius"),
    [(0.9, 1.1, 0.877817), (1.17, 1.17, 0.997315), (1.18, 1.18, 1.014386)],
)
def test_the_first_order_spectral_radius_agrees_with_dense_matrices(alpha, beta, radius):
    ours = spectral_radius(FirstOrder(alpha, beta).modes(SPECTRUM, 0.1))
    assert ours == pytest.approx(radius, abs=5e-7)


@pytest.mark.parametrize(
    ("h", "radius"), [(0.1, 0.883173), (0.45, 0.947520), (0.4938, 1.000038), (0.5, 1.007636)]
)
def test_the_second_order_spectral_radius_agrees_with_dense_matrices(h, radius):
    ours = spectral_radius(SecondOrder(1.1, 0.9).modes(SPECTRUM, h))
    assert ours == pytest.approx(radius, abs=5e-7)


@pytest.mark.parametrize("seed", range(20))
def test_modes_and_conditions_agree_with_dense_matrices(seed):
    """The condition holds exactly where the matrix of a random digraph is Schur stable."""
    rng = np.random.default_rng(seed)
    n, h = 6, 0.3
    adjacency = rng.uniform(0.2, 1, (n, n)) * (rng.random((n, n)) < 0.4)
    np.fill_diagonal(adjacency, 0)
    pinning = np.where(rng.random(n) < 0.3, 0.7, 0)
    adjacency[1:, 0] += 0.1
    pinning[0] = 1
    topology = Topology.of(adjacency, pinning)
    dense = as_array(topology.D)
    spectrum = spectrum_of(topology)
    for make, matrix in ((FirstOrder, first_order), (SecondOrder, second_order)):
        for alpha, beta in rng.uniform(0.3, 2.4, (10, 2)):
            algorithm = make(alpha, beta)
            ours = algorithm.modes(spectrum, h)
            theirs = np.linalg.eigvals(matrix(alpha, beta, h, dense))
            radius = np.abs(theirs).max()
            assert spectral_radius(ours) == pytest.approx(radius, abs=1e-3)
            if abs(radius - 1) > 1e-3:
                holds = all(c.holds for c in algorithm.conditions(spectrum, h))
                assert holds == (radius < 1)


def test_the_papers_target_agrees_with_its_formula():
    for t in (0.0, 0.1, 7.3, 600.0):
        at = HARMONIC.at(t)
        np.testing.assert_allclose([at.position, at.velocity], target(t), rtol=1e-14, atol=1e-13)
