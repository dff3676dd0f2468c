"""A scenario's network, in whichever form it is given, is digraphs, each a list of edges.

Forms of a digraph: `adjacency` with `pinning`, dense; `generator`, by rule; `edge_list`, edge by
edge, which is also what `edges` and `graphml` become when a scenario is resolved. A network is
one digraph, or two, `position` and `velocity`, or `switching`, a list of these by turns.
"""

import numpy as np

from nrs_cosim.bus.topologies import InteractionGraphs, TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.orchestrator.scenario.generators import generated
from nrs_cosim.orchestrator.scenario.tables.networks import Digraph, Edge, InteractionTable, Network


def topologies_of(network: Network, seed: int) -> TopologySchedule:
    """Return who hears whom, and when; arrays of a topology cannot be written."""
    exchanges = []
    for where, given in phases_of(network):
        digraphs = [_topology(digraph, seed, here) for here, digraph in digraphs_of(where, given)]
        exchanges.append(InteractionGraphs(digraphs[0], digraphs[-1]))
    since = [turn.from_ for turn in network.switching or ()]
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
    """Return what holds in turn, and where it stands in the scenario."""
    if network.switching is None:
        return [("network", network)]
    return [(f"network.switching[{i}]", turn) for i, turn in enumerate(network.switching)]


def digraphs_of(where: str, given: InteractionTable) -> list[tuple[str, Digraph]]:
    """Return the one digraph of an exchange, or its two, and where each stands."""
    if given.position is None or given.velocity is None:
        return [(where, given)]
    return [(f"{where}.position", given.position), (f"{where}.velocity", given.velocity)]


def hetero_at(network: Network) -> str:
    """Return where positions and velocities first have digraphs of their own; empty for nowhere."""
    apart = (where for where, given in phases_of(network) if len(digraphs_of(where, given)) == 2)
    return next(apart, "")
