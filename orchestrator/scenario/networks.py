"""A scenario's network, in whichever form it is given, is one digraph: a list of edges.

Forms: `adjacency` with `pinning`, dense; `generator`, by rule; `edge_list`, edge by edge, which is
also what `edges` and `graphml` become when a scenario's file is read. A scenario has one of them.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from math import isfinite

import numpy as np

from bus.topology import Topology
from orchestrator.scenario.generators import generated
from orchestrator.scenario.tables import Edge, Generator, Network, Scenario

MOST_EDGES = 10_000_000
SHOWN = 8
"""Robots that an error names at most."""
_WITH_K = ("random_k_in", "small_world")


def topology_of(scenario: Scenario) -> Topology:
    """Return who hears whom; the arrays of a topology are shared, and cannot be written."""
    return _topology(scenario.network, scenario.run.seed)


@lru_cache(maxsize=4)
def _topology(network: Network, seed: int) -> Topology:
    if network.generator:
        source, sink = generated(network.generator, seed)
        weight = np.full(len(source), network.generator.weight)
        topology = Topology.of_edges(network.n, source, sink, weight)
    elif network.edge_list:
        nodes = np.array([edge[:2] for edge in network.edge_list], np.intp)
        weight = np.array([_weight(edge) for edge in network.edge_list])
        topology = Topology.of_edges(network.n, nodes[:, 0], nodes[:, 1], weight)
    else:
        topology = Topology.of(network.adjacency or (), network.pinning or ())
    for shared in (topology.source, topology.sink, topology.weight):
        shared.flags.writeable = False
    return topology


def _weight(edge: Edge) -> float:
    return edge[2] if len(edge) == 3 else 1.0


def wrong_form(network: Network) -> str:
    """Return why it cannot be told who hears whom; empty where it can."""
    forms = network.forms
    if len(forms) != 1:
        got = " and ".join(forms) if forms else "none"
        return (
            f"network: expected one of adjacency (with pinning), generator, edge_list, edges and "
            f"graphml, got {got}; {'keep one of them' if forms else 'give one of them'}"
        )
    for name, other in (("adjacency", "pinning"), ("pinning", "adjacency")):
        if getattr(network, name) is None and getattr(network, other) is not None:
            return f"network.{name}: missing, it has no default beside network.{other}"
    (form,) = forms
    if form in {"edges", "graphml"}:
        return (
            f"network.{form}: a file is read when a scenario is read from a file of its own, and "
            f"this text is from elsewhere, got {getattr(network, form)!r}; give network.edge_list"
        )
    return ""


def wrong_network(scenario: Scenario) -> Iterator[str]:
    """Yield what is wrong with a network whose form is right."""
    network = scenario.network
    shape = [*_wrong_shape(network)]
    yield from shape
    if shape:
        return
    topology = topology_of(scenario)
    if network.adjacency is None:
        for row in np.flatnonzero(~np.isfinite(topology.in_degree))[:SHOWN]:
            yield (
                f"network.{network.forms[0]}: expected weights whose sum is a finite number, "
                f"but that of what robot {row + 1} hears is not; make them smaller"
            )
    unreached = topology.unreached()
    if unreached:
        more = f", … ({len(unreached)} robots)" if len(unreached) > SHOWN else ""
        yield (
            f"network: expected a spanning tree rooted at the target (assumption A2), but no path "
            f"leads from the target to robot {', '.join(map(str, unreached[:SHOWN]))}{more}; "
            f"let one of them hear the target ({_PINNED[network.forms[0]]}) or a robot that does"
        )


_PINNED = {
    "adjacency": "pinning",
    "generator": "network.generator.pinned",
    "edge_list": "an edge from 0",
}


def _wrong_shape(network: Network) -> Iterator[str]:
    if network.generator:
        yield from _wrong_generator(network.generator)
    elif network.edge_list:
        yield from _wrong_edges(network.edge_list)
    else:
        yield from _wrong_matrix(network.adjacency or (), network.pinning or ())


def _wrong_matrix(adjacency: Sequence[Sequence[float]], pinning: Sequence[float]) -> Iterator[str]:
    n = len(adjacency)
    lengths = {"network.pinning": len(pinning)}
    lengths |= {f"network.adjacency[{i}]": len(row) for i, row in enumerate(adjacency)}
    wrong = {where: length for where, length in lengths.items() if length != n}
    for where, length in wrong.items():
        yield f"{where}: expected {n} weights, got {length}"
    if wrong:
        return
    for i, (pin, row) in enumerate(zip(pinning, adjacency, strict=True)):
        if not isfinite(sum(row, pin)):
            yield f"network.adjacency[{i}]: expected weights whose sum is a finite number"
        if row[i]:
            yield f"network.adjacency[{i}][{i}]: expected 0, robot {i + 1} cannot hear itself"


def _wrong_edges(edges: Sequence[Edge]) -> Iterator[str]:
    first: dict[tuple[int, int], int] = {}
    for number, edge in enumerate(edges):
        source, sink = edge[:2]
        here = f"network.edge_list[{number}]"
        if source == sink:
            yield f"{here}: expected another source, robot {sink} cannot hear itself"
        before = first.setdefault((source, sink), number)
        if before != number:
            yield (
                f"{here}: the edge from {source} to {sink} has been given before, as "
                f"network.edge_list[{before}]; give it once, with the sum of the weights"
            )


def _wrong_generator(given: Generator) -> Iterator[str]:
    here, kind, n, k = "network.generator", given.kind, given.n, given.k
    if kind == "ring" and n < 2:
        yield f"{here}.n: expected at least 2 robots in a ring, got {n}"
    if kind not in _WITH_K:
        if k is not None:
            yield f"{here}.k: is of {' and '.join(_WITH_K)}, not of {kind}, got {k}; leave it out"
    elif k is None:
        yield f"{here}.k: missing, it has no default for {kind}"
    else:
        most = n - 1 if kind == "random_k_in" else (n - 1) // 2
        if k > most:
            yield f"{here}.k: expected at most {most} for {kind} of {n} robots, got {k}"
        elif n * k > MOST_EDGES:
            yield f"{here}.k: expected n k of at most {MOST_EDGES}, got {k} with n = {n}"
    yield from _wrong_rewire(given)
    for place, robot in enumerate(given.pinned):
        if robot > n:
            yield f"{here}.pinned[{place}]: expected 1 to {n}, got {robot}"
    if len(set(given.pinned)) < len(given.pinned):
        yield f"{here}.pinned: expected each robot once, got {list(given.pinned)}"


def _wrong_rewire(given: Generator) -> Iterator[str]:
    here, kind, k = "network.generator", given.kind, given.k
    if given.rewire is not None:
        if kind != "small_world":
            yield f"{here}.rewire: is of small_world, not of {kind}, got {given.rewire:g}"
        elif k == 1 and given.rewire:
            yield (
                f"{here}.rewire: expected 0 with k = 1, for the nearest neighbours stay, "
                f"got {given.rewire:g}; take a larger k"
            )
