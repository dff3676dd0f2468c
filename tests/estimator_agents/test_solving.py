"""A large system is solved whether its factors are sparse or dense."""

import numpy as np
import pytest
from scipy import sparse

from nrs_cosim.estimator_agents.theory.solving import LARGE, solve


@pytest.mark.parametrize("received", [1, 3])
def test_a_large_system_is_solved_correctly(received):
    rng, p = np.random.default_rng(1), LARGE
    sink = np.repeat(np.arange(p), received)
    source = (sink + 1) % p if received == 1 else rng.integers(p, size=p * received)
    D = sparse.csr_array((np.full(p * received, 0.99 / received), (sink, source)), shape=(p, p))
    A, x = sparse.eye_array(p) - D, rng.uniform(1, 2, p)
    assert np.abs(solve(A, A @ x) - x).max() < 1e-7


def test_blocks_are_solved_sparse_or_dense_as_each_allows():
    """A cycle, which GMRES does not come round, beside a digraph whose factors are dense."""
    rng, p = np.random.default_rng(2), LARGE
    robot = np.arange(p)
    cycle = sparse.csr_array((np.full(p, 0.999), (robot, (robot + 1) % p)), shape=(p, p))
    sink, source = np.repeat(robot, 3), rng.integers(p, size=3 * p)
    random = sparse.csr_array((np.full(3 * p, 0.33), (sink, source)), shape=(p, p))
    one = sparse.eye_array(p)
    A = sparse.block_array([[one - random, cycle], [None, one - cycle]])
    x = rng.uniform(1, 2, 2 * p)
    assert np.abs(solve(A, A @ x) - x).max() < 1e-7
