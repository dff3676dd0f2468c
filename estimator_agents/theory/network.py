"""Who depends on whom: the condensation of the digraph, and how the target comes to all (A2).

The strongly connected components of the robots, with the edges between them, are a digraph without
cycles. A2 holds if and only if each component that receives from no other has a
robot that receives the target.
"""

from dataclasses import dataclass

import numpy as np

from nrs_cosim.bus.topology import Topology


@dataclass(frozen=True, slots=True)
class NetworkSummary:
    """The digraph in short."""

    D: tuple[tuple[int, int, float], ...]
    """(i, j, D_ij), by row, where D_ij is not 0: the normalised weight of j at i."""
    pinned: tuple[int, ...]
    """The robots that receive the target, ascending."""
    components: tuple[tuple[int, ...], ...]
    """The robots of each strongly connected component, senders before receivers."""
    edges: tuple[tuple[int, int], ...]
    """(j, i), components by number from 0: somebody in i receives from somebody in j."""
    depth: int
    """The longest of the shortest ways from the target to a robot, in edges."""
    spanning_tree: bool
    """A2: a directed path leads from the target to every robot."""


def network_of(topology: Topology) -> NetworkSummary:
    """Return a digraph in short."""
    parts = topology.components()
    label = np.empty(topology.n, np.intp)
    for number, part in enumerate(parts):
        label[part] = number
    among = topology.source > 0
    source, sink = label[topology.source[among] - 1], label[topology.sink[among] - 1]
    pairs = {(j, i) for j, i in zip(source.tolist(), sink.tolist(), strict=True) if j != i}
    between = np.array(sorted(pairs), np.intp).reshape(-1, 2)
    rank = _ranks(len(parts), between)
    order = np.lexsort(([part[0] for part in parts], rank))
    place = np.empty(len(parts), np.intp)
    place[order] = np.arange(len(parts))
    edges = sorted(place[between].tolist())
    steps = topology.steps()
    weights = topology.normalised[among]
    rows = zip(topology.sink[among], topology.source[among], weights, strict=True)
    return NetworkSummary(
        D=tuple(sorted((int(i), int(j), float(d)) for i, j, d in rows)),
        pinned=tuple(topology.pinned.tolist()),
        components=tuple(tuple((np.sort(parts[p]) + 1).tolist()) for p in order),
        edges=tuple((int(j), int(i)) for j, i in edges),
        depth=int(steps.max()),
        spanning_tree=bool((steps >= 0).all()),
    )


def _ranks(count: int, edges: np.ndarray) -> np.ndarray:
    """Return how many edges the longest way to each component has, (count,), without cycles."""
    rank = np.zeros(count, np.intp)
    waits = np.bincount(edges[:, 1], minlength=count)
    receivers = np.split(edges[:, 1], np.searchsorted(edges[:, 0], np.arange(1, count)))
    ready = np.flatnonzero(waits == 0).tolist()
    while ready:
        j = ready.pop()
        for i in receivers[j]:
            rank[i] = max(rank[i], rank[j] + 1)
            waits[i] -= 1
            if not waits[i]:
                ready.append(int(i))
    return rank
