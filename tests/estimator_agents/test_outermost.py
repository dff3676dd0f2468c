"""Eigenvalues of large components of which not all are found, against dense matrices."""

import numpy as np
import pytest

from nrs_cosim.bus import matrices
from nrs_cosim.bus.matrices import as_array
from nrs_cosim.bus.topologies import InteractionGraphs
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.theory import outermost, spectrum
from nrs_cosim.estimator_agents.theory.aperiodic import Periods
from nrs_cosim.estimator_agents.theory.delays import common_radius, delay_margin
from nrs_cosim.estimator_agents.theory.linear_step import linear_step
from nrs_cosim.estimator_agents.theory.outermost import (
    PartialSpectrum,
    bounds_by,
    known_of,
    within_of,
)
from nrs_cosim.estimator_agents.theory.recursion import recursion_of
from nrs_cosim.estimator_agents.theory.spectrum import smallest_theta, spectrum_of
from nrs_cosim.orchestrator.analysis.convergence import conditions_for, merged, rho_alone
from tests.cases import cases

H, NEAR = 0.1, 1e-7
LAWS = FirstOrder(0.9, 0.8), FirstOrder(1.3, 1.2), SecondOrder(0.9, 0.8), SecondOrder(6.0, 1.1)


def random_digraph(seed):
    """Return one of a large component and others, with few links or many, and weights."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(20, 70))
    adjacency = (rng.random((n, n)) < rng.choice([2 / n, 0.1, 0.5])) * rng.random((n, n)) ** 2
    np.fill_diagonal(adjacency, 0)
    ring = np.arange(int(rng.integers(15, n + 1)))
    adjacency[ring, np.roll(ring, 1)] = rng.choice([0.1, 1.0, 3.0])
    pinned = np.flatnonzero(rng.random(n) < 0.1)
    pinning = np.isin(np.arange(n), [0, *pinned]) * rng.uniform(0.01, 1, n)
    return Topology.of(adjacency, np.where(adjacency.any(axis=1), pinning, 1.0))


@pytest.mark.parametrize("restarts", [200, 0])
def test_what_is_said_of_200_random_digraphs_holds_of_their_dense_matrices(monkeypatch, restarts):
    """Also where Arnoldi's method has no time: what is found are bounds then."""
    monkeypatch.setattr(matrices, "FEW", 10)
    monkeypatch.setattr(spectrum, "DENSE", 10)
    monkeypatch.setattr(outermost, "RESTARTS", restarts)
    exact = partial = 0
    for seed in range(cases(200, 8)):
        topology = random_digraph(seed)
        dense = np.linalg.eigvals(as_array(topology.D))
        found = spectrum_of(topology)
        known, within = known_of(found), within_of(found)
        if within is None:
            continue
        partial += 1
        assert np.abs(known[:, None] - dense).min(axis=1).max(initial=0) < NEAR
        unknown = dense[np.abs(dense[:, None] - known).min(axis=1, initial=2) > NEAR]
        assert np.abs(unknown).max(initial=0) <= within + NEAR
        assert smallest_theta(found) <= smallest_theta(dense) + NEAR
        for law in LAWS:
            A = as_array(recursion_of(law, InteractionGraphs.of(topology), H).matrix)
            radius = np.abs(np.linalg.eigvals(A)).max()
            rho = rho_alone(law, (found,), Periods((H,)))
            assert rho.lower - NEAR <= radius <= rho.upper + NEAR
            exact += rho.radius == pytest.approx(radius, abs=NEAR)
            for condition, true in zip(
                conditions_for(law, (found,), H), law.conditions(dense, H), strict=True
            ):
                assert np.isnan(condition.bound) or condition.holds == true.holds
    assert partial
    assert exact > partial


def test_what_the_circle_does_not_decide_is_unknown_and_what_an_eigenvalue_violates_is_violated():
    law, periods = SecondOrder(6.0, 0.8), Periods((H,))
    wide, narrow = PartialSpectrum.of(np.array([0.9 + 0j]), 0.99), 0.3
    assert rho_alone(law, (wide,), periods).status == "not decided"
    beta, period = conditions_for(law, (wide,), H)
    assert beta.holds
    assert np.isnan(period.bound)
    small = PartialSpectrum.of(np.array([0.9 + 0j]), narrow)
    exact = rho_alone(law, (known_of(small),), periods)
    assert rho_alone(law, (small,), periods) == exact
    (both,) = merged([(wide,), (small,), (np.array([0.2 + 0j]),)])
    assert known_of(both).tolist() == [0.9, 0.9, 0.2]
    assert within_of(both) == 0.99
    wrong = PartialSpectrum.of(np.array([-0.9 + 0j]), 0.95)
    assert rho_alone(FirstOrder(1.9, 0.5), (wrong,), periods).status == "refuted"
    alpha = conditions_for(FirstOrder(1.9, 0.5), (wrong,), H)[0]
    assert not alpha.holds
    assert alpha.bound == pytest.approx(2 / 1.9)


def test_a_delay_is_at_least_what_the_circle_allows_and_radii_are_within_bounds():
    step = linear_step(SecondOrder(0.9, 0.9), H)
    assert step is not None
    dense = np.array([0.97, -0.2 + 0.5j, -0.2 - 0.5j])
    partial = PartialSpectrum.of(dense[:1], 0.6)
    assert delay_margin(step, dense).kind == "exact"
    assert delay_margin(step, partial).kind == "at least"
    assert delay_margin(step, partial).periods <= delay_margin(step, dense).periods
    low, high = bounds_by(lambda of: common_radius(step, of, 5), partial)
    assert low <= common_radius(step, dense, 5) <= high
