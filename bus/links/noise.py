"""What arrives of a sent field x on a link: Q(x + noise), Q rounds to multiples of a step.

The noise of position and velocity, of one shape, is drawn together; that of any other field comes
from a stream of its own, keyed by its name too: what a field is given changes nothing of others.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import ESTIMATE, Shape
from nrs_cosim.bus.links.draws import BLOCK, Draws

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
        self._deviations = deviations
        of_pair = {shapes[name] for name in PAIR if name in shapes}
        self._paired = PAIR if len(of_pair) == 1 else ()
        noisy = np.zeros(len(links), bool)
        for name in self._paired:
            noisy |= deviations.get(name, noisy) > 0
        rows, shape = np.flatnonzero(noisy), next(iter(of_pair), ())
        self._pair = (
            rows,
            Draws(
                seed,
                "link noise",
                links,
                rows,
                lambda rng, _: rng.standard_normal((BLOCK, 2, *shape)),
            ),
        )
        self._own = {
            name: (rows := np.flatnonzero(of), _own(seed, name, links, rows, shapes[name]))
            for name, of in deviations.items()
            if name not in self._paired
        }

    def added(self, k: int, name: str, values: Array) -> Array:
        """Return the values of a field (F, …), which t_k's samples have, with their noise."""
        rows, draws = self._pair if name in self._paired else self._own[name]
        if not len(rows):
            return values
        drawn = draws.at(k)
        if name in self._paired:
            drawn = drawn[:, PAIR.index(name)]
        noisy = values.copy()
        spread = self._deviations[name][rows]
        noisy[rows] += spread.reshape(-1, *[1] * (drawn.ndim - 1)) * drawn
        return noisy


def _own(
    seed: int, name: str, links: Sequence[tuple[int, int]], rows: NDArray[np.intp], shape: Shape
) -> Draws:
    return Draws(
        seed,
        f"link noise {name}",
        links,
        rows,
        lambda rng, _: rng.standard_normal((BLOCK, *shape)),
    )


def quantised(values: Array, steps: Array) -> Array:
    """Return values (F, …) rounded to multiples of steps (F,); of 0 they are left as they are."""
    rows = np.flatnonzero(steps)
    if not len(rows):
        return values
    coarse = values[rows]
    step = steps[rows].reshape(-1, *[1] * (values.ndim - 1))
    with np.errstate(over="ignore"):  # a count that overflows is beyond what is rounded
        count = coarse / step
        rounded = np.rint(count) * step
    found = values.copy()
    found[rows] = np.where(np.abs(count) < _EXACT, rounded, coarse)
    return found
