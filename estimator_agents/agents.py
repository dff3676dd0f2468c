"""An agent takes the samples of its in-neighbours in and gives its own out; no bus is inside.

At t_k (k ≥ 1) it needs one sample of each in-neighbour, exactly k's; then it jumps. Until the
next sampling time it flies on what it knows. The agents of one host are kept as arrays, a row a
robot, and each owns the in-edges on which it hears; what is not on them it never sees.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bus.topology import Topology
from estimator_agents.algorithm import Algorithm
from estimator_agents.estimate import Disagreement, Estimate


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """The in-edges of some robots, sorted by (robot, in-neighbour)."""

    source: NDArray[np.intp]
    """(E,) the node that is heard."""
    row: NDArray[np.intp]
    """(E,) the row of the robot that hears."""
    start: NDArray[np.intp]
    """(rows,) where each row's edges begin; no row is without any."""
    weight: NDArray[np.float64]
    """(E, 1) w_ij / ϖ_i."""

    @classmethod
    def into(cls, robots: NDArray[np.integer], topology: Topology) -> "Edges":
        """Return the in-edges of robots (rows,), ascending."""
        mine = np.isin(topology.sink, robots)
        row = np.searchsorted(robots, topology.sink[mine])
        start = np.searchsorted(row, np.arange(len(robots)))
        return cls(topology.source[mine], row, start, topology.normalised[mine, None])


class Agents:
    """The estimator agents of one host.

    `estimate` holds, for the time `t_k` they last jumped at, ε_i(t_k⁺) and υ_i(t_k⁺), (rows, m).
    """

    def __init__(
        self,
        robots: NDArray[np.integer],
        topology: Topology,
        algorithm: Algorithm,
        initial: Estimate,
    ) -> None:
        self.robots = robots
        self.estimate = initial
        self._algorithm = algorithm
        self._edges = Edges.into(robots, topology)
        self.in_neighbours = np.unique(self._edges.source)
        m = initial.position.shape[1]
        self._position = np.zeros((topology.n + 1, m))
        self._velocity = np.zeros((topology.n + 1, m))
        self._heard_at = np.zeros(topology.n + 1, np.int64)

    def hear(
        self,
        k: int,
        nodes: NDArray[np.integer],
        position: NDArray[np.float64],
        velocity: NDArray[np.float64],
    ) -> None:
        """Take the samples of k from some nodes: (s,) node numbers, (s, m) left limits."""
        self._position[nodes] = position
        self._velocity[nodes] = velocity
        self._heard_at[nodes] = k

    def missing(self, k: int) -> list[int]:
        """Return the in-neighbours of whom no sample of k was heard yet, ascending."""
        late = self._heard_at[self.in_neighbours] != k
        return [int(node) for node in self.in_neighbours[late]]

    def heard_by(self, robot: int) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Return what one robot heard last: position and velocity, (m,), by in-neighbour."""
        edges = self._edges
        mine = edges.source[edges.row == np.searchsorted(self.robots, robot)]
        return {int(j): (self._position[j].copy(), self._velocity[j].copy()) for j in mine}

    def jump(self, left: Estimate) -> None:
        """Jump at a sampling time, from the left limits there; all must have been heard."""
        edges = self._edges
        self.estimate = self._algorithm.jump(
            left,
            Disagreement(
                self._sum(self._position[edges.source] - left.position[edges.row]),
                self._sum(self._velocity[edges.source] - left.velocity[edges.row]),
            ),
        )

    def _sum(self, differences: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return Σ_j w_ij/ϖ_i (x_j − x_i) for each row: an order that depends on the row alone."""
        total: NDArray[np.float64] = np.add.reduceat(
            self._edges.weight * differences, self._edges.start, axis=0
        )
        return total
