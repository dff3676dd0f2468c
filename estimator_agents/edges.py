"""The in-edges over which some robots receive, in one digraph, sorted by (robot, in-neighbour)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.links.links import Links
from nrs_cosim.bus.summation import Summation
from nrs_cosim.bus.topologies import TopologySchedule, edges_among
from nrs_cosim.bus.topology import Topology

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """E in-edges of some robots, a row a robot."""

    source: Indices
    """(E,) the node that sends."""
    row: Indices
    """(E,) the row of the robot that receives."""
    start: Indices
    """(rows,) where each row's edges begin."""
    sums: Summation
    """Over each row's edges."""
    weight: Array
    """(E, 1) w_ij / ϖ_i."""
    place: Indices
    """(E,) which each is of all in-edges that these robots ever have."""
    buffered: Indices
    """(G,) which of the edges go through the receive buffer."""
    link: Indices
    """(G,) the number of each of them among the links of the buffer."""
    pinned: NDArray[np.bool_]
    """(rows,) who receives from the target."""
    out_degree: Array
    """(rows, 1) how many receive from each robot, wherever these are."""

    @classmethod
    def into(
        cls, robots: NDArray[np.integer], topology: Topology, union: Topology, links: Links | None
    ) -> "Edges":
        """Return the in-edges of robots (rows,), ascending; `union` has all that there ever are."""
        mine = np.isin(topology.sink, robots)
        source, sink = topology.source[mine], topology.sink[mine]
        row = np.searchsorted(robots, sink)
        start = np.searchsorted(row, np.arange(len(robots)))
        buffered = link = np.zeros(0, np.intp)
        if links:
            edge = edges_among(topology, links.source, links.sink)
            link = np.flatnonzero(edge >= 0)
            buffered = np.searchsorted(np.flatnonzero(mine), edge[link])
        kept = np.flatnonzero(np.isin(union.sink, robots))
        place = np.searchsorted(kept, edges_among(union, source, sink))
        pinned = np.zeros(len(robots), bool)
        pinned[row[source == 0]] = True
        degree = np.bincount(topology.source, minlength=topology.n + 1)[robots]
        weight = topology.normalised[mine, None]
        sums = Summation(start, len(source))
        out_degree = degree.astype(float)[:, None]
        return cls(source, row, start, sums, weight, place, buffered, link, pinned, out_degree)


def field_sizes(topologies: TopologySchedule, m: int) -> Sizes:
    """Return what the symbols of shapes stand for; the in-degree is the largest at any t_k."""
    in_degree = max(int(np.bincount(topology.sink).max()) for topology in topologies.digraphs)
    return Sizes(m, topologies.n, in_degree)
