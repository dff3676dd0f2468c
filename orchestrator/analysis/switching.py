"""What the theory says of each phase of a switching topology by itself, and of phases in any order.

That each phase would converge by itself says nothing of them in sequence: with gains above 1
they may diverge.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectra, Spectrum
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.theory.aperiodic import ConvergenceStatus, Periods, RadiusBounds
from nrs_cosim.estimator_agents.theory.network import NetworkSummary, network_of
from nrs_cosim.estimator_agents.theory.switching import any_order, contracts_in_any_order
from nrs_cosim.orchestrator.analysis.convergence import (
    conditions_for,
    for_any_periods,
    recursions_of,
    rho_alone,
)
from nrs_cosim.orchestrator.analysis.link_recursions import joint_radius_over
from nrs_cosim.orchestrator.scenario.experiment import Experiment


@dataclass(frozen=True, slots=True, eq=False)
class DigraphAnalysis:
    """A digraph."""

    of: Literal["positions and velocities", "positions", "velocities"]
    """What travels over it."""
    network: NetworkSummary
    spectrum: Spectrum
    """Of D; its `PartialSpectrum` where not all eigenvalues are known."""


@dataclass(frozen=True, slots=True, eq=False)
class Phase:
    """What holds from a tick on, as if it stayed."""

    since: int
    digraphs: tuple[DigraphAnalysis, ...]
    rho: RadiusBounds
    conditions: tuple[Condition, ...]


@dataclass(frozen=True, slots=True)
class AnyOrder:
    """What phases in any order multiply the error by at a sampling time, at worst."""

    status: ConvergenceStatus | Literal["not computed"]
    by_gains: bool
    """Whether it is proven by the gains alone, for all digraphs of so many robots with A2."""
    lower: float | None
    upper: float | None
    """Of the joint spectral radius; None where that is not computed."""
    order: tuple[int, ...]
    """Phases, from 1, that over and over come to the lower bound."""
    over_links: bool = False
    """Whether it is of links that are late, and not of links without faults."""


def phases_of(
    algorithm: Algorithm, topologies: TopologySchedule, spectra: Sequence[Spectra], periods: Periods
) -> tuple[Phase, ...]:
    """Return what is said of each exchange by itself."""
    networks = {digraph: network_of(digraph) for digraph in topologies.digraphs}
    phases = []
    for since, exchange, own in zip(topologies.since, topologies.exchanges, spectra, strict=True):
        both = networks[exchange.position], networks[exchange.velocity]
        digraphs = [DigraphAnalysis("positions and velocities", both[0], own[0])]
        if exchange.has_two_digraphs:
            digraphs = [
                DigraphAnalysis("positions", both[0], own[0]),
                DigraphAnalysis("velocities", both[1], own[1]),
            ]
        rho = rho_alone(algorithm, own, periods)
        of_own = tuple(conditions_for(algorithm, own, periods.longest))
        phases.append(Phase(since, tuple(digraphs), rho, of_own))
    return tuple(phases)


def any_order_of(
    algorithm: Algorithm, topologies: TopologySchedule, periods: Periods
) -> AnyOrder | None:
    """Return what is known of turns in any order; None where there are none, or no recursion."""
    recursions = recursions_of(algorithm, topologies, periods.mean)
    if topologies.is_constant or not recursions:
        return None
    by_gains = contracts_in_any_order(recursions[0].keep, recursions[0].gain)
    found = None
    if periods.constant_period is not None or for_any_periods(algorithm):
        found = any_order(recursions)
    if found is None:
        return AnyOrder("proven" if by_gains else "not computed", by_gains, None, None, ())
    upper = min(found.upper, 1.0) if by_gains else found.upper
    status = "proven" if by_gains else RadiusBounds(found.lower, upper).status
    order = tuple(phase + 1 for phase in found.order)
    return AnyOrder(status, by_gains, found.lower, upper, order)


def any_order_over(experiment: Experiment, periods: Periods) -> AnyOrder | None:
    """Return what is known of turns in any order over links that are late (statement D8).

    None where it is not of links that are late alone, with agents that drop, or of too many states.
    """
    topologies = experiment.topologies
    if not (experiment.impaired and topologies.switching and experiment.missing == "drop"):
        return None
    found = joint_radius_over(experiment, periods)
    if found is None:
        return None
    status = RadiusBounds(found.lower, found.upper).status
    order = tuple(phase + 1 for phase in found.order)
    return AnyOrder(status, False, found.lower, found.upper, order, over_links=True)
