"""Designs are of the links that a scenario has: the factor over these, or nothing at all.

Over links that are late by fixed times the factor is ρ of the recursion with what is under way
(statement D1), over those that lose samples the root of the mean square (L1). Neither need be below
1 up to one period and above it from there on: the first period at which it is not is searched (G6).
"""

from math import isfinite, nan

from nrs_cosim.bus.errors import InputError
from nrs_cosim.estimator_agents.algorithm import Spectra, nominal_of
from nrs_cosim.estimator_agents.theory.aperiodic import Periods
from nrs_cosim.orchestrator.analysis.convergence import (
    for_any_periods,
    periods_of,
    rho_alone,
    spectra_of,
)
from nrs_cosim.orchestrator.analysis.link_faults import link_faults_of
from nrs_cosim.orchestrator.analysis.link_recursions import factor_over_links
from nrs_cosim.orchestrator.analysis.links import link_analysis
from nrs_cosim.orchestrator.scenario.experiment import Experiment

STEP, TRIES, HALVINGS = 2**0.125, 80, 16
"""Between periods that are tried, how many are to each side, and how often a bracket is halved."""


def factor_at(experiment: Experiment, spectra: Spectra, h: float) -> float:
    """Return the factor on errors at a period of h, s, over the links; else not a number."""
    periods = Periods((h,))
    if not experiment.impaired:
        return rho_alone(experiment.algorithm, spectra, periods).radius
    found = factor_over_links(experiment, spectra[0], periods)
    return found.upper if found else nan


def radius_name(experiment: Experiment) -> str:
    """Return what the factor is called: a radius of mean squares where samples are lost."""
    lossy = experiment.impaired and link_faults_of(experiment).loss.any()
    return "mean-square radius" if lossy else "spectral radius"


def first_failing_period(
    experiment: Experiment, spectra: Spectra, h: float
) -> tuple[float, float, float]:
    """Return periods, s: that tried first, the last that converges, and the first that does not.

    `InputError` where the factor is not known, or no such period is found.
    """
    name = experiment.name
    if not isfinite(factor_at(experiment, spectra, h)):
        raise InputError(why_not_designed(experiment))
    if for_any_periods(nominal_of(experiment.algorithm)):
        raise InputError(f"{name}: no bound on the period is known of the algorithm")

    def converges(period: float) -> bool:
        return factor_at(experiment, spectra, period) < 1

    low = h
    for _ in range(TRIES):
        if converges(low):
            break
        low /= STEP
    else:
        raise InputError(f"{name}: the estimates converge at no period from {low:.3g} to {h:g} s")
    first, high = low, low * STEP
    for _ in range(TRIES):
        if not converges(high):
            break
        low, high = high, high * STEP
    else:
        raise InputError(f"{name}: the estimates converge at all periods that were tried")
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if converges(middle) else (low, middle)
    return first, low, high


def why_not_designed(experiment: Experiment) -> str:
    """Say why nothing is designed over links, and what to do."""
    spectra, periods = spectra_of(experiment.topologies), periods_of(experiment)
    rho = rho_alone(experiment.algorithm, spectra[-1], periods)
    why = link_analysis(experiment, spectra, periods, rho).why or "how fast is not computed"
    return (
        f"{experiment.name}: over such links nothing is designed: {why}. A study tries values by "
        "runs: nrs sweep SCENARIO --over KEY=VALUES -o DIRECTORY"
    )


def expect_honest(experiment: Experiment) -> None:
    """Raise `InputError` where robots lie: what is proven is of honest ones."""
    if experiment.byzantine:
        raise InputError(f"{experiment.name}: robots lie: leave faults.byzantine out for a design")


def expect_sound(experiment: Experiment, what: str) -> None:
    """Raise `InputError` where robots lie or links have faults, over which nothing is promised."""
    expect_honest(experiment)
    if experiment.impaired:
        raise InputError(
            f"{experiment.name}: links have faults, over which {what} is not designed; leave "
            "[faults] out"
        )
