"""What recordings rest on that were made before sin, cos, exp and normal draws were our own.

They were those of NumPy, SciPy and the C library, whose last bits differ with version and
processor. A replay of such a recording computes by them again, as they are here.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_IS_ASKED = ContextVar("former mathematics", default=False)


@contextmanager
def former_mathematics(asked: bool) -> Iterator[None]:
    """Compute by the libraries while this lasts, if `asked`."""
    token = _IS_ASKED.set(asked)
    try:
        yield
    finally:
        _IS_ASKED.reset(token)


def is_former() -> bool:
    """Return whether libraries are to compute what is ours otherwise."""
    return _IS_ASKED.get()


def former_sine_and_cosine(x: Array) -> tuple[Array, Array]:
    """Return sin x and cos x of angles (…), rad."""
    return np.sin(x), np.cos(x)


def former_exponential(x: ArrayLike) -> Array:
    """Return e^x of numbers (…), by the C library."""
    found: Array = np.vectorize(math.exp, otypes=[float])(x)
    return found


def former_normal_quantile(p: Array) -> Array:
    """Return Φ⁻¹ of probabilities (…)."""
    from scipy.special import ndtri  # noqa: PLC0415, few replays need it

    found: Array = ndtri(p)
    return found


def former_normal(rng: np.random.Generator, shape: Sequence[int]) -> Array:
    """Return draws of mean 0 and variance 1, (…)."""
    return rng.standard_normal(shape)


def former_hermite(times: Array, positions: Array, velocities: Array) -> Array:
    """Return the coefficients, (4, s − 1, m), of cubics through what is given at times, (s, m)."""
    from scipy.interpolate import CubicHermiteSpline  # noqa: PLC0415, as above

    found: Array = CubicHermiteSpline(times, positions, velocities).c[::-1]
    return found


def former_spline(times: Array, positions: Array) -> Array:
    """Return the coefficients, (4, s − 1, m), of the spline through positions, (s, m)."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415, as above

    found: Array = CubicSpline(times, positions).c[::-1]
    return found


def former_cubics(times: Array, coefficients: Array, seconds: ArrayLike, order: int) -> Array:
    """Return a derivative of cubics with coefficients (4, s − 1, m) at times (…): (…, m)."""
    from scipy.interpolate import PPoly  # noqa: PLC0415, as above

    found: Array = PPoly(coefficients[::-1], times, extrapolate=False)(seconds, order)
    return found
