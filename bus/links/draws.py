"""What is drawn for the samples of a link: keyed by (seed, purpose, j, i, block of sampling times).

A draw depends neither on who asks, nor on the order, nor on other links, nor on other purposes.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.random_streams import random_stream

BLOCK = 64
"""Draws are made for so many sampling times of a link at once, and only these are kept."""

Draw = Callable[[np.random.Generator, int], NDArray[Any]]
"""Draws (BLOCK, …) for the link of a row."""


class Draws:
    """Draws for one purpose on some links: one generator a link and block of sampling times."""

    def __init__(
        self,
        seed: int,
        purpose: str,
        links: Sequence[tuple[int, int]],
        rows: NDArray[np.intp],
        draw: Draw,
    ) -> None:
        """Draw for some rows (r,), ascending, of all `links` that have faults."""
        self._seed, self._purpose = seed, purpose
        self._rows, self._draw = rows.tolist(), draw
        self._links = [links[row] for row in self._rows]
        self._kept: tuple[int, NDArray[Any]] = -1, np.empty((BLOCK, 0))
        """The last block that was drawn, and its number."""

    def at(self, k: int) -> NDArray[Any]:
        """Return the draws of t_k, (r, …)."""
        number, offset = divmod(k, BLOCK)
        # Links may be shared by runs in several threads: a block is read with its own number.
        kept, block = self._kept
        if self._links and number != kept:
            blocks = [
                self._draw(random_stream(self._seed, self._purpose, *link, number), row)
                for link, row in zip(self._links, self._rows, strict=True)
            ]
            block = np.stack(blocks, axis=1)
            self._kept = number, block
        drawn: NDArray[Any] = block[offset]
        return drawn
