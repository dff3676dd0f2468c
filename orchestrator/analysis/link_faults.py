"""What links do to samples in steady state, and over which of them: at each tick of a period.

Where the last phase stays it is of that one alone. A sample takes a link that a digraph of t_k has,
and arrives whatever digraphs have then: so at t_{k+d} one is due over links of t_k, and none else.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.links.links import LinkFault
from nrs_cosim.bus.links.outages import Outages
from nrs_cosim.bus.topologies import InteractionGraphs, TopologySchedule, edges_among, united
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.theory.lossy_step import TickEdges
from nrs_cosim.estimator_agents.theory.simulated_links import Turns
from nrs_cosim.estimator_agents.theory.switching import Phases
from nrs_cosim.orchestrator.scenario.experiment import Experiment

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LinkFaults:
    """What links do to samples in steady state, by edge."""

    links: Topology
    """The E edges that some digraph of the steady state has."""
    least: NDArray[np.int64]
    """(E,) the shortest delay, sampling periods."""
    most: NDArray[np.int64]
    """(E,) the longest."""
    loss: Array
    """(E,) the probability that a sample is lost."""
    noisy: bool
    """Whether noise is added to samples, so that no error is bounded."""
    since: int
    """The tick from which on all is as in steady state: no sample is missing that an outage took,
    or that is late from before t_1, and none is of a digraph that holds no more."""
    outages_end: int
    """The tick at which the last outage of the run is over; 0 where there is none."""

    @property
    def some_arrive(self) -> bool:
        """Whether no link loses every sample."""
        return not (self.loss == 1).any()

    @property
    def arrive_in_time(self) -> bool:
        """Whether all samples do, but for outages that end."""
        return not (self.loss.any() or self.most.any())

    @property
    def fixed(self) -> bool:
        """Whether each link is late by the same time at all ticks."""
        return bool((self.least == self.most).all())


def lasting_digraph(topologies: TopologySchedule) -> Topology | None:
    """Return the one digraph of the steady state; None where there are several."""
    last = topologies.exchanges[-1]
    return None if topologies.switching or last.has_two_digraphs else last.position


def link_faults_of(experiment: Experiment) -> LinkFaults:
    """Return what links do to samples."""
    topologies, given, sound = experiment.topologies, experiment.link_faults, LinkFault()
    last, turn = topologies.exchanges[-1], topologies.repeat or 1
    links = topologies.links
    if not topologies.switching:
        links, turn = united([*dict.fromkeys((last.position, last.velocity))]), topologies.since[-1]
    edges = zip(links.source.tolist(), links.sink.tolist(), strict=True)
    faults = [given.get(edge, sound) for edge in edges]
    delays = np.array([fault.delay for fault in faults], np.int64).reshape(-1, 2)
    clock = experiment.clock
    cuts = Outages.of({e: f.outages for e, f in enumerate(faults)}, clock.since)
    out = max(int(of.ends_of_run(clock.ticks).max(initial=0)) for of in (cuts, experiment.outages))
    return LinkFaults(
        links,
        delays[:, 0],
        delays[:, 1],
        np.array([fault.loss for fault in faults]),
        any(fault.noise for fault in faults),
        max(turn, out, 1) + int(delays.max(initial=0)),
        out,
    )


def turns_of(topologies: TopologySchedule, links: Topology) -> Turns:
    """Return the weights of each exchange over some links, and which holds at a period's ticks."""
    last = [(len(topologies.exchanges) - 1, 1)]
    order = [e for e, count in topologies.phases() or last for _ in range(count)]
    return [_weights(exchange, links) for exchange in topologies.exchanges], order


def ticks_of(
    topologies: TopologySchedule, faults: LinkFaults, loss: Array
) -> tuple[list[TickEdges], Phases]:
    """Return what links are at the ticks of a period, each once, and in which order.

    Each is late by its shortest delay, and `loss` (E,) is that of samples which are sent.
    """
    weights, order = turns_of(topologies, faults.links)
    has = np.array([weight.any(axis=0) for weight in weights])[order]
    tick, edge = np.ogrid[: len(order), : len(loss)]
    sent = has[(tick - faults.least) % len(order), edge]
    # Ticks with the same digraphs, at which the same links have a sample that is due, are alike.
    _, first, alike = np.unique(
        np.column_stack([order, sent]), axis=0, return_index=True, return_inverse=True
    )
    ticks = [TickEdges(weights[order[k]], np.where(sent[k], loss, 1.0)) for k in first]
    begins = np.flatnonzero(np.diff(alike.ravel(), prepend=-1))
    counts = np.diff(begins, append=len(order))
    return ticks, [*zip(alike.ravel()[begins].tolist(), counts.tolist(), strict=True)]


def _weights(exchange: InteractionGraphs, links: Topology) -> Array:
    """Return w_ij/ϖ_i of each edge, (1, E), or (2, E) where velocities have their own digraph."""
    found = []
    for digraph in dict.fromkeys((exchange.position, exchange.velocity)):
        weight = np.zeros(len(links.source))
        weight[edges_among(links, digraph.source, digraph.sink)] = digraph.normalised
        found.append(weight)
    return np.array(found)
