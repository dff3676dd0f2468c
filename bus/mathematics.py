"""sin, cos, exp, log and the inverse of Φ, of + − × ÷ and √ alone, the same bits everywhere.

What a digest rests on asks no library for them: their versions and processors differ in the last
bit. sin and cos are operation for operation those of the models' mathematics.c, which says how;
all but the inverse of Φ are off by less than one unit in the last place.

    exp x = 2^k e^r,  x = k ln 2 + r,  |r| ≤ ln 2 / 2,  e^r by Taylor
    log x = k ln 2 + log(1 + f),  x = 2^k (1 + f),  √½ ≤ 1 + f < √2,
    log(1 + f) = 2 s + 2 s³/3 + 2 s⁵/5 + …,  s = f/(2 + f)
"""

from math import factorial, frexp, isfinite, nan
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nrs_cosim.bus import former_mathematics

Array = NDArray[np.float64]
Number = TypeVar("Number", float, Array)

_FEW = 16
MODERATE = 2.0**15
ROUND = 1.5 * 2.0**52
"""Added and taken away again, it rounds."""
TWO_OVER_PI = float.fromhex("0x1.45f306dc9c883p-1")
P1, P2, P3 = map(float.fromhex, ("0x1.921fb5444p+0", "0x1.68c234c4cp-39", "0x1.98a2e03707345p-77"))
"""π/2 in parts, the first two of 38 bits."""
HALF_PI, HALF_PI_REST = map(float.fromhex, ("0x1.921fb54442d18p+0", "0x1.1a62633145c07p-54"))
DIGITS = int(
    "a2f9836e4e441529fc2757d1f534ddc0db6295993c439041fe5163abdebbc561b7246e3a424dd2e006492eea"
    "09d1921cfe1deb1cb129a73ee88235f52ebb4484e99c7026b45f7e413991d639835339f49c845f8bbdf9283b"
    "1ff897ffde05980fef2f118b5a0a6d1f6d367ecf27cb09b74f463f669e5fea2d7527bac7ebe5f17b3d0739f7"
    "8a5292ea6bfb5fb11f8d5d0856033046fc7b6babf0cfbc20",
    16,
)
"""2/π, the first 1248 bits of its fraction."""
DIGIT_BITS, WINDOW = 1248, 192
_SPLIT = 134217729.0

SINE = tuple(
    map(
        float.fromhex,
        (
            *("0x1.5555555555555p-3", "0x1.1111111110bb1p-7", "-0x1.a01a019e8357dp-13"),
            *("0x1.71de37961e4c6p-19", "-0x1.ae600a926c89ap-26", "0x1.5e0af186af739p-33"),
        ),
    )
)
COSINE = tuple(
    map(
        float.fromhex,
        (
            *("0x1.5555555555555p-5", "-0x1.6c16c16c16966p-10", "0x1.a01a019f4e867p-16"),
            *("-0x1.27e4fa17a41b4p-22", "0x1.1eeb68b109173p-29", "-0x1.907d7aebd5e3dp-37"),
        ),
    )
)

LN2, LN2_REST = float.fromhex("0x1.62e42feep-1"), 1.9082149292705877e-10
"""ln 2 in parts, the first of 32 bits."""
TAYLOR = tuple(1 / factorial(i) for i in range(2, 15))
AREA = tuple(2 / i for i in range(3, 25, 2))


def sine(x: ArrayLike) -> Array:
    """Return sin x of angles (…), rad; NaN of what is not finite."""
    return sine_and_cosine(x)[0]


def cosine(x: ArrayLike) -> Array:
    """Return cos x of angles (…), rad; NaN of what is not finite."""
    return sine_and_cosine(x)[1]


def sine_and_cosine(x: ArrayLike) -> tuple[Array, Array]:
    """Return sin x and cos x of angles (…), rad; NaN of what is not finite."""
    x = np.asarray(x, float)
    if former_mathematics.is_former():
        return former_mathematics.former_sine_and_cosine(x)
    if x.size <= _FEW:
        few = np.array([_of_one(each) for each in x.ravel().tolist()])
        s, c = few.reshape(*x.shape, 2)[..., 0], few.reshape(*x.shape, 2)[..., 1]
        return s, c
    beyond = ~(np.abs(x) < MODERATE)
    r, rest, n = _reduced(np.where(beyond, 0.0, x))
    quadrant = n.astype(np.int64)
    odd, even, swapped = _odd(r, rest), _even(r, rest), quadrant & 1 != 0
    s, c = np.where(swapped, even, odd), np.where(swapped, odd, even)
    s = np.where(quadrant & 2 != 0, -s, s)
    c = np.where((quadrant + 1) & 2 != 0, -c, c)
    if beyond.any():
        s[beyond], c[beyond] = np.transpose([_of_one(each) for each in x[beyond].tolist()])
    return s, c


def _of_one(x: float) -> tuple[float, float]:
    """Return the same of one number: a call of NumPy costs as much as ten operations on it."""
    r, rest, n = _reduced(x) if abs(x) < MODERATE else _reduced_large(x)
    quadrant = int(n) & 3
    odd, even = _odd(r, rest), _even(r, rest)
    s, c = (even, odd) if quadrant & 1 else (odd, even)
    return -s if quadrant & 2 else s, -c if quadrant + 1 & 2 else c


def _reduced(x: Number) -> tuple[Number, Number, Number]:
    """Return r, rest and n: x = n π/2 + r + rest, |r| ≤ π/4."""
    n = x * TWO_OVER_PI + ROUND - ROUND
    first, second = x - n * P1, n * P2
    both = first - second
    changed = both - first
    lost = (first - (both - changed)) - (second + changed)
    low = n * P3 - lost
    r = both - low
    return r, (both - r) - low, n


def _odd(r: Number, rest: Number) -> Number:
    """Return sin(r + rest)."""
    c1, c2, c3, c4, c5, c6 = SINE
    z = r * r
    cube, w = z * r, z * z
    tail = c2 + z * c3 + w * (c4 + z * c5 + w * c6)
    return r - ((z * (0.5 * rest - cube * tail) - rest) + cube * c1)


def _even(r: Number, rest: Number) -> Number:
    """Return cos(r + rest)."""
    c1, c2, c3, c4, c5, c6 = COSINE
    z = r * r
    half, w = 0.5 * z, z * z
    most = 1.0 - half
    tail = c1 + z * c2 + w * (c3 + z * c4 + w * (c5 + z * c6))
    return most + (((1.0 - most) - half) + (w * tail - r * rest))


def _reduced_large(x: float) -> tuple[float, float, int]:
    """Return r, rest and n modulo 4 of a number of any size, by the digits of 2/π that decide."""
    if not isfinite(x):
        return nan, 0.0, 0
    mantissa, exponent = frexp(abs(x))
    window = DIGITS >> DIGIT_BITS - (exponent + 137) & (1 << WINDOW) - 1
    product = int(mantissa * 2.0**53) * window & (1 << WINDOW) - 1
    n, fraction = product >> 190, product & (1 << 190) - 1
    negative = bool(fraction >> 189)
    if negative:
        n, fraction = n + 1, (1 << 190) - fraction
    whole, rest, unit = 0.0, 0.0, 2.0**-30
    for place in range(160, -1, -32):
        limb = (fraction >> place & 0xFFFFFFFF) * unit
        total = whole + limb
        rest += limb - (total - whole)
        whole, unit = total, unit * 2.0**-32
    high, low = _product(whole, HALF_PI)
    low += whole * HALF_PI_REST + rest * HALF_PI
    r = high + low
    rest = low - (r - high)
    sign = 1 if (x < 0) == negative else -1
    return sign * r, sign * rest, (-n if x < 0 else n) & 3


def _product(a: float, b: float) -> tuple[float, float]:
    """Return a b, and what that rounds away (Dekker)."""
    p, a_split, b_split = a * b, _SPLIT * a, _SPLIT * b
    a_high, b_high = a_split - (a_split - a), b_split - (b_split - b)
    a_low, b_low = a - a_high, b - b_high
    return p, a_low * b_low - (p - a_high * b_high - a_low * b_high - a_high * b_low)


def exponential(x: ArrayLike) -> Array:
    """Return e^x of numbers (…); NaN of NaN."""
    if former_mathematics.is_former():
        return former_mathematics.former_exponential(x)
    given = np.clip(np.asarray(x, float), -800.0, 800.0)
    k = np.rint(given * (1 / (LN2 + LN2_REST)))
    high, low = given - k * LN2, k * LN2_REST
    r = high - low
    whole = np.isfinite(given)
    with np.errstate(over="ignore", under="ignore"):
        found: Array = np.ldexp(
            1.0 + (high - (low - r * r * _polynomial(TAYLOR, r))),
            np.where(whole, k, 0.0).astype(np.int64),
        )
    return found


def logarithm(x: ArrayLike) -> Array:
    """Return ln x of numbers (…), positive and finite."""
    mantissa, exponent = np.frexp(np.asarray(x, float))
    small = mantissa < np.sqrt(0.5)
    f = np.where(small, 2.0 * mantissa, mantissa) - 1.0
    k = (exponent - small).astype(float)
    s, half = f / (2.0 + f), 0.5 * f * f
    z = s * s
    found: Array = k * LN2 - ((half - (s * (half + z * _polynomial(AREA, z)) + k * LN2_REST)) - f)
    return found


def normal_quantile(p: ArrayLike) -> Array:
    """Return Φ⁻¹ of probabilities (…), 0 < p < 1, by AS 241 (Wichura, Applied Statistics 37)."""
    given = np.asarray(p, float)
    if former_mathematics.is_former():
        return former_mathematics.former_normal_quantile(given)
    q = given - 0.5
    root = np.sqrt(-logarithm(np.where(q < 0.0, given, 1.0 - given)))
    middle = _quotient(_MIDDLE, 0.180625 - q * q) * q
    side, end = _quotient(_SIDE, root - 1.6), _quotient(_END, root - 5.0)
    outside = np.where(root <= 5.0, side, end)
    found: Array = np.where(np.abs(q) <= 0.425, middle, np.where(q < 0.0, -outside, outside))
    return found


def _polynomial(coefficients: tuple[float, ...], x: Array) -> Array:
    """Return c_0 + c_1 x + c_2 x² + …"""
    found: Array = np.full_like(x, coefficients[-1])
    for c in coefficients[-2::-1]:
        found = found * x + c
    return found


def _quotient(of: tuple[tuple[float, ...], tuple[float, ...]], x: Array) -> Array:
    above, below = of
    return _polynomial(above, x) / _polynomial(below, x)


_MIDDLE = (
    (
        *(3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3),
        *(1.3731693765509461125e4, 4.5921953931549871457e4, 6.7265770927008700853e4),
        *(3.3430575583588128105e4, 2.5090809287301226727e3),
    ),
    (
        *(1.0, 4.2313330701600911252e1, 6.8718700749205790830e2, 5.3941960214247511077e3),
        *(2.1213794301586595867e4, 3.9307895800092710610e4, 2.8729085735721942674e4),
        5.2264952788528545610e3,
    ),
)
_SIDE = (
    (
        *(1.42343711074968357734e0, 4.63033784615654529590e0, 5.76949722146069140550e0),
        *(3.64784832476320460504e0, 1.27045825245236838258e0, 2.41780725177450611770e-1),
        *(2.27238449892691845833e-2, 7.74545014278341407640e-4),
    ),
    (
        *(1.0, 2.05319162663775882187e0, 1.67638483018380384940e0, 6.89767334985100004550e-1),
        *(1.48103976427480074590e-1, 1.51986665636164571966e-2, 5.47593808499534494600e-4),
        1.05075007164441684324e-9,
    ),
)
_END = (
    (
        *(6.65790464350110377720e0, 5.46378491116411436990e0, 1.78482653991729133580e0),
        *(2.96560571828504891230e-1, 2.65321895265761230930e-2, 1.24266094738807843860e-3),
        *(2.71155556874348757815e-5, 2.01033439929228813265e-7),
    ),
    (
        *(1.0, 5.99832206555887937690e-1, 1.36929880922735805310e-1, 1.48753612908506148525e-2),
        *(7.86869131145613259100e-4, 1.84631831751005468180e-5, 1.42151175831644588870e-7),
        2.04426310338993978564e-15,
    ),
)
