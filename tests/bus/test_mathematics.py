"""Our sin, cos, exp, log and inverse of Φ against integers and decimals of any length."""

import ast
from decimal import Context, Decimal
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtri

from nrs_cosim.bus.mathematics import (
    cosine,
    exponential,
    logarithm,
    normal_quantile,
    sine,
    sine_and_cosine,
)
from tests.cases import cases

COUNT = cases(1_000_000, 3_000)
LONG, SHORT = 1400, 256
EXACTLY = Context(prec=40, Emin=-9999, Emax=9999)


def arctangent(of):
    """Return 2^LONG arctan(1/of)."""
    power, n, total = (1 << LONG + 64) // of, 1, 0
    while power:
        total += power // n if n % 4 == 1 else -(power // n)
        power, n = power // of**2, n + 2
    return total >> 64


TURN = 8 * (4 * arctangent(5) - arctangent(239))
"""2^LONG 2π, by Machin."""


def exact(x):
    """Return sin x and cos x, by Taylor once whole turns are taken away."""
    numerator, denominator = x.as_integer_ratio()
    angle = (numerator << LONG) // denominator % TURN >> LONG - SHORT
    term, sums, n = 1 << SHORT, [0, 0, 0, 0], 0
    while term:
        sums[n % 4] += term
        n += 1
        term = (term * angle >> SHORT) // n
    both = sums[1] - sums[3], sums[0] - sums[2]
    return [EXACTLY.divide(Decimal(of), Decimal(1 << SHORT)) for of in both]


def apart(found, wanted):
    """Return how many units in the last place `found` is off at most."""
    units = np.spacing(np.abs(found)).tolist()
    return max(
        abs(Decimal(y) - want) / Decimal(unit)
        for y, want, unit in zip(found.tolist(), wanted, units, strict=True)
    )


def random():
    return np.random.Generator(np.random.Philox(8))


def any_size(low, high):
    """Return numbers of all exponents of 2 between two, of both signs."""
    rng = random()
    return rng.choice([-1.0, 1.0], COUNT) * np.ldexp(
        rng.uniform(1, 2, COUNT), rng.integers(low, high, COUNT)
    )


@pytest.mark.parametrize(
    "numbers",
    [
        random().uniform(-7, 7, COUNT),
        any_size(-60, 15),
        any_size(10, 1024),
        np.nextafter(np.arange(1, COUNT) * (np.pi / 2), 0),
        np.array([np.ldexp(6381956970095103.0, 797), np.nextafter(32768.0, 0), 32768.0]),
    ],
    ids=["an angle", "moderate", "large", "near zeros", "hardest"],
)
def test_sine_and_cosine_are_off_by_less_than_a_unit_in_the_last_place(numbers):
    wanted = zip(*map(exact, numbers.tolist()), strict=True)
    for found, want in zip(sine_and_cosine(numbers), wanted, strict=True):
        assert apart(found, want) < 0.9


def test_sines_of_zeros_the_tiny_and_what_is_not_finite_are_what_they_should_be():
    few = [0.0, -0.0, 5e-324, -1e-300, inf, -inf, nan]
    for given in (few, few * 10):  # arrays of few take another way
        x = np.array(given)
        tiny = np.isfinite(x)
        assert sine(x)[tiny].tobytes() == x[tiny].tobytes()
        assert (cosine(x)[tiny] == 1).all()
        assert np.isnan([sine(x)[~tiny], cosine(x)[~tiny]]).all()


def test_numbers_by_themselves_and_in_arrays_of_any_shape_have_the_same_bits():
    x = np.concatenate([any_size(-20, 40), [np.pi, -32768.0]])[:3000]
    together = np.array(sine_and_cosine(x.reshape(-1, 2, 5)))
    assert together.shape == (2, 300, 2, 5)
    alone = np.array([sine_and_cosine(one) for one in x]).T
    assert together.reshape(2, -1).tobytes() == alone.tobytes()


def test_exponential_and_logarithm_are_off_by_less_than_a_unit_in_the_last_place():
    for x in (random().uniform(-1, 1, COUNT), random().uniform(-700, 700, COUNT)):
        assert apart(exponential(x), [Decimal(y).exp(EXACTLY) for y in x.tolist()]) < 0.9
    for x in (random().uniform(0.5, 2, COUNT), abs(any_size(-1022, 1023))):
        assert apart(logarithm(x), [Decimal(y).ln(EXACTLY) for y in x.tolist()]) < 0.9
    assert exponential([0.0, -0.0, inf, -inf, 710.0]).tolist() == [1.0, 1.0, inf, 0.0, inf]
    assert np.isnan(exponential(nan))


def test_the_inverse_of_the_normal_distribution_agrees_with_scipys():
    p = np.concatenate([random().uniform(0, 1, COUNT), 2.0 ** -np.arange(1, 1000)])
    np.testing.assert_allclose(normal_quantile(p), ndtri(p), rtol=4e-15)
    np.testing.assert_allclose(normal_quantile(1 - p[p > 1e-9]), ndtri(1 - p[p > 1e-9]), rtol=4e-15)


ROOT = Path(__file__).parents[2]
RECORDED = [
    *ROOT.glob("bus/**/*.py"),
    *ROOT.glob("estimator_agents/*.py"),
    *ROOT.glob("orchestrator/engine/**/*.py"),
    *ROOT.glob("orchestrator/scenario/**/*.py"),
    *ROOT.glob("plant_fmu/*.py"),
    *ROOT.glob("plant_fmu/drives/*.py"),
]
"""All of what is on the way to a recorded number."""
ROUNDED_DIFFERENTLY = {
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "asin", "acos", "atan"),
    *("sinh", "cosh", "tanh", "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "cbrt"),
    *("hypot", "power", "pow", "float_power", "angle", "atan2", "erf", "gamma", "lgamma", "fma"),
    *("normal", "standard_normal", "exponential", "standard_exponential", "standard_gamma"),
    *("lognormal", "poisson", "geometric", "multivariate_normal", "logistic", "gumbel", "beta"),
}
ELSEWHERE = {
    *(("target.py", "phasors"), ("waves.py", "_highest"), ("waves.py", "at")),
    ("flow.py", "_flows"),
    *(("former_mathematics.py", name) for name in ("former_sine_and_cosine", "former_normal")),
}
"""Bounds, numbers on which an algorithm's flow is tried, and replays of recordings of before."""


def test_nothing_recorded_rests_on_a_function_that_libraries_round_differently():
    found = set()
    for path in RECORDED:
        for function in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(function, ast.FunctionDef):
                found |= {
                    (path.name, function.name)
                    for call in ast.walk(function)
                    if isinstance(call, ast.Call)
                    and isinstance(call.func, ast.Attribute)
                    and call.func.attr in ROUNDED_DIFFERENTLY
                    and getattr(call.func.value, "id", "") in {"np", "math", "rng", "scipy"}
                }
    assert found == ELSEWHERE
