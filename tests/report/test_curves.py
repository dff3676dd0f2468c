"""Of a curve the extremes are drawn; labels stand by their lines, apart from one another."""

import numpy as np
import pytest

from nrs_cosim.recordings.report.curves import BUCKETS, kept, spread


@pytest.mark.parametrize("rows", [1, 2 * BUCKETS, 2 * BUCKETS + 1, 10_007])
def test_downsampling_keeps_extremes_ends_and_gaps(rows):
    y = np.random.default_rng(rows).normal(size=rows)
    y[rows // 2] = np.nan
    points = kept(y)
    assert (np.diff(points) > 0).all()
    assert len(points) <= max(rows, 3 * BUCKETS + 2)
    assert {0, rows - 1, rows // 2} <= {*points.tolist()}
    if rows > 1:
        assert np.nanmax(y[points]) == np.nanmax(y)
        assert np.nanmin(y[points]) == np.nanmin(y)


def test_the_end_of_a_curve_is_drawn_more_finely_on_demand():
    y = np.sin(np.arange(100_000.0))
    points = kept(y, last=1500)
    assert {*range(98_500, 100_000)} <= {*points.tolist()}
    assert {*kept(y).tolist()} <= {*points.tolist()}


@pytest.mark.parametrize("seed", range(5))
def test_labels_are_as_near_their_lines_as_they_can_be_apart(seed):
    chance = np.random.default_rng(seed)
    places, gap = chance.uniform(0, 1, 4).round(2), 0.15
    found = spread(places, gap)
    assert (np.diff(np.sort(found)) >= gap - 1e-12).all()
    assert 0 <= found.min() <= found.max() <= 1
    tried = np.sort(chance.uniform(0, 1, (20_000, 4)), axis=1)
    tried = tried[(np.diff(tried, axis=1) >= gap).all(axis=1)]
    best = ((tried - np.sort(places)) ** 2).sum(axis=1).min()
    assert ((np.sort(found) - np.sort(places)) ** 2).sum() <= best + 1e-9
