"""A large system is solved whether its factors are sparse or dense."""

import numpy as np
import pytest
from scipy import sparse

from estimator_agents.theory.solving import LARGE, solve


@pytest.mark.parametrize("heard", [1, 3])
def test_the_solution_of_a_large_system_is_the_one_it_was_made_from(heard):
    rng, p = np.random.default_rng(1), LARGE
    sink = np.repeat(np.arange(p), heard)
    source = (sink + 1) % p if heard == 1 else rng.integers(p, size=p * heard)
    D = sparse.csr_array((np.full(p * heard, 0.99 / heard), (sink, source)), shape=(p, p))
    A, x = sparse.eye_array(p) - D, rng.uniform(1, 2, p)
    assert np.abs(solve(A, A @ x) - x).max() < 1e-7
