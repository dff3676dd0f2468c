"""What a robot knows of the sampling time t_k and of itself, and nothing of the others.

Draws are keyed by (seed, purpose, robot, k): they depend on no order and on no layout.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.random_streams import keyed_normal, keyed_uniform

Array = NDArray[np.float64]


@dataclass(frozen=True)  # with no slots: what is drawn of a row is kept
class Now:
    """A sampling time as some robots see it, a row a robot."""

    k: int
    t: float
    """s"""
    h: float
    """s since the sampling time before."""
    robots: NDArray[np.integer]
    """(rows,) their numbers, from 1."""
    out_degree: Array
    """(rows, 1) how many receive from each robot at t_k."""
    in_neighbours: tuple[NDArray[np.integer], NDArray[np.integer]]
    """(E,) each: the row of the robot that receives and the node that sends, 0 being the target."""
    pinned: NDArray[np.bool_]
    """(rows,) who receives from the target at t_k."""
    seed: int = 0

    @cached_property
    def in_degree(self) -> Array:
        """(rows, 1) from how many each robot receives at t_k, the target among them."""
        row, _ = self.in_neighbours
        return np.bincount(row, minlength=len(self.robots)).astype(float)[:, None]

    def uniform(self, purpose: str, size: int = 1) -> Array:
        """Return draws from [0, 1), (rows, size), for one purpose."""
        return keyed_uniform(self.seed, purpose, self.robots, self.k, size)

    def normal(self, purpose: str, size: int = 1) -> Array:
        """Return draws of mean 0 and variance 1, (rows, size), for one purpose."""
        return keyed_normal(self.seed, purpose, self.robots, self.k, size)

    def shared(self) -> "Now":
        """Return the same, but drawing (1, size) for all robots alike, on every worker."""
        return replace(self, robots=np.zeros(1, np.intp))
