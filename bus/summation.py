"""In which order numbers are added that a digest rests on: this one, whatever library adds them.

    S(x_0, …, x_n) = x_0 + P(x_1, …, x_n)
    P(x_1, …, x_n) = ((x_1 + x_2) + x_3) + …                                       n < 8
                   = (((r_1 + r_2) + (r_3 + r_4)) + ((r_5 + r_6) + (r_7 + r_8))) + …     n ≤ 128
                   = P(x_1, …, x_h) + P(x_{h+1}, …, x_n)                           n > 128

with r_j = (x_j + x_{j+8}) + x_{j+16} + …, after which come, one by one, those of the last n mod 8;
and h is n/2, less what is no multiple of 8. What a robot receives is added by S; the terms of a
target, of a robot's law and of a step of Runge and Kutta by P alone. These are the orders of NumPy
2's `add.reduceat` and `sum`, which it is free to change.
"""

from collections import defaultdict
from collections.abc import Iterator
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.intp]
Anything = NDArray[Any]
_LANES, _BLOCK = 8, 128


class Summation:
    """Sums of successive stretches along the first axis of arrays."""

    def __init__(self, start: Indices, total: int) -> None:
        """Know where stretches begin, ascending; each ends where the next begins, or at `total`."""
        count = np.diff(np.append(start, total))
        self._rows = len(start)
        # The longest first: those that have a further number are then the first so many.
        short = np.flatnonzero((count > 0) & (count <= _LANES))
        self._short = short[np.argsort(-count[short], kind="stable")]
        self._long = np.flatnonzero(count > _LANES)
        self._start, self._count = start, count
        self._is_plain = len(self._short) > 0 and np.array_equal(self._short, np.arange(self._rows))
        """Whether all are short, the longest first."""

    def __call__(self, x: Anything) -> Anything:
        """Return the sums of (total, …), a row a stretch; 0 of one that is empty."""
        if self._is_plain:
            return self._added(x)
        sums = np.zeros((self._rows, *x.shape[1:]), x.dtype)
        if len(self._short):
            sums[self._short] = self._added(x)
        if len(self._long):
            partial = x.copy()
            for into, added in self._steps:
                partial[into] += partial[added]
            sums[self._long] = partial[self._start[self._long]]
        return sums

    def _added(self, x: Anything) -> Anything:
        """Return the sums of short stretches: x_0 + ((x_1 + x_2) + …)."""
        first, *further = self._places
        sums: Anything = x.take(first, axis=0)
        if further:
            rest = x.take(further[0], axis=0)
            for place in further[1:]:
                rest[: len(place)] += x.take(place, axis=0)
            sums[: len(rest)] += rest
        return sums

    @cached_property
    def _places(self) -> list[Indices]:
        """Where the first, second … numbers of short stretches are, of those that have one."""
        start, count = self._start[self._short], self._count[self._short]
        return [start[count > place] + place for place in range(count[0])]

    @cached_property
    def _steps(self) -> list[tuple[Indices, Indices]]:
        """Which partial sums of long stretches are added to which, at once where that can be."""
        steps: defaultdict[int, list[tuple[Indices, Indices]]] = defaultdict(list)
        counts = self._count[self._long]
        for count in sorted(set(counts.tolist())):
            starts = self._start[self._long][counts == count][:, None]
            for level, (into, added) in enumerate(_levels(count)):
                steps[level].append(((starts + into).ravel(), (starts + added).ravel()))
        return [
            (np.concatenate([into for into, _ in step]), np.concatenate([of for _, of in step]))
            for step in steps.values()
        ]


def summed(x: Anything) -> Anything:
    """Return P of the last axis, (…, n); 0 of none."""
    if not x.shape[-1]:
        return np.zeros(x.shape[:-1], x.dtype)
    if x.shape[-1] < _LANES:
        few: Anything = x[..., 0].copy()
        for row in range(1, x.shape[-1]):
            few += x[..., row]
        return few
    terms = np.moveaxis(x, -1, 0).copy()
    for into, added in _levels(len(terms), from_first=True):
        terms[into] += terms[added]
    total: Anything = terms[0]
    return total


@lru_cache(maxsize=1024)
def _levels(count: int, *, from_first: bool = False) -> list[tuple[Indices, Indices]]:
    """Return the additions of S, or of P, by when what they need is there."""
    ready = [0] * count
    levels: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)
    for into, added in _pairwise(0, count) if from_first else _additions(count):
        ready[into] = level = max(ready[into], ready[added]) + 1
        levels[level].append((into, added))
    found = [np.array(levels[level], np.intp).T for level in sorted(levels)]
    return [(into, added) for into, added in found]


def _additions(count: int) -> Iterator[tuple[int, int]]:
    """Yield which number is added to which, one after another, of S."""
    if count > 1:
        yield from _pairwise(1, count)
        yield 0, 1


def _pairwise(first: int, end: int) -> Iterator[tuple[int, int]]:
    """Yield the same of P, over first … end − 1, which leaves it at `first`."""
    n = end - first
    if n > _BLOCK:
        half = first + n // 2 - n // 2 % _LANES
        yield from _pairwise(first, half)
        yield from _pairwise(half, end)
        yield first, half
        return
    after = first + 1
    if n >= _LANES:
        after = end - n % _LANES
        for row in range(first + _LANES, after):
            yield first + (row - first) % _LANES, row
        for width in (1, 2, 4):
            for lane in range(0, _LANES, 2 * width):
                yield first + lane, first + lane + width
    for row in range(after, end):
        yield first, row
