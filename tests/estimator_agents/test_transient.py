"""How long the beginning lasts: beside powers one by one, and a closed form on a path."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.stats import binom

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.theory.recursion import recursion_of
from nrs_cosim.estimator_agents.theory.spectrum import spectral_radius, spectrum_of
from nrs_cosim.estimator_agents.theory.transient import ticks_until
from tests.estimator_agents.digraphs import digraphs

MILLIONTH = 1e-6


def path(n):
    return Topology.of_edges(n, np.arange(n), np.arange(1, n + 1), np.ones(n))


def fallen_on_a_path(n, alpha, h):
    """Return the first k with (1 + k h) P(X < n) <= 1e-6, X of k draws with probability α.

    Λ^k = [[P^k, k h P^k], [0, P^k]] where both gains are α, and the last row of P^k adds up to the
    probability that in k ticks the news has gone on less than n times.
    """
    k = np.arange(1, 20 * n)
    return int(k[(1 + k * h) * binom.cdf(n - 1, k, alpha) <= MILLIONTH][0])


@pytest.mark.parametrize(("n", "alpha"), [(1, 0.9), (40, 0.9), (40, 0.3), (1000, 0.9), (600, 0.5)])
def test_on_a_path_errors_fall_after_the_hops(n, alpha):
    found = ticks_until(recursion_of(FirstOrder(alpha, alpha), path(n), 0.1).matrix, MILLIONTH)
    assert found == fallen_on_a_path(n, alpha, 0.1)


@pytest.mark.parametrize("n", [1, 8, 300])
def test_gains_of_1_leave_no_error_after_the_hops(n):
    assert ticks_until(recursion_of(FirstOrder(1, 1), path(n), 0.1).matrix, MILLIONTH) == n


@settings(max_examples=40, deadline=None, derandomize=True, database=None)
@given(digraphs(), st.sampled_from([FirstOrder, SecondOrder]), st.floats(0.2, 1.5))
def test_the_settling_time_is_where_the_norm_of_a_power_falls_to_the_share(topology, of, beta):
    algorithm, h = of(0.8, beta), 0.2
    assume(spectral_radius(algorithm.modes(spectrum_of(topology), h)) < 0.97)
    recursion = recursion_of(algorithm, topology, h)
    k = ticks_until(recursion.matrix, MILLIONTH)
    A = as_array(recursion.matrix)
    sizes = [np.linalg.norm(np.linalg.matrix_power(A, j), np.inf) for j in (k - 1, k)]
    assert sizes[1] <= MILLIONTH * (1 + 1e-9)
    assert sizes[0] > MILLIONTH * (1 - 1e-9)


def test_for_many_robots_with_gains_above_1_the_settling_time_is_unknown():
    assert ticks_until(recursion_of(FirstOrder(1.1, 0.9), path(400), 0.1).matrix, MILLIONTH) is None
