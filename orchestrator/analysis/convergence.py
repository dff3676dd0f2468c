"""Whether a scenario's estimates converge: the factor on their error per sampling time.

Of one digraph, or two, and periodic sampling it is ρ of the recursion (paper, Theorems 1 and 3); of
other sampling times it lies between two bounds. Of digraphs in turn it is that of a period, where
the turns come again, and else that of the last turn, which stays.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from math import nan

import numpy as np

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectra, Spectrum, conditions, jumps
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.theory.aperiodic import Periods, RadiusBounds, radius_bounds
from nrs_cosim.estimator_agents.theory.linear_step import (
    linear_step,
    modes_of,
    radius_of_list,
    why_not_linear,
)
from nrs_cosim.estimator_agents.theory.outermost import PartialSpectrum, known_of, within_of
from nrs_cosim.estimator_agents.theory.recursion import Recursion, linear_jump, recursion_of
from nrs_cosim.estimator_agents.theory.spectrum import spectral_radius, spectrum_of
from nrs_cosim.estimator_agents.theory.switching import period, period_radius
from nrs_cosim.orchestrator.scenario.experiment import Experiment

UNKNOWN = RadiusBounds(float("nan"), float("nan"))


def periods_of(experiment: Experiment) -> Periods:
    """Return what periods the sampling times of an experiment may have."""
    clock = experiment.clock
    early = seconds(clock.jitter.most) if clock.jitter else 0.0
    return Periods(tuple(map(seconds, clock.gaps)), early)


@lru_cache(maxsize=1)  # conditions and bounds ask, of the same digraphs
def spectra_of(topologies: TopologySchedule) -> list[Spectra]:
    """Return the eigenvalues of D, and of the velocities' D where that is another, by exchange."""
    found = {digraph: spectrum_of(digraph) for digraph in topologies.digraphs}
    return [
        tuple(found[digraph] for digraph in dict.fromkeys((one.position, one.velocity)))
        for one in topologies.exchanges
    ]


def recursions_of(algorithm: Algorithm, topologies: TopologySchedule, h: float) -> list[Recursion]:
    """Return the recursion of each exchange; none where the jump is not linear."""
    found = (recursion_of(algorithm, exchange, h) for exchange in topologies.exchanges)
    return [one for one in found if one is not None]


def lasting(recursions: Sequence[Recursion], topologies: TopologySchedule) -> Recursion | None:
    """Return the recursion in steady state: of a period of turns, or of the last; or None."""
    if topologies.switching and recursions:
        return period(recursions, topologies.phases())
    return recursions[-1] if recursions else None


def for_any_periods(algorithm: Algorithm) -> bool:
    """Return whether velocities do not depend on positions, so that no period changes a factor."""
    found = linear_jump(algorithm)
    return found is not None and not any(part[1, 0] for part in found)


def rho_of(
    algorithm: Algorithm, topologies: TopologySchedule, spectra: Sequence[Spectra], periods: Periods
) -> RadiusBounds:
    """Return bounds on the factor, from the eigenvalues of each D."""
    if not topologies.switching:
        return rho_alone(algorithm, spectra[-1], periods)
    if linear_jump(algorithm) is None or (
        periods.constant_period is None and not for_any_periods(algorithm)
    ):
        return UNKNOWN
    recursions = recursions_of(algorithm, topologies, periods.mean)
    radius = period_radius(recursions, topologies.phases())
    return RadiusBounds(radius, radius)


def rho_alone(algorithm: Algorithm, spectra: Spectra, periods: Periods) -> RadiusBounds:
    """Return bounds on the factor of one digraph, or of two, which then no period matters to.

    Of eigenvalues that are not all known the upper one is of the circle that holds the others.
    """
    upper = _rho_alone(algorithm, spectra, periods)
    if all(within_of(one) is None for one in spectra):
        return upper
    known = [known_of(one) for one in spectra]
    if not all(map(len, known)):
        return RadiusBounds(0.0, upper.upper)
    return RadiusBounds(_rho_alone(algorithm, tuple(known), periods).lower, upper.upper)


def _rho_alone(algorithm: Algorithm, spectra: Spectra, periods: Periods) -> RadiusBounds:
    if periods.constant_period is None and len(spectra) == 1:
        if jumps(algorithm) or periods.early:
            return radius_bounds(algorithm, spectra[0], periods)
        radius = radius_of_list(algorithm, spectra[0], periods.gaps)
    else:
        radius = spectral_radius(modes_of(algorithm, spectra, periods.mean))
    return RadiusBounds(radius, radius)


def why_unknown(algorithm: Algorithm, topologies: TopologySchedule, periods: Periods) -> str:
    """Return why there is no factor, where there is none."""
    if linear_jump(algorithm) is None:
        if jumps(algorithm):
            return "the algorithm does not jump linearly"
        if linear_step(algorithm, periods.mean) is None:
            raised = why_not_linear(algorithm, periods.mean)
            return "the algorithm is not known to be linear" + (raised and f" ({raised})")
        if topologies.switching or periods.early:
            of = "digraphs in turn" if topologies.switching else "sampling times that are drawn"
            return f"of {of} it is computed where agents keep a position and a velocity alone"
    if topologies.switching and periods.constant_period is None and not for_any_periods(algorithm):
        return "of digraphs in turn at times that are not periodic it is not computed"
    return "it is not found: of so large digraphs in turn, or numbers out of all proportion"


def merged(spectra: Sequence[Spectra]) -> Spectra:
    """Return the eigenvalues of all digraphs together, which conditions are to hold for."""
    positions = _together([one[0] for one in spectra])
    if all(len(one) == 1 for one in spectra):
        return (positions,)
    return positions, _together([one[-1] for one in spectra])


def _together(spectra: Sequence[Spectrum]) -> Spectrum:
    known = np.concatenate([known_of(one) for one in spectra])
    within = [radius for radius in map(within_of, spectra) if radius is not None]
    return PartialSpectrum.of(known, max(within)) if within else known


def conditions_for(algorithm: Algorithm, spectra: Spectra, h: float) -> list[Condition]:
    """Return an algorithm's conditions; their bounds are not numbers where it is not known.

    Of eigenvalues that are not all known one holds if it does on the circle that holds the others,
    and is violated if it is by those that are known.
    """
    found = list(conditions(algorithm, spectra, h))
    known = tuple(known_of(one) for one in spectra)
    if all(within_of(one) is None for one in spectra):
        return found
    if not all(map(len, known)):
        return [c if c.holds else _undecided(c) for c in found]
    of_known = conditions(algorithm, known, h)
    return [
        c if c.holds else own if not own.holds else _undecided(c)
        for c, own in zip(found, of_known, strict=True)
    ]


def _undecided(condition: Condition) -> Condition:
    if condition.at_least:
        return replace(condition, left=nan)
    return replace(condition, right=nan)
