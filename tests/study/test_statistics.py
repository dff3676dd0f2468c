"""Shares and errors over seeds have the intervals that SciPy has."""

import numpy as np
import pytest
from scipy.stats import binomtest, bootstrap

from nrs_cosim.orchestrator.study.statistics import median_of, wilson


@pytest.mark.parametrize(("k", "n"), [(0, 5), (5, 5), (1, 1), (3, 20), (19, 20), (500, 1000)])
def test_a_share_has_wilsons_interval(k, n):
    expected = binomtest(k, n).proportion_ci(method="wilson")
    found = wilson(k, n)
    assert found.value == k / n
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_a_share_of_nothing_is_unknown():
    assert wilson(0, 0).value is None
    assert median_of([]).value is None


def test_a_median_has_the_interval_of_the_bootstrap_and_the_same_each_time():
    values = np.random.default_rng(5).lognormal(size=40)
    found = median_of(list(values))
    expected = bootstrap(
        (values,), np.median, n_resamples=20_000, method="percentile", rng=np.random.default_rng(1)
    ).confidence_interval
    assert found.value == np.median(values)
    assert found.low == pytest.approx(expected.low, rel=0.08)
    assert found.high == pytest.approx(expected.high, rel=0.08)
    assert found == median_of(list(values[::-1]))


def test_a_median_of_one_has_no_interval():
    assert (median_of([2.0]).value, median_of([2.0]).low) == (2.0, None)
