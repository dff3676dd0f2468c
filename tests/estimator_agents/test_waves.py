"""The supremum of a sum of sines: never below what any time shows, and no more than is reached."""

from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.waves import supremum


def sines(*terms, rate=0.0) -> Harmonic:
    """Return a target on one axis of (amplitude, frequency, phase)."""
    waves = np.array(terms, float).T[:, None, :]
    return Harmonic(np.zeros(1), np.array([rate]), *waves)


QUARTER = np.pi / 2


@pytest.mark.parametrize(
    ("terms", "rate", "gamma_1", "gamma_2"),
    [
        ([(1, 1, 0), (1, 1, QUARTER)], 0, sqrt(2), sqrt(2)),
        ([(1, 1, 0), (1, -1, QUARTER)], 0, sqrt(2), sqrt(2)),
        # υ = cos t + 2 cos 2t; a = −sin t − 4 sin 2t, greatest where cos t + 8 cos 2t = 0
        (
            [(1, 1, 0), (1, 2, 0)],
            0,
            3,
            max(
                abs(sqrt(1 - c * c) * (1 + 8 * c))
                for c in ((-1 + sqrt(513)) / 32, (-1 - sqrt(513)) / 32)
            ),
        ),
        # υ = 1/2 + cos t − cos 2t = 3/2 + c − 2 c², c = cos t: 13/8 at c = 1/4, −3/2 at c = −1
        ([(1, 1, 0), (-0.5, 2, 0)], 0.5, 13 / 8, None),
        # the same with a rate on the other side: |−1/2 + c + 1 − 2 c²| is 5/2 at c = −1
        ([(1, 1, 0), (-0.5, 2, 0)], -0.5, 5 / 2, None),
        # 0.3 is three times 0.1: 10 υ = cos τ − cos 3τ = 4 c (1 − c²), at most 8/(3 √3)
        ([(1, 0.1, 0), (-1 / 3, 0.3, 0)], 0, 0.8 / (3 * sqrt(3)), None),
        ([(1, 1, 0.3), (2, sqrt(2), 0.1)], 3, 4 + 2 * sqrt(2), 5),
    ],
)
def test_bounds_of_sines_in_closed_form(terms, rate, gamma_1, gamma_2):
    bounds = sines(*terms, rate=rate).bounds()
    assert bounds[0] == pytest.approx(gamma_1, rel=1e-11)
    if gamma_2 is not None:
        assert bounds[1] == pytest.approx(gamma_2, rel=1e-11)


def test_opposite_sines_have_bounds_of_0():
    assert sines((1, 1, 0), (-1, 1, 0)).bounds() == (0, 0)
    assert sines((1, 2, 0.4), (1, 2, 0.4 + np.pi)).bounds() == pytest.approx((0, 0), abs=1e-14)


multiple = st.integers(1, 30)
amplitude = st.floats(-3, 3).filter(lambda a: a == 0 or abs(a) > 1e-3)
term = st.tuples(amplitude, multiple, st.floats(-4, 4))


@settings(max_examples=60, deadline=None)
@given(st.lists(term, min_size=1, max_size=6), st.floats(-2, 2), st.sampled_from([1, 0.1, 2 / 7]))
def test_bounds_of_commensurate_waves_are_reached_and_not_exceeded(terms, rate, base):
    moving = sines(*((a, n * base, phase) for a, n, phase in terms), rate=rate)
    t = np.linspace(0, 2 * np.pi / base, 20_001)
    speed = moving.rate + (
        moving.amplitude * moving.frequency * np.cos(moving.frequency * t[:, None] + moving.phase)
    ).sum(axis=1)
    gamma_1, gamma_2 = moving.bounds()
    size = abs(rate) + sum(abs(a) * n * base for a, n, _ in terms)
    reached = np.abs(speed).max()
    assert reached <= gamma_1 + 1e-12 * size
    jerk = sum(abs(a) * (n * base) ** 3 for a, n, _ in terms)
    assert gamma_1 <= reached + jerk * t[1] ** 2 / 8 + 1e-11 * size
    slope = np.abs(np.diff(speed)) / t[1]
    assert slope.max() <= gamma_2 + 1e-9 * max(size, 1) / t[1] * 1e-3 + 1e-12


def test_incommensurate_waves_have_the_sum_of_amplitudes_as_bound():
    omega = np.array([1.0, sqrt(2), sqrt(3)])
    assert supremum(-1.0, omega, np.array([1, 2j, -3 + 0j])) == pytest.approx(7)
    t = np.arange(0, 20_000, 0.05)
    reached = np.abs(-1 + np.exp(1j * np.outer(t, omega)) @ np.array([1, 2j, -3])).max()
    assert reached > 6.9


@pytest.mark.parametrize("extreme", [5e-324, 1e-300, 1e155, 1e300, 1e308])
def test_extreme_waves_have_a_finite_or_infinite_bound(extreme):
    for terms in ([(1, extreme, 0), (1, 1, 0)], [(extreme, 1, 0), (extreme, 2, 0)]):
        for bound, least in zip(sines(*terms).bounds(), (1, 0), strict=True):
            assert bound >= least * min(extreme, 1)
