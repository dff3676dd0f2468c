"""An agent takes the samples of its in-neighbours in and gives its own out; no bus is inside.

At t_k (k ≥ 1) it needs one sample of each in-neighbour, exactly k's; then it jumps. Until the
next sampling time it flies on what it knows. The agents of one worker are kept as arrays, a row a
robot, and each owns the in-edges on which it hears; what is not on them it never sees. Where the
digraphs take turns, a sample is taken in from whoever is ever heard, and summed over the edges of
t_k alone.

Where links have faults, an agent goes by what its links deliver, if they do. It sums over the
in-neighbours of whom it has a sample, with their weights divided by what these add up to; with
none it jumps as if all agreed. A robot in an outage hears nothing, and jumps by what it heard last
if it holds.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.links.links import Links
from nrs_cosim.bus.messages import LINK_EVENT, Codec
from nrs_cosim.bus.topologies import TopologySchedule, edges_among
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Algorithm, name_of
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate
from nrs_cosim.estimator_agents.receive_buffer import Hearing, Missing

Array = NDArray[np.float64]
Shares = tuple[Array, Array | None]
"""The weights of what there is to sum, (E, 1), and what each row's sum is divided by, (rows, 1)."""


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """The in-edges of some robots in one digraph, sorted by (robot, in-neighbour)."""

    source: NDArray[np.intp]
    """(E,) the node that is heard."""
    row: NDArray[np.intp]
    """(E,) the row of the robot that hears."""
    start: NDArray[np.intp]
    """(rows,) where each row's edges begin; no row is without any."""
    weight: Array
    """(E, 1) w_ij / ϖ_i."""
    faulty: NDArray[np.intp]
    """(G,) which of the edges have faults."""
    link: NDArray[np.intp]
    """(G,) the number of each of them among all links that have faults."""

    @classmethod
    def into(cls, robots: NDArray[np.integer], topology: Topology, links: Links | None) -> "Edges":
        """Return the in-edges of robots (rows,), ascending."""
        mine = np.isin(topology.sink, robots)
        source, sink = topology.source[mine], topology.sink[mine]
        row = np.searchsorted(robots, sink)
        start = np.searchsorted(row, np.arange(len(robots)))
        faulty = link = np.zeros(0, np.intp)
        if links:
            edge = edges_among(topology, links.source, links.sink)
            link = np.flatnonzero(edge >= 0)
            faulty = np.searchsorted(np.flatnonzero(mine), edge[link])
        return cls(source, row, start, topology.normalised[mine, None], faulty, link)


class Agents:
    """The estimator agents of one worker.

    `estimate` holds, for the time `t_k` they last jumped at, ε_i(t_k⁺) and υ_i(t_k⁺), (rows, m).
    `links` are those of the same robots that have faults, and `missing` says what an agent does
    where they deliver nothing; without `links` everything is heard when it is said.
    """

    def __init__(
        self,
        robots: NDArray[np.integer],
        topologies: TopologySchedule,
        algorithm: Algorithm,
        initial: Estimate,
        links: Links | None = None,
        missing: Missing = "hold",
    ) -> None:
        self.robots = robots
        self.estimate = initial
        self._algorithm = algorithm
        self._exchange_at = topologies.at
        into = {t: Edges.into(robots, t, links) for t in topologies.digraphs}
        self._edges = [(into[e.position], into[e.velocity]) for e in topologies.exchanges]
        """Of positions and of velocities, by exchange."""
        self.in_neighbours = np.unique(np.concatenate([edges.source for edges in into.values()]))
        """Who is heard at some time, ascending."""
        m = initial.position.shape[1]
        self._position = np.zeros((topologies.n + 1, m))
        self._velocity = np.zeros((topologies.n + 1, m))
        self._heard_at = np.zeros(topologies.n + 1, np.int64)
        self._hearing = Hearing(links, robots, m, missing) if links else None
        self._no_events = Codec(LINK_EVENT, Sizes(m)).blank(np.array([], np.intp))

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
    def link_events(self) -> NDArray[np.void]:
        """What links did to the samples of the last jump: records of `LINK_EVENT`."""
        return self._hearing.link_events if self._hearing else self._no_events

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

    def heard_by(self, robot: int) -> dict[int, tuple[Array, Array]]:
        """Return what one robot was last told: position and velocity, (m,), by in-neighbour."""
        row = np.searchsorted(self.robots, robot)
        sources = [edges.source[edges.row == row] for both in self._edges for edges in both]
        heard = np.unique(np.concatenate(sources))
        return {int(j): (self._position[j].copy(), self._velocity[j].copy()) for j in heard}

    def jump(self, k: int, left: Estimate) -> None:
        """Jump at t_k, k after k, from the left limits there; none may be `missing`."""
        positions, velocities = self._edges[self._exchange_at(k)]
        position = self._position[positions.source]
        velocity = self._velocity[velocities.source]
        if self._hearing:
            source = self._hearing.links.source
            self._hearing.take(k, np.stack([self._position[source], self._velocity[source]], 1))
            delivered = self._hearing.values
            position[positions.faulty] = delivered[positions.link, 0]
            velocity[velocities.faulty] = delivered[velocities.link, 1]
        shares = self._shares(positions)
        apart = shares if velocities is positions else self._shares(velocities)
        self.estimate = self._algorithm.jump(
            left,
            Disagreement(
                _summed(positions, shares, position - left.position[positions.row]),
                _summed(velocities, apart, velocity - left.velocity[velocities.row]),
            ),
        )
        self._expect_finite(k)

    def _expect_finite(self, k: int) -> None:
        """Raise `AlgorithmError` for a jump that is no number: a plant would be blamed for it."""
        for values in (self.estimate.position, self.estimate.velocity):
            if not np.isfinite(values).all():
                row, joint = np.argwhere(~np.isfinite(values))[0]
                raise AlgorithmError(
                    f"algorithm {name_of(self._algorithm)}: jump returned {values[row, joint]} "
                    f"for robot {self.robots[row]} at tick {k}"
                )

    def _shares(self, edges: Edges) -> Shares:
        """Return the weights (E, 1) of what is there, else 0, and what each row's is divided by.

        A row that has all, or nothing, is divided by 1; the divisor is None when all have all.
        """
        hearing = self._hearing
        if hearing is None or hearing.there[edges.link].all():
            return edges.weight, None
        there = np.ones(len(edges.source), bool)
        there[edges.faulty] = hearing.there[edges.link]
        weights = np.where(there[:, None], edges.weight, 0)
        rest = np.add.reduceat(weights, edges.start, axis=0)
        whole = np.logical_and.reduceat(there, edges.start)[:, None]
        return weights, np.where(whole | (rest == 0), 1, rest)


def _summed(edges: Edges, shares: Shares, differences: Array) -> Array:
    """Return Σ_j w_ij/ϖ_i (x_j − x_i) for each row: an order that depends on the row alone."""
    weights, rest = shares
    total: Array = np.add.reduceat(weights * differences, edges.start, axis=0)
    return total if rest is None else total / rest
