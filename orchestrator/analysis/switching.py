"""What the theory says of each digraph of a scenario by itself, and of turns in any order.

That each turn would converge by itself says nothing of turns: with gains above 1 they may diverge.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectra, Spectrum, conditions
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.theory.aperiodic import Growth, Periods, Verdict
from nrs_cosim.estimator_agents.theory.network import NetworkSummary, network_of
from nrs_cosim.estimator_agents.theory.switching import any_order, contracts_in_any_order
from nrs_cosim.orchestrator.analysis.convergence import for_any_periods, growth_alone, recursions_of


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """A digraph."""

    of: Literal["positions and velocities", "positions", "velocities"]
    """What travels over it."""
    network: NetworkSummary
    spectrum: Spectrum


@dataclass(frozen=True, slots=True, eq=False)
class Phase:
    """What holds from a tick on, as if it stayed."""

    since: int
    digraphs: tuple[Heard, ...]
    growth: Growth
    conditions: tuple[Condition, ...]


@dataclass(frozen=True, slots=True)
class AnyOrder:
    """What turns in any order multiply the error by at a sampling time, at worst."""

    verdict: Verdict | Literal["not computed"]
    by_gains: bool
    """Whether it is proven by the gains alone, for all digraphs of so many robots with A2."""
    lower: float | None
    upper: float | None
    """Of the joint spectral radius; None where that is not computed."""
    order: tuple[int, ...]
    """Turns, from 1, that over and over come to the lower bound."""


def turns_of(
    algorithm: Algorithm, topologies: TopologySchedule, spectra: Sequence[Spectra], periods: Periods
) -> tuple[Phase, ...]:
    """Return what is said of each exchange by itself."""
    networks = {digraph: network_of(digraph) for digraph in topologies.digraphs}
    turns = []
    for since, exchange, own in zip(topologies.since, topologies.exchanges, spectra, strict=True):
        both = networks[exchange.position], networks[exchange.velocity]
        heard = [Heard("positions and velocities", both[0], own[0])]
        if exchange.hetero:
            heard = [Heard("positions", both[0], own[0]), Heard("velocities", both[1], own[1])]
        growth = growth_alone(algorithm, own, periods)
        turns.append(
            Phase(since, tuple(heard), growth, tuple(conditions(algorithm, own, periods.longest)))
        )
    return tuple(turns)


def any_order_of(
    algorithm: Algorithm, topologies: TopologySchedule, periods: Periods
) -> AnyOrder | None:
    """Return what is known of turns in any order; None where there are none, or no recursion."""
    recursions = recursions_of(algorithm, topologies, periods.mean)
    if topologies.is_constant or not recursions:
        return None
    by_gains = contracts_in_any_order(recursions[0])
    found = None
    if periods.alike is not None or for_any_periods(algorithm):
        found = any_order(recursions)
    if found is None:
        return AnyOrder("proven" if by_gains else "not computed", by_gains, None, None, ())
    upper = min(found.upper, 1.0) if by_gains else found.upper
    verdict = "proven" if by_gains else Growth(found.lower, upper).verdict
    order = tuple(turn + 1 for turn in found.order)
    return AnyOrder(verdict, by_gains, found.lower, upper, order)
