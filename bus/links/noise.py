"""What arrives of a sent field x on a link: Q(x + noise), Q rounds to multiples of a step.

The noise of position and velocity, of one shape, is drawn together; that of any other field comes
from a stream of its own, keyed by its name too: what a field is given changes nothing of others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import ESTIMATE, Shape
from nrs_cosim.bus.links.draws import BLOCK, Draws
from nrs_cosim.bus.random_streams import normal

Array = NDArray[np.float64]
PAIR = tuple(ESTIMATE)
_EXACT = 2.0**52
"""From so many steps on a double has no digits left that the step could round away."""


class FieldNoise:
    """The noise of the fields that are sent; F is the number of links that have faults."""

    def __init__(
        self,
        seed: int,
        links: Sequence[tuple[int, int]],
        shapes: Mapping[str, Shape],
        deviations: Mapping[str, Array],
    ) -> None:
        """Take the standard deviations (F,) of each number of a field, by field."""
        of_pair = {shapes[name] for name in PAIR if name in shapes}
        self._paired = [name for name in PAIR if name in shapes and len(of_pair) == 1]
        self._fields = {}
        """Of each field with noise: its rows, their standard deviations, and their draws."""

        def drawn(purpose: str, rows: NDArray[np.intp], shape: Shape) -> Draws:
            return Draws(seed, purpose, links, rows, lambda rng, _: normal(rng, (BLOCK, *shape)))

        noisy = np.flatnonzero(np.any([deviations[name] > 0 for name in self._paired], axis=0))
        pair = drawn("link noise", noisy, (2, *next(iter(of_pair), ())))
        for name, of in deviations.items():
            rows = noisy if name in self._paired else np.flatnonzero(of)
            own = pair if name in self._paired else drawn(f"link noise {name}", rows, shapes[name])
            if len(rows):
                self._fields[name] = _Rows.of(rows, of, shapes[name]), own

    def added(self, k: int, name: str, values: Array) -> Array:
        """Return the values of a field (F, …), which t_k's samples have, with their noise."""
        if name not in self._fields:
            return values
        of, draws = self._fields[name]
        drawn = draws.at(k)
        noise = of.extent * (drawn[:, PAIR.index(name)] if name in self._paired else drawn)
        return of.put(values, values[of.rows] + noise)


class Quantisation:
    """What the numbers of some fields are rounded to multiples of."""

    def __init__(self, shapes: Mapping[str, Shape], steps: Mapping[str, Array]) -> None:
        """Take the steps (F,) of each number of a field, by field; 0 leaves it as it is."""
        self._fields = {
            name: _Rows.of(np.flatnonzero(of), of, shapes[name])
            for name, of in steps.items()
            if of.any()
        }

    def rounded(self, name: str, values: Array) -> Array:
        """Return the values of a field (F, …), rounded."""
        if name not in self._fields:
            return values
        of = self._fields[name]
        coarse = values[of.rows]
        with np.errstate(over="ignore"):  # a count that overflows is beyond what is rounded
            count = coarse / of.extent
            multiple = np.rint(count) * of.extent
        return of.put(values, np.where(np.abs(count) < _EXACT, multiple, coarse))


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Some of F links, with what there is on each of them."""

    rows: NDArray[np.intp] | slice
    """A slice where they are all, which copies nothing."""
    extent: Array
    """(rows, 1, …), as many axes as the field's values have."""

    @classmethod
    def of(cls, rows: NDArray[np.intp], extents: Array, shape: Shape) -> "_Rows":
        """Return some rows of F links with what is on them of all extents (F,)."""
        extent = extents[rows].reshape(-1, *[1] * len(shape))
        return cls(slice(None) if len(rows) == len(extents) else rows, extent)

    def put(self, values: Array, some: Array) -> Array:
        """Return values (F, …) of which these rows are others."""
        if isinstance(self.rows, slice):
            return some
        found = values.copy()
        found[self.rows] = some
        return found
