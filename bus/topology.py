"""Who receives from whom: the digraph of the paper's section 2.2, kept as a list of edges j → i.

Node 0 is the target, nodes 1 … n are the robots. Edges are sorted by (i, j): a robot's sum over
its in-neighbours is always taken in the order of their numbers, whoever computes it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nrs_cosim.bus.matrices import Matrix, components, matrix_of


@dataclass(frozen=True, slots=True, eq=False)
class Topology:
    """The weighted digraph of n robots and the target."""

    n: int
    source: NDArray[np.intp]
    """(E,) node j of each edge j → i, 0 … n."""
    sink: NDArray[np.intp]
    """(E,) robot i of each edge j → i, 1 … n, ascending."""
    weight: NDArray[np.float64]
    """(E,) w_ij > 0."""

    @classmethod
    def of(cls, adjacency: ArrayLike, pinning: ArrayLike) -> "Topology":
        """Return the digraph of adjacency (n, n), w_ij, and pinning (n,), w_i0, all ≥ 0."""
        full = np.column_stack([np.asarray(pinning, float), np.asarray(adjacency, float)])
        sink, source = np.nonzero(full)
        return cls(len(full), source, sink + 1, full[sink, source])

    @classmethod
    def of_edges(cls, n: int, source: ArrayLike, sink: ArrayLike, weight: ArrayLike) -> "Topology":
        """Return the digraph of edges j → i, each (E,), given once and in any order."""
        j, i = np.asarray(source, np.intp), np.asarray(sink, np.intp)
        order = np.lexsort((j, i))
        return cls(n, j[order], i[order], np.asarray(weight, float)[order])

    def in_neighbours(self, robot: int) -> NDArray[np.intp]:
        """Return the nodes that a robot receives from, ascending: (d,), 0 for the target."""
        first, end = np.searchsorted(self.sink, [robot, robot + 1])
        received: NDArray[np.intp] = self.source[first:end]
        return received

    @property
    def pinned(self) -> NDArray[np.intp]:
        """(p,) the robots that receive from the target, ascending."""
        robots: NDArray[np.intp] = self.sink[self.source == 0]
        return robots

    @property
    def in_degree(self) -> NDArray[np.float64]:
        """ϖ_i = Σ_{j=0..n} w_ij, shape (n,)."""
        return np.bincount(self.sink - 1, self.weight, minlength=self.n).astype(np.float64)

    @property
    def normalised(self) -> NDArray[np.float64]:
        """(E,) w_ij / ϖ_i, what the algorithms weigh a received sample with."""
        return self.weight / self.in_degree[self.sink - 1]

    @property
    def D(self) -> Matrix:  # noqa: N802, the paper's symbol
        """D = B⁻¹ Ŵ, shape (n, n): the normalised weights between robots."""
        among = self.source > 0
        rows, columns = self.sink[among] - 1, self.source[among] - 1
        return matrix_of(rows, columns, self.normalised[among], self.n)

    def steps(self) -> NDArray[np.intp]:
        """Return the fewest edges that lead from the target to each robot, (n,); −1 for none do."""
        order = np.argsort(self.source, kind="stable")
        heard_by = self.sink[order].tolist()
        first = np.searchsorted(self.source[order], np.arange(self.n + 2)).tolist()
        steps = [0, *[-1] * self.n]
        reached = [0]
        for node in reached:  # which grows: nearer nodes come first
            for robot in heard_by[first[node] : first[node + 1]]:
                if steps[robot] < 0:
                    steps[robot] = steps[node] + 1
                    reached.append(robot)
        return np.array(steps[1:], np.intp)

    def unreached(self) -> list[int]:
        """Return the robots to which no directed path leads from the target.

        Empty if and only if the digraph has a spanning tree rooted at the target (assumption A2).
        """
        return [int(row) + 1 for row in np.flatnonzero(self.steps() < 0)]

    def components(self) -> list[NDArray[np.intp]]:
        """Return the strongly connected components, each as its robots − 1, (size,)."""
        return components(self.D)
