"""Axes of a study: keys of the scenario and the values that they take, one after another.

    algorithm.alpha=0.1:1.3:25             25 values from 0.1 to 1.3, evenly
    algorithm.alpha=log:0.01:1:7           7 values, by equal factors
    run.sampling_period=0.05,0.1,0.2       these; each is TOML, or else a text
    algorithm.name=dcea1,dcea2
    algorithm.alpha=0.8,0.9;algorithm.beta=1.1,1.0     keys that go together, value by value
    algorithm.alpha=0.1:1.3                drawn from the range, by one draw for all such keys

A draw fills the ranges evenly: a Latin hypercube, where each of n parts of each range has one
point, or Sobol's sequence, of which a longer draw begins with a shorter one. Point i depends on the
draw's seed alone. Values are decimals: a grid of steps of 0.05 has 0.15, not 0.15000000000000002.
"""

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from itertools import product
from math import log10, prod
from typing import Any

import numpy as np

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.numerals import decimal
from nrs_cosim.bus.text import quoted

SEED = "run.seed"
MOST = 10_000_000
"""Points of a study."""
DIGITS, OF_TIMES = 12, 6
"""Significant ones of a value between two that were given; decimals of one that is a time, s."""
TIMES = ("run.sampling_period", "run.output_step", "run.duration")
_NEXT = re.compile(r";(?=\s*[\w.-]+\s*=)")
_RANGE = re.compile(r"(log:)?([^:,\[\]\"']+):([^:,\[\]\"']+?)(?::(\d+))?")
_DRAW = re.compile(r"(lhs|sobol):(\d+)(?::(\d+))?")

Values = tuple[tuple[Any, ...], ...]


@dataclass(frozen=True, slots=True)
class StudyAxis:
    """Keys that change together, and what they are one after another."""

    keys: tuple[str, ...]
    values: Values
    """A tuple for each place on the axis, of a value for each key."""
    drawn: bool = False
    """Whether its keys vary independently, in spite of going together."""


@dataclass(frozen=True, slots=True)
class DrawnRange:
    """A key whose values are drawn from a range."""

    key: str
    low: float
    high: float
    logarithmic: bool = False


@dataclass(frozen=True, slots=True)
class Draw:
    """How ranges are filled."""

    kind: str
    """`lhs` or `sobol`."""
    count: int
    seed: int = 0

    @classmethod
    def of(cls, option: str, text: str) -> "Draw":
        """Read `lhs:N`, `sobol:N`, or either with `:SEED`."""
        found = _DRAW.fullmatch(text)
        if not found or not 1 <= int(found[2]) <= MOST:
            raise InputError(
                f"{option}: expected lhs:N or sobol:N, or :SEED after, got {quoted(text)}"
            )
        return cls(found[1], int(found[2]), int(found[3] or 0))


def axis_of(option: str, text: str) -> StudyAxis | DrawnRange:
    """Read `KEY=VALUES`, or several with semicolons between; `InputError` says what is wrong."""
    parts = [part.partition("=") for part in _NEXT.split(text)]
    keys = tuple(key.strip() for key, _, _ in parts)
    for (key, equals, _), part in zip(parts, _NEXT.split(text), strict=True):
        if not equals or not re.fullmatch(r"[\w-]+(\.[\w-]+)+", key.strip()):
            raise InputError(
                f"{option}: expected KEY=VALUES, such as algorithm.alpha=0.1:1.3:25, got "
                f"{quoted(part)}"
            )
    columns = [
        _values(option, key, given.strip()) for key, (_, _, given) in zip(keys, parts, strict=True)
    ]
    if isinstance(columns[0], tuple) and len(columns) == 1:
        return DrawnRange(keys[0], *columns[0])
    lists = [column for column in columns if isinstance(column, list)]
    if len(lists) != len(columns):
        raise InputError(f"{option}: a range that is drawn from, a:b, stands by itself")
    return zipped(option, keys, lists)


def zipped(option: str, keys: Sequence[str], columns: Sequence[Sequence[Any]]) -> StudyAxis:
    """Return keys that go together; `InputError` where they have not as many values each."""
    if len({*keys}) < len(keys):
        raise InputError(f"{option}: {keys[0]}: is given twice")
    if len({len(column) for column in columns}) > 1:
        counts = ", ".join(f"{key} has {len(c)}" for key, c in zip(keys, columns, strict=True))
        raise InputError(f"{option}: keys that go together have as many values each, but {counts}")
    if not columns[0]:
        raise InputError(f"{option}: {keys[0]}: expected one value at least")
    return StudyAxis(tuple(keys), tuple(zip(*columns, strict=True)))


def seeds_of(option: str, text: str) -> StudyAxis:
    """Read `N`, for the seeds 1 to N, or a list of seeds."""
    try:
        numbers = [int(part) for part in text.removesuffix(",").split(",")]
    except ValueError:
        numbers = [-1]
    if min(numbers) < 0 or numbers == [0] or max(numbers) > MOST:
        raise InputError(
            f"{option}: expected a number of seeds, or seeds as 1,5,9, got {quoted(text)}"
        )
    found = range(1, numbers[0] + 1) if "," not in text else dict.fromkeys(numbers)
    return StudyAxis((SEED,), tuple((seed,) for seed in found))


def with_draw(axes: Iterable[StudyAxis | DrawnRange], draw: Draw | None) -> tuple[StudyAxis, ...]:
    """Return axes whose ranges are filled, in the place of the first; `InputError` if unclear."""
    axes = list(axes)
    ranges = [axis for axis in axes if isinstance(axis, DrawnRange)]
    if ranges and draw is None:
        raise InputError(
            f"{ranges[0].key}: of a range a:b values are drawn: give --draw lhs:N or sobol:N, or "
            "a:b:n for a grid"
        )
    if draw and not ranges:
        raise InputError("draw: no key has a range a:b to draw from")
    made: list[StudyAxis] = []
    for axis in axes:
        if isinstance(axis, StudyAxis):
            made.append(axis)
        elif draw and axis is ranges[0]:
            made.append(_drawn(ranges, draw))
    keys = keys_of(made)
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"{key}: is on two axes")
    if (count := prod(len(axis.values) for axis in made)) > MOST:
        raise InputError(f"axes: expected at most {MOST:,} points in all, got {count:,}")
    return tuple(made)


def keys_of(axes: Iterable[StudyAxis]) -> list[str]:
    """Return the keys of axes."""
    return [key for axis in axes for key in axis.keys]


def grid_points(axes: Sequence[StudyAxis]) -> Iterable[Mapping[str, Any]]:
    """Yield the values by key of each point of the product of axes, the last axis the fastest."""
    for chosen in product(*(axis.values for axis in axes)):
        yield {
            key: value
            for axis, values in zip(axes, chosen, strict=True)
            for key, value in zip(axis.keys, values, strict=True)
        }


def evenly(values: Sequence[Any], most: int) -> list[Any]:
    """Return so many of values at most, evenly, the ends among them."""
    count = min(len(values), most)
    return [values[at * (len(values) - 1) // max(count - 1, 1)] for at in range(count)]


def rounded(key: str, value: float) -> float:
    """Return a value of a key in as many digits as are told; a time is whole microseconds."""
    return round(value, OF_TIMES) if key in TIMES else float(f"{value:.{DIGITS}g}")


def _drawn(ranges: Sequence[DrawnRange], draw: Draw) -> StudyAxis:
    from scipy.stats import qmc  # noqa: PLC0415, of draws alone

    sampler: Any = {"lhs": qmc.LatinHypercube, "sobol": qmc.Sobol}[draw.kind]
    made = sampler(d=len(ranges), rng=np.random.default_rng(draw.seed))
    power = max(draw.count - 1, 0).bit_length()
    unit = made.random(draw.count) if draw.kind == "lhs" else made.random_base2(power)[: draw.count]
    rows = (tuple(_at(axis, float(u)) for axis, u in zip(ranges, row, strict=True)) for row in unit)
    return StudyAxis(tuple(axis.key for axis in ranges), tuple(rows), drawn=True)


def _at(axis: DrawnRange, u: float) -> float:
    """Return the value at a part of a range; of six digits, which no drawn value needs more of."""
    if axis.logarithmic:
        value = axis.low * (axis.high / axis.low) ** u
    else:
        value = axis.low + (axis.high - axis.low) * u
    return rounded(axis.key, float(f"{value:.6g}"))


def _values(option: str, key: str, text: str) -> list[Any] | tuple[float, float, bool]:
    """Return a list of values, or a range to draw from."""
    where = f"{option} {key}"
    found = _RANGE.fullmatch(text)
    if found:
        try:
            low, high = decimal(found[2].strip()), decimal(found[3].strip())
        except ValueError:
            found = None
    if not found:
        return _listed(where, text)
    logarithmic = bool(found[1])
    if logarithmic and min(low, high) <= 0:
        raise InputError(f"{where}: by equal factors a range is above 0, got {quoted(text)}")
    if found[4] is None:
        return low, high, logarithmic
    n = int(found[4])
    if not 1 <= n <= MOST or (n == 1 and low != high):
        raise InputError(f"{where}: expected a:b:n with n of 2 or more, got {quoted(text)}")
    if logarithmic:
        a, b = log10(low), log10(high)
        return [rounded(key, 10 ** (a + (b - a) * i / max(n - 1, 1))) for i in range(n)]
    return _evenly(key, found[2].strip(), found[3].strip(), n)


def _evenly(key: str, low: str, high: str, n: int) -> list[Any]:
    """Return n values as decimals; whole ones where both ends are and all are."""
    a, b = Decimal(low), Decimal(high)
    exact = [a + (b - a) * i / max(n - 1, 1) for i in range(n)]
    whole = all(re.fullmatch(r"[+-]?\d+", end) for end in (low, high))
    if whole and all(value == value.to_integral_value() for value in exact):
        return [int(value) for value in exact]
    return [rounded(key, float(value)) for value in exact]


def _listed(where: str, text: str) -> list[Any]:
    """Return values of TOML with commas between, or texts where they are no TOML."""
    if not text:
        raise InputError(f"{where}: expected values, got none")
    try:
        found: list[Any] = tomllib.loads(f"x = [{text}]")["x"]
    except (tomllib.TOMLDecodeError, RecursionError, ValueError, InvalidOperation):
        if any(mark in text for mark in "[]{}\"'"):
            raise InputError(f"{where}: expected values of TOML, got {quoted(text)}") from None
        found = [part.strip() for part in text.split(",")]
    return found
