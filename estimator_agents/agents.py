"""An agent takes the samples of its in-neighbours in and gives its own out; no bus is inside.

At t_k (k ≥ 1) it needs one sample of each in-neighbour, exactly k's; then it jumps. Until the
next sampling time it flies on what it knows. The agents of one host are kept as arrays, a row a
robot, and each owns the in-edges on which it hears; what is not on them it never sees.

Where links have faults, an agent goes by what its links deliver, if they do. It sums over the
in-neighbours of whom it has a sample, with their weights divided by what these add up to; with
none it does not jump. A robot in an outage hears nothing, and jumps by what it heard last if it
holds.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bus.errors import InputError
from bus.links.links import Links
from bus.messages import FAULT, Codec
from bus.topology import Topology
from estimator_agents.algorithm import Algorithm
from estimator_agents.estimate import Disagreement, Estimate
from estimator_agents.hearing import Hearing, Missing


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
    `links` are those of the same robots that have faults, and `missing` says what an agent does
    where they deliver nothing; without `links` everything is heard when it is said.
    """

    def __init__(
        self,
        robots: NDArray[np.integer],
        topology: Topology,
        algorithm: Algorithm,
        initial: Estimate,
        links: Links | None = None,
        missing: Missing = "hold",
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
        self._hearing = Hearing(links, robots, m, missing) if links else None
        self._no_faults = Codec(FAULT, m).blank(np.array([], np.intp))

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
        """Return the in-neighbours of whom no sample of k came yet though they send, ascending."""
        late = self.in_neighbours[self._heard_at[self.in_neighbours] != k]
        if self._hearing and len(late):
            late = np.setdiff1d(late, self.silent(k))
        return [int(node) for node in late]

    def silent(self, k: int) -> list[int]:
        """Return the robots, of all that there are, that send nothing at t_k, ascending."""
        return self._hearing.links.silent(k) if self._hearing else []

    @property
    def faulty(self) -> list[int]:
        """The robots here into which a link has faults, ascending."""
        return np.unique(self._hearing.links.sink).tolist() if self._hearing else []

    @property
    def faults(self) -> NDArray[np.void]:
        """What befell the samples of the last jump on their way here: records of `FAULT`."""
        return self._hearing.faults if self._hearing else self._no_faults

    def memory(self, row: int) -> bytes:
        """Return what a robot heard over links with faults, and what is under way to it there.

        Little-endian doubles, the same for every partition of the robots; empty without faults.
        """
        return self._hearing.memory(int(self.robots[row])) if self._hearing else b""

    def recall(self, row: int, memory: bytes) -> None:
        """Take up the memory that a robot had elsewhere; `InputError` when it is not of its links.

        Its next jump must then be the one after that memory.
        """
        robot = int(self.robots[row])
        if self._hearing:
            self._hearing.recall(robot, memory)
        elif memory:
            raise InputError(
                f"the memory of robot {robot} has {len(memory)} bytes, and without faults none "
                f"were expected; give one that was kept under the same faults"
            )

    def heard_by(self, robot: int) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Return what one robot was last told: position and velocity, (m,), by in-neighbour."""
        edges = self._edges
        mine = edges.source[edges.row == np.searchsorted(self.robots, robot)]
        return {int(j): (self._position[j].copy(), self._velocity[j].copy()) for j in mine}

    def jump(self, k: int, left: Estimate) -> None:
        """Jump at t_k, k after k, from the left limits there; none may be `missing`."""
        edges = self._edges
        position, velocity = self._position[edges.source], self._velocity[edges.source]
        weights, rest = edges.weight, None
        if self._hearing:
            faulty = self._hearing.links.faulty
            self._hearing.take(k, np.stack([position[faulty], velocity[faulty]], axis=1))
            position[faulty], velocity[faulty] = self._hearing.values.swapaxes(0, 1)
            weights, rest = self._shares(self._hearing)
        self.estimate = self._algorithm.jump(
            left,
            Disagreement(
                self._sum(weights, rest, position - left.position[edges.row]),
                self._sum(weights, rest, velocity - left.velocity[edges.row]),
            ),
        )

    def _shares(self, hearing: Hearing) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        """Return the weights (E, 1) of what is there, else 0, and what each row's is divided by.

        A row that has all, or nothing, is divided by 1; the divisor is None when all have all.
        """
        if hearing.there.all():
            return self._edges.weight, None
        there = np.ones(len(self._edges.source), bool)
        there[hearing.links.faulty] = hearing.there
        weights = np.where(there[:, None], self._edges.weight, 0)
        rest = np.add.reduceat(weights, self._edges.start, axis=0)
        whole = np.logical_and.reduceat(there, self._edges.start)[:, None]
        return weights, np.where(whole | (rest == 0), 1, rest)

    def _sum(
        self,
        weights: NDArray[np.float64],
        rest: NDArray[np.float64] | None,
        differences: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return Σ_j w_ij/ϖ_i (x_j − x_i) for each row: an order that depends on the row alone."""
        total: NDArray[np.float64] = np.add.reduceat(
            weights * differences, self._edges.start, axis=0
        )
        return total if rest is None else total / rest
