"""What robots have of their in-neighbours at t_k: the samples one by one, and reductions of them.

All arrays have a row an in-edge, (E, …), sorted by (robot, in-neighbour); what is reduced over a
robot's edges has a row a robot, (rows, …). A reduction takes a robot's edges in their order, which
depends on the robot alone, and adds in the order of `summation`: it is the same to the last bit
however robots are spread over workers.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.summation import Summation
from nrs_cosim.estimator_agents.values import Array, Values

Mask = NDArray[np.bool_]
Anything = NDArray[Any]


@dataclass(frozen=True, eq=False)  # with no slots: what is reduced once is kept
class Received:
    """The samples that some robots go by at one sampling time; E in-edges into the rows."""

    row: NDArray[np.intp]
    """(E,) the row of the robot that receives, ascending."""
    start: NDArray[np.intp]
    """(rows,) where each robot's edges begin."""
    source: NDArray[np.intp]
    """(E,) the node that sent; 0 is the target."""
    weight: Array
    """(E, 1) w_ij/ϖ_i."""
    samples: Values
    """What was sent, (E, *shape) of each field."""
    links: Values
    """What the robot keeps of each in-neighbour, (E, *shape) of each link field."""
    delivered: Mask | None = None
    """(E,) where there is a sample to go by; None where there is one on every edge."""
    sent: NDArray[np.int64] | None = None
    """(E,) how many sampling periods ago each sample was sent; None where all are of t_k."""
    sums: Summation | None = None
    """Over each robot's edges; found anew where it is None."""
    velocities: "Received | None" = None
    """The same over the digraph of velocities, where that is another."""

    def guarded(self) -> "Received":
        """Return the same, whose samples and link fields cannot be written."""
        velocities = self.velocities and self.velocities.guarded()
        samples, links = self.samples.guarded(), self.links.guarded()
        return replace(self, samples=samples, links=links, velocities=velocities)

    @cached_property
    def present(self) -> Mask:
        """(E,) whether there is a sample to go by."""
        return np.ones(len(self.row), bool) if self.delivered is None else self.delivered

    @cached_property
    def age(self) -> NDArray[np.int64]:
        """(E,) how many sampling periods ago the sample was sent; 0 is at t_k."""
        return np.zeros(len(self.row), np.int64) if self.sent is None else self.sent

    @cached_property
    def _is_complete(self) -> bool:
        return self.delivered is None or bool(self.delivered.all())

    def over(self, field: str) -> "Received":
        """Return what was received over the digraph of a field: velocities may have their own."""
        return self.velocities if self.velocities and field == "velocity" else self

    def own(self, x: Array) -> Array:
        """Return a robot's own value, (rows, …), at each of its edges, (E, …)."""
        return x.take(self.row, axis=0)

    def difference(self, field: str, own: Array) -> Array:
        """Return x_j − x_i at each edge, (E, …): of in-neighbours' samples and own values."""
        return self.samples[field] - self.own(own)

    def disagreement(self, field: str, own: Array) -> Array:
        """Return Σ_j w_ij/ϖ_i (x_j − x_i), (rows, …), over the digraph of the field.

        Where some samples are not there, the weights of the others are divided by their sum.
        """
        edges = self.over(field)
        return edges.mean(edges.difference(field, own))

    def sum(self, x: Array) -> Array:
        """Return the sum of (E, …) over the edges with a sample; 0 where there are none."""
        return self.reduce(np.add, x, 0.0)

    def maximum(self, x: Array, empty: float = -np.inf) -> Array:
        """Return the largest of (E, …) by component; `empty` where there is no sample."""
        return self.reduce(np.maximum, x, empty)

    def minimum(self, x: Array, empty: float = np.inf) -> Array:
        """Return the smallest of (E, …) by component; `empty` where there is no sample."""
        return self.reduce(np.minimum, x, empty)

    @cached_property
    def count(self) -> Array:
        """(rows, 1) from how many there is a sample."""
        return self.sum(self.present.astype(float)[:, None])

    def mean(self, x: Array, kept: Mask | None = None) -> Array:
        """Return the weighted mean of (E, …) over the edges with a sample, and `kept` of them.

        `kept` is (E,) or as x. The weights of those that are left are divided by their sum; it is 0
        where none is left.
        """
        if kept is None and self._is_complete:
            return self._rows(np.add, _as_wide(self.weight, x) * x, 0.0)
        mask = self.present[:, None]
        if kept is not None:
            mask = mask & kept.reshape(len(kept), _width(kept))
        weights = np.where(mask, self.weight, 0.0)
        rest = self._rows(np.add, weights, 0.0)
        whole = self._rows(np.logical_and, mask, True)
        mask, weights, rest, whole = (_as_wide(part, x) for part in (mask, weights, rest, whole))
        # Of what is not there only the sign is left: as if multiplied by 0, if it is a number.
        total = self._rows(np.add, weights * np.where(mask, x, np.copysign(0, x)), 0.0)
        mean: Array = total / np.where(whole | (rest == 0), 1, rest)
        return mean

    def reduce(self, ufunc: np.ufunc, x: Array, empty: float) -> Array:
        """Reduce (E, …) to (rows, …) over the edges with a sample, in their order.

        `empty` is the ufunc's neutral element, and the result where there is no sample.
        """
        if not self._is_complete:
            x = np.where(_as_wide(self.present, x), x, empty)
        return self._rows(ufunc, x, empty)

    def trim(self, x: Array, own: Array, F: int, trusted: Mask | None = None) -> Mask:
        """Return where (E, m) is left when outliers go, by component (W-MSR).

        They are the F largest of those above the robot's own value, (rows, m), or all if there are
        fewer, and the F smallest of those below. What is on `trusted` edges, (E,), stays. Of equal
        ones the first in-neighbours go. LeBlanc, Zhang, Koutsoukos, Sundaram, JSAC 31(4), 2013.
        """
        mine = np.broadcast_to(own[self.row], x.shape)
        out = ~self.present if trusted is None else ~self.present | trusted
        x = np.where(_as_wide(out, x), mine, x)
        below = np.minimum(F, self._rows(np.add, (x < mine).astype(np.intp), 0))
        above = np.minimum(F, self._rows(np.add, (x > mine).astype(np.intp), 0))
        rank, degree = self._rank(x), _as_wide(self._degree[self.row], x)
        kept: Mask = (rank >= below[self.row]) & (rank < degree - above[self.row])
        kept &= _as_wide(self.present, x)
        return kept

    def trimmed_mean(self, x: Array, F: int, empty: float = 0.0) -> Array:
        """Return the mean of (E, …) by component without its F largest and F smallest.

        It is `empty` where no more than 2 F have a sample.
        """
        x, many = self._last(x), _as_wide(self._present_count, x)
        rank = self._rank(x)
        kept = (rank >= F) & (rank < many[self.row] - F)
        total = self._rows(np.add, np.where(kept, x, 0.0), 0.0)
        left = many - 2 * F
        return np.where(left > 0, total / np.maximum(left, 1), empty)

    def median(self, x: Array, empty: float = np.nan) -> Array:
        """Return the median of (E, …) by component; of an even number the mean of the middle two.

        It is `empty` where there is no sample.
        """
        x, many = self._last(x), _as_wide(self._present_count, x)
        rank, half = self._rank(x), many[self.row]
        low = np.where(rank == (half - 1) // 2, x, -np.inf)
        high = np.where(rank == half // 2, x, -np.inf)
        middle = self._rows(np.maximum, low, -np.inf), self._rows(np.maximum, high, -np.inf)
        with np.errstate(invalid="ignore"):
            return np.where(many > 0, (middle[0] + middle[1]) / 2, empty)

    def padded(self, x: Array, width: int, fill: float = 0.0) -> Array:
        """Return a robot's edges side by side, (rows, width, …), and `fill` after them."""
        wide = np.full((len(self.start), width, *x.shape[1:]), fill)
        place = np.arange(len(self.row)) - self.start[self.row]
        wide[self.row[self.present], place[self.present]] = x[self.present]
        return wide

    @cached_property
    def _degree(self) -> NDArray[np.intp]:
        return np.diff(np.append(self.start, len(self.row)))

    @cached_property
    def _present_count(self) -> NDArray[np.intp]:
        return self._rows(np.add, self.present.astype(np.intp), 0)

    def _last(self, x: Array) -> Array:
        """Return what has no sample as larger than all else."""
        return x if self._is_complete else np.where(_as_wide(self.present, x), x, np.inf)

    def _rank(self, x: Array) -> NDArray[np.intp]:
        """Return each one's place by size, from 0, among its robot's; ties in their order."""
        flat = x.reshape(len(x), _width(x))
        rank = np.empty(flat.shape, np.intp)
        place = np.arange(len(self.row)) - self.start[self.row]
        for column in range(flat.shape[1]):
            # Stable, and by row first, so that the edges of a robot stay where they are together.
            rank[np.lexsort((flat[:, column], self.row)), column] = place
        return rank.reshape(x.shape)

    def _rows(self, ufunc: np.ufunc, x: Anything, empty: float) -> Anything:
        """Reduce (E, …) to (rows, …), also where a robot has no edge at all.

        `reduceat` gives such a row the next row's first element, or an error at the end.
        """
        if ufunc is np.add and x.dtype == np.float64:
            return self._summation(x)
        if self._is_full:
            reduced: Anything = ufunc.reduceat(x, self.start, axis=0)
            return reduced
        full = self._degree > 0
        found = np.full((len(self.start), *x.shape[1:]), empty, x.dtype)
        if full.any():
            found[full] = ufunc.reduceat(x, self.start[full], axis=0)
        return found

    @cached_property
    def _summation(self) -> Summation:
        return self.sums or Summation(self.start, len(self.row))

    @cached_property
    def _is_full(self) -> bool:
        return bool(self._degree.all())


def _as_wide(column: Anything, x: Anything) -> Anything:
    """Return what has one number a row, or as many as x has, with as many axes as x."""
    if column.size == len(column):
        return column.reshape(len(column), *[1] * (x.ndim - 1))
    return column.reshape(len(column), *x.shape[1:])


def _width(x: Anything) -> int:
    """Return how many numbers a row has."""
    return int(np.prod(x.shape[1:], dtype=int))
