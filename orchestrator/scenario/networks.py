"""A scenario's network, in whichever form it is given, is digraphs, each a list of edges.

Forms of a digraph: `adjacency` with `pinning`, dense; `generator`, by rule; `edge_list`, edge by
edge, which is also what `edges` and `graphml` become when a scenario is resolved. A network is
one digraph, or two, `position` and `velocity`, or `switching`, a list of these by phases.
"""

from bisect import insort

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.random_streams import random_stream
from nrs_cosim.bus.topologies import InteractionGraphs, TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.orchestrator.scenario.tables.networks import (
    Digraph,
    Edge,
    Generator,
    InteractionTable,
    Network,
)

Nodes = NDArray[np.intp]
REWIRE = 0.1
"""The part of a small world's edges that go elsewhere, unless it is given."""


def generated(generator: Generator, seed: int, where: str = "network") -> tuple[Nodes, Nodes]:
    """Return source and sink, (E,), of all edges, those from the target first.

    `where` the generator stands in the scenario is part of the key of what it draws. A directed
    path leads from the first pinned robot to every other, by construction:
    - ring: robot i receives from i − 1, and robot 1 receives from n;
    - path: robot i > 1 receives from i − 1; star: all receive from robot 1. Robot 1 must be pinned;
    - random_k_in: robots are ranked in the order of their numbers from the first that is pinned,
      round through n. Each receives from k others, one of them drawn from those of lower rank, the
      others from all: by induction over the ranks, a path leads from the first to each;
    - small_world: a ring lattice of k neighbours on each side, both ways. Of the edges i – i + d
      those with d = 1 stay, which hold all robots together; each other one, with probability
      `rewire`, goes from i to a robot that i has no edge with (after Watts and Strogatz, Nature
      393, 1998).
    """
    n = generator.n
    robots = np.arange(1, n + 1)
    match generator.kind:
        case "ring":
            among = np.roll(robots, 1), robots
        case "path":
            among = robots[:-1], robots[1:]
        case "star":
            among = np.ones(n - 1, np.intp), robots[1:]
        case "random_k_in":
            among = _random_k_in(generator, seed, where)
        case "small_world":
            among = _small_world(generator, seed, where)
    pinned = np.array(generator.pinned, np.intp)
    return (
        np.concatenate([np.zeros(len(pinned), np.intp), among[0]]),
        np.concatenate([pinned, among[1]]),
    )


def _random_k_in(generator: Generator, seed: int, where: str) -> tuple[Nodes, Nodes]:
    """Return n k edges; ranks count from 0."""
    n, k, first = generator.n, generator.k or 0, generator.pinned[0]
    received = np.empty((n, k), np.intp)
    for rank in range(n):
        draw = random_stream(seed, f"{where}.random_k_in", (first - 1 + rank) % n + 1)
        taken = [rank]
        if rank:
            received[rank, 0] = draw.integers(rank)
            insort(taken, int(received[rank, 0]))
        rest = draw.choice(n - len(taken), k + 1 - len(taken), replace=False)
        for other in taken:  # ascending: what is drawn counts the robots that are not taken
            rest += rest >= other
        received[rank, len(taken) - 1 :] = rest
    sink = np.repeat(np.arange(n), k)
    return (first - 1 + received.ravel()) % n + 1, (first - 1 + sink) % n + 1


def _small_world(generator: Generator, seed: int, where: str) -> tuple[Nodes, Nodes]:
    """Return 2 n k edges: n k, both ways."""
    n, k = generator.n, generator.k or 0
    rewire = REWIRE if generator.rewire is None else generator.rewire
    near = [*range(-k, 0), *range(1, k + 1)]
    beside = [{(i + d) % n for d in near} for i in range(n)]
    for i in range(n if rewire else 0):
        draw = random_stream(seed, f"{where}.small_world", i + 1)
        for d, luck in zip(range(2, k + 1), draw.random(k - 1), strict=True):
            free = n - 1 - len(beside[i])
            if luck >= rewire or not free:
                continue
            other = int(draw.integers(free))
            for taken in sorted({i, *beside[i]}):
                other += other >= taken
            old = (i + d) % n
            beside[i].remove(old)
            beside[old].remove(i)
            beside[i].add(other)
            beside[other].add(i)
    pairs = np.array([(j, i) for i in range(n) for j in sorted(beside[i])], np.intp).reshape(-1, 2)
    return pairs[:, 0] + 1, pairs[:, 1] + 1


def topologies_of(network: Network, seed: int) -> TopologySchedule:
    """Return who receives from whom, and when; arrays of a topology cannot be written."""
    exchanges = []
    for where, given in phases_of(network):
        digraphs = [_topology(digraph, seed, here) for here, digraph in digraphs_of(where, given)]
        exchanges.append(InteractionGraphs(digraphs[0], digraphs[-1]))
    since = [phase.from_ for phase in network.switching or ()]
    return TopologySchedule.of(exchanges, since or (1,), network.repeat)


def _topology(digraph: Digraph, seed: int, where: str) -> Topology:
    if digraph.generator:
        source, sink = generated(digraph.generator, seed, where)
        weight = np.full(len(source), digraph.generator.weight)
        topology = Topology.of_edges(digraph.n, source, sink, weight)
    elif digraph.edge_list:
        nodes = np.array([edge[:2] for edge in digraph.edge_list], np.intp)
        weight = np.array([_weight(edge) for edge in digraph.edge_list])
        topology = Topology.of_edges(digraph.n, nodes[:, 0], nodes[:, 1], weight)
    else:
        topology = Topology.of(digraph.adjacency or (), digraph.pinning or ())
    for shared in (topology.source, topology.sink, topology.weight):
        shared.flags.writeable = False
    return topology


def _weight(edge: Edge) -> float:
    return edge[2] if len(edge) == 3 else 1.0


def phases_of(network: Network) -> list[tuple[str, InteractionTable]]:
    """Return what holds by phase, and where it stands in the scenario."""
    if network.switching is None:
        return [("network", network)]
    return [(f"network.switching[{i}]", phase) for i, phase in enumerate(network.switching)]


def digraphs_of(where: str, given: InteractionTable) -> list[tuple[str, Digraph]]:
    """Return the one digraph of an exchange, or its two, and where each stands."""
    if given.position is None or given.velocity is None:
        return [(where, given)]
    return [(f"{where}.position", given.position), (f"{where}.velocity", given.velocity)]


def hetero_at(network: Network) -> str:
    """Return where positions and velocities first have digraphs of their own; empty for nowhere."""
    apart = (where for where, given in phases_of(network) if len(digraphs_of(where, given)) == 2)
    return next(apart, "")
