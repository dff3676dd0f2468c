"""Who receives from whom at t_k: digraphs by phase, and one for positions apart from velocities'.

Entry e holds from tick since[e] on, until the next does; the last one for ever or, where the
phases repeat after T ticks, up to T, and tick k is then as tick (k − 1) mod T + 1. A sample carries
position and velocity: it travels at t_k over each edge that either digraph of t_k has, and a robot
takes of it what its own digraphs have the edge for.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.topology import Topology


@dataclass(frozen=True, slots=True, eq=False)
class InteractionGraphs:
    """Over which digraph positions are received, and over which velocities; mostly they are one."""

    position: Topology
    velocity: Topology

    @classmethod
    def of(cls, topology: Topology) -> "InteractionGraphs":
        """Return what receives both over one digraph."""
        return cls(topology, topology)

    @property
    def has_two_digraphs(self) -> bool:
        """Whether there are two digraphs: sampled hetero-information."""
        return self.position is not self.velocity


@dataclass(frozen=True, slots=True, eq=False)
class TopologySchedule:
    """The exchanges of a run, and when each holds."""

    exchanges: tuple[InteractionGraphs, ...]
    since: tuple[int, ...]
    """The tick from which each holds, ascending from 1."""
    repeat: int | None
    """After how many ticks the phases come again; None where the last one stays."""
    links: Topology
    """The edges that some digraph has, each with its largest weight."""

    @classmethod
    def of(
        cls,
        exchanges: Sequence[InteractionGraphs],
        since: Sequence[int] = (1,),
        repeat: int | None = None,
    ) -> "TopologySchedule":
        """Return exchanges of the same n robots in turn."""
        return cls(tuple(exchanges), tuple(since), repeat, united(_digraphs(exchanges)))

    @classmethod
    def constant(cls, topology: Topology) -> "TopologySchedule":
        """Return one digraph for all, at all times."""
        return cls.of([InteractionGraphs.of(topology)])

    @property
    def n(self) -> int:
        """The number of robots."""
        return self.links.n

    @property
    def digraphs(self) -> list[Topology]:
        """All digraphs, each once."""
        return _digraphs(self.exchanges)

    @property
    def is_constant(self) -> bool:
        """Whether one exchange holds at all times."""
        return len(self.exchanges) == 1

    @property
    def switching(self) -> bool:
        """Whether the phases change for ever."""
        return self.repeat is not None and not self.is_constant

    def at(self, k: int) -> int:
        """Return which exchange holds at t_k, k ≥ 1, from 0."""
        tick = (k - 1) % self.repeat + 1 if self.repeat else k
        return bisect_right(self.since, tick) - 1

    def pinned(self, k: int) -> NDArray[np.integer]:
        """Return the robots that receive from the target at t_k, k ≥ 1: (p,), ascending."""
        exchange = self.exchanges[self.at(k)]
        return united(_digraphs([exchange])).pinned

    @property
    def ever_pinned(self) -> NDArray[np.integer]:
        """(p,) the robots that receive from the target at some t_k, ascending."""
        return self.links.pinned

    def edges_until(self, ticks: int) -> int:
        """Return over how many edges samples travel at t_1 … t_ticks, in all."""
        edges = [len(united(_digraphs([exchange])).source) for exchange in self.exchanges]

        def within(last: int) -> int:
            """Of the ticks 1 … last of a turn."""
            ends = (*self.since[1:], last + 1)
            spans = zip(edges, self.since, ends, strict=True)
            return sum(count * max(min(end, last + 1) - first, 0) for count, first, end in spans)

        turns, rest = divmod(ticks, self.repeat) if self.repeat else (0, ticks)
        return turns * within(self.repeat or 0) + within(rest)

    def phases(self) -> list[tuple[int, int]]:
        """Return exchange and number of ticks of each turn of one period, in order."""
        if not self.repeat:
            return []
        ends = (*self.since[1:], self.repeat + 1)
        return [(e, end - self.since[e]) for e, end in enumerate(ends)]


def _digraphs(exchanges: Sequence[InteractionGraphs]) -> list[Topology]:
    return [*dict.fromkeys(t for e in exchanges for t in (e.position, e.velocity))]


def united(topologies: Sequence[Topology]) -> Topology:
    """Return the digraph of all edges of some of the same robots, each with its largest weight."""
    if len(topologies) == 1:
        return topologies[0]
    source, sink, weight = (
        np.concatenate([getattr(topology, name) for topology in topologies])
        for name in ("source", "sink", "weight")
    )
    # Of the same edge in several digraphs the heaviest comes first, and it is the first that stays.
    order = np.lexsort((-weight, source, sink))
    source, sink, weight = source[order], sink[order], weight[order]
    first = np.append(True, (np.diff(source) != 0) | (np.diff(sink) != 0))
    return Topology(topologies[0].n, source[first], sink[first], weight[first])


def edges_among(
    topology: Topology, source: NDArray[np.integer], sink: NDArray[np.integer]
) -> NDArray[np.intp]:
    """Return the number of each edge (j, i) in a digraph, (…) as given; −1 where it has none."""
    nodes = topology.n + 1
    keys = topology.sink * nodes + topology.source  # which ascend, as the edges are sorted
    wanted = sink * nodes + source
    # What is beyond the last key is compared with that one, and is another.
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[at] == wanted, at, -1)
