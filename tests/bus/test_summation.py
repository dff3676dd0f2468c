"""Sums are in the order that the module says, which is written out here once more, plainly."""

import numpy as np
import pytest

from nrs_cosim.bus.summation import Summation, summed

RNG = np.random.default_rng(17)


def pairwise(x):
    if len(x) > 128:
        half = len(x) // 2 // 8 * 8
        return pairwise(x[:half]) + pairwise(x[half:])
    whole = len(x) // 8 * 8
    if not whole:
        total, rest = x[0], x[1:]
    else:
        r = x[:8]
        for at in range(8, whole, 8):
            r = [a + b for a, b in zip(r, x[at : at + 8], strict=True)]
        total = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]))
        rest = x[whole:]
    for one in rest:
        total += one
    return total


def stretch(x):
    if not x:
        return 0.0
    return x[0] + pairwise(x[1:]) if x[1:] else x[0]


def numbers(*shape):
    return RNG.normal(size=shape) * 10.0 ** RNG.integers(-9, 9, shape)


@pytest.mark.parametrize("most", [3, 12, 40, 150, 700])
def test_stretches_are_added_in_the_order_that_is_said(most):
    for _ in range(6):
        counts = RNG.integers(0, most + 1, 7)
        counts[RNG.integers(7)] = most
        x = numbers(counts.sum(), 2)
        start = np.cumsum(counts) - counts
        sums = Summation(start, len(x))(x)
        for row, (first, count) in enumerate(zip(start, counts, strict=True)):
            columns = x[first : first + count].T.tolist()
            assert sums[row].tolist() == [stretch(column) for column in columns]


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 16, 17, 128, 129, 300, 1000])
def test_the_last_axis_is_added_in_the_order_that_is_said(count):
    x = numbers(2, 3, count)
    assert summed(x).tolist() == [[pairwise(row) for row in rows] for rows in x.tolist()]


def test_a_sum_of_one_is_that_and_of_none_is_zero():
    x = np.array([[-0.0, np.inf, np.nan]])
    assert Summation(np.array([0]), 1)(x).tobytes() == x.tobytes()
    assert summed(x.T).tobytes() == x.tobytes()
    assert summed(np.zeros((2, 0))).tolist() == [0.0, 0.0]
    assert Summation(np.array([0, 0]), 0)(np.zeros((0, 3))).tolist() == [[0.0] * 3] * 2
