"""What may be wrong with a scenario's network: its form, its phases, its digraphs, and A2 for each.

A2 is asked of every digraph, as the paper has it: a spanning tree rooted at the target at each t_k.
"""

from collections.abc import Iterator, Sequence
from math import isfinite

import numpy as np

from nrs_cosim.bus.plurals import count_of, numbered
from nrs_cosim.bus.topology import Topology
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.networks import digraphs_of, phases_of
from nrs_cosim.orchestrator.scenario.tables.networks import Digraph, Edge, Generator, Network

MOST_EDGES = 10_000_000
SHOWN = 8
"""Robots that an error names at most."""
_WITH_K = ("random_k_in", "small_world")
_FORMS = "adjacency (with pinning), generator, edge_list, edges"


def wrong_form(network: Network) -> str:
    """Return why it cannot be told who receives from whom, and when; empty where it can."""
    return next(_wrong_forms(network), "")


def _wrong_forms(network: Network) -> Iterator[str]:
    forms = f"{_FORMS}, graphml, position (with velocity) and switching"
    yield from _wrong_choice("network", network, forms)
    if network.switching is None and network.repeat is not None:
        yield f"network.repeat: is of network.switching, got {network.repeat}; leave it out"
    for where, given in phases_of(network):
        if network.switching is not None:
            yield from _wrong_choice(
                where, given, f"{_FORMS}, graphml and position (with velocity)"
            )
        for name, other in (("position", "velocity"), ("velocity", "position")):
            if getattr(given, name) is None and getattr(given, other) is not None:
                yield f"{where}.{name}: missing, it has no default beside {where}.{other}"
        for here, digraph in digraphs_of(where, given):
            if digraph is not given:
                yield from _wrong_choice(here, digraph, f"{_FORMS} and graphml")
            yield from _wrong_digraph_form(here, digraph)


def _wrong_choice(where: str, given: Digraph, forms: str) -> Iterator[str]:
    if len(given.forms) != 1:
        got = " and ".join(given.forms) or "none"
        act = "keep one of them" if given.forms else "give one of them"
        yield f"{where}: expected one of {forms}, got {got}; {act}"


def _wrong_digraph_form(where: str, digraph: Digraph) -> Iterator[str]:
    for name, other in (("adjacency", "pinning"), ("pinning", "adjacency")):
        if getattr(digraph, name) is None and getattr(digraph, other) is not None:
            yield f"{where}.{name}: missing, it has no default beside {where}.{other}"


def wrong_network(experiment: Experiment) -> Iterator[str]:
    """Yield what is wrong with a network whose form is right."""
    network = experiment.scenario.network
    yield from _wrong_phases(network)
    digraphs = [pair for where, given in phases_of(network) for pair in digraphs_of(where, given)]
    shapes = [wrong for where, digraph in digraphs for wrong in _wrong_shape(where, digraph)]
    yield from shapes
    if shapes:
        return
    others = [(where, digraph.n) for where, digraph in digraphs if digraph.n != network.n]
    for where, n in others:
        yield f"{where}: expected {network.n} robots, as {digraphs[0][0]} has, got {n}"
    if others:
        return
    topologies = [
        topology
        for exchange in experiment.topologies.exchanges
        for topology in dict.fromkeys((exchange.position, exchange.velocity))
    ]
    for (where, digraph), topology in zip(digraphs, topologies, strict=True):
        yield from _wrong_topology(where, digraph, topology)


def _wrong_phases(network: Network) -> Iterator[str]:
    phases = network.switching or ()
    for i, phase in enumerate(phases):
        here, before = f"network.switching[{i}].from", phases[i - 1].from_
        if i == 0 and phase.from_ != 1:
            yield f"{here}: expected 1, the first tick, in the first entry, got {phase.from_}"
        elif i and phase.from_ <= before:
            yield f"{here}: expected more than {before}, as entries follow, got {phase.from_}"
    if phases and network.repeat is not None and network.repeat < phases[-1].from_:
        yield (
            f"network.repeat: expected at least {phases[-1].from_}, where the last entry begins, "
            f"got {network.repeat}"
        )


def unused_phases(experiment: Experiment) -> Iterator[str]:
    """Yield which phases a run ends before, where its network and its times are right."""
    ticks = experiment.clock.ticks
    for i, phase in enumerate(experiment.scenario.network.switching or ()):
        if phase.from_ > ticks:
            yield (
                f"network.switching[{i}].from: expected at most {ticks}, the last tick of the run, "
                f"got {phase.from_}; leave the entry out, or make run.duration longer"
            )


def _wrong_topology(where: str, digraph: Digraph, topology: Topology) -> Iterator[str]:
    (form,) = digraph.forms
    if digraph.adjacency is None:
        for row in np.flatnonzero(~np.isfinite(topology.in_degree))[:SHOWN]:
            yield (
                f"{where}.{form}: expected weights whose sum is a finite number, "
                f"but that of what robot {row + 1} receives is not; make them smaller"
            )
    unreached = topology.unreached()
    if unreached:
        more = f" ({count_of(len(unreached), 'robot')})" if len(unreached) > SHOWN else ""
        pinned = {"adjacency": "pinning", "generator": f"{where}.generator.pinned"}
        yield (
            f"{where}: expected a spanning tree rooted at the target (assumption A2), but no path "
            f"leads from the target to {numbered('robot', unreached, SHOWN)}{more}; let "
            f"one of them receive from the target ({pinned.get(form, 'an edge from 0')}) "
            f"or from a robot that does"
        )


def _wrong_shape(where: str, digraph: Digraph) -> Iterator[str]:
    if digraph.generator:
        yield from _wrong_generator(f"{where}.generator", digraph.generator)
    elif digraph.edge_list:
        yield from _wrong_edges(f"{where}.edge_list", digraph.edge_list)
    else:
        yield from _wrong_matrix(where, digraph.adjacency or (), digraph.pinning or ())


def _wrong_matrix(
    where: str, adjacency: Sequence[Sequence[float]], pinning: Sequence[float]
) -> Iterator[str]:
    n = len(adjacency)
    lengths = {f"{where}.pinning": len(pinning)}
    lengths |= {f"{where}.adjacency[{i}]": len(row) for i, row in enumerate(adjacency)}
    wrong = {here: length for here, length in lengths.items() if length != n}
    for here, length in wrong.items():
        yield f"{here}: expected {n} weights, got {length}"
    if wrong:
        return
    for i, (pin, row) in enumerate(zip(pinning, adjacency, strict=True)):
        if not isfinite(sum(row, pin)):
            yield f"{where}.adjacency[{i}]: expected weights whose sum is a finite number"
        if row[i]:
            here = f"{where}.adjacency[{i}][{i}]"
            yield f"{here}: expected 0, robot {i + 1} cannot receive from itself"


def _wrong_edges(where: str, edges: Sequence[Edge]) -> Iterator[str]:
    first: dict[tuple[int, int], int] = {}
    for number, edge in enumerate(edges):
        source, sink = edge[:2]
        here = f"{where}[{number}]"
        if source == sink:
            yield f"{here}: expected another source, robot {sink} cannot receive from itself"
        before = first.setdefault((source, sink), number)
        if before != number:
            yield (
                f"{here}: the edge from {source} to {sink} has been given before, as "
                f"{where}[{before}]; give it once, with the sum of the weights"
            )


def _wrong_generator(here: str, given: Generator) -> Iterator[str]:
    kind, n, k = given.kind, given.n, given.k
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
    yield from _wrong_rewire(here, given)
    for place, robot in enumerate(given.pinned):
        if robot > n:
            yield f"{here}.pinned[{place}]: expected 1 to {n}, got {robot}"
    if len(set(given.pinned)) < len(given.pinned):
        yield f"{here}.pinned: expected each robot once, got {list(given.pinned)}"


def _wrong_rewire(here: str, given: Generator) -> Iterator[str]:
    kind, k = given.kind, given.k
    if given.rewire is not None:
        if kind != "small_world":
            yield f"{here}.rewire: is of small_world, not of {kind}, got {given.rewire:g}"
        elif k == 1 and given.rewire:
            yield (
                f"{here}.rewire: expected 0 with k = 1, for the nearest neighbours stay, "
                f"got {given.rewire:g}; take a larger k"
            )
