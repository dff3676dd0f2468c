"""The recursion over the links of a scenario, in steady state: of one digraph, or of a period.

Over links that are late by fixed times it is x and what is under way; over links that lose samples,
and of digraphs in turn, it has what came last over each link too.
"""

from collections.abc import Sequence
from itertools import product
from math import isnan, nan

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.algorithm import Spectrum, nominal_of
from nrs_cosim.estimator_agents.theory.aperiodic import Periods, RadiusBounds
from nrs_cosim.estimator_agents.theory.delays import LateStep
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep, linear_step
from nrs_cosim.estimator_agents.theory.loss import mean_square_radius
from nrs_cosim.estimator_agents.theory.lossy_step import LossyStep, TickEdges, lossy_ticks
from nrs_cosim.estimator_agents.theory.outermost import bounds_by
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.simulated_links import simulated_growth
from nrs_cosim.estimator_agents.theory.switching import product_radius
from nrs_cosim.estimator_agents.theory.varying import JointRadius, joint_spectral_radius
from nrs_cosim.orchestrator.analysis.convergence import UNKNOWN, periods_of, rho_of, spectra_of
from nrs_cosim.orchestrator.analysis.link_faults import (
    LinkFaults,
    lasting_digraph,
    link_faults_of,
    ticks_of,
    turns_of,
)
from nrs_cosim.orchestrator.scenario.experiment import Experiment

PASTS = 9
"""Of digraphs in any order: which there may have been as long ago as samples are late."""


def step_of_run(
    experiment: Experiment, periods: Periods, recursions: Sequence[Recursion]
) -> tuple[LateStep | None, int]:
    """Return a period over late links, or of agents that keep more, and the tick it is so from."""
    topologies, h = experiment.topologies, periods.constant_period
    if experiment.impaired:
        faults = link_faults_of(experiment)
        late = _late_step(experiment, faults, periods)
        return late, faults.since if late else 1
    since = 1 if topologies.repeat else topologies.since[-1]
    if recursions or h is None or len(topologies.digraphs) > 1:
        return None, since
    step = linear_step(nominal_of(experiment.algorithm), h)
    sound = np.zeros(len(topologies.links.source), np.int64)
    return None if step is None else LateStep(step, topologies.links, sound), since


def _late_step(experiment: Experiment, faults: LinkFaults, periods: Periods) -> LateStep | None:
    """Return the recursion where links, in steady state, are late by fixed times and round at most.

    None where that is not so, or not known.
    """
    alone = lasting_digraph(experiment.topologies)
    troubled = faults.noisy or not faults.fixed or faults.loss.any()
    if alone is None or troubled or why_unknown_over(experiment, faults):
        return None
    step = step_over(experiment, periods.constant_period)
    return None if step is None else LateStep(step, alone, faults.most)


def radius_of_turns(experiment: Experiment, faults: LinkFaults, step: LinearStep) -> float:
    """Return ρ of a period of digraphs in turn over links that are late by fixed times."""
    ticks, phases = ticks_of(experiment.topologies, faults, faults.loss)
    steps = lossy_ticks(step, faults.links, faults.least, ticks, experiment.missing)
    if steps is None:
        return nan
    p = len(steps[0].fixed)
    return product_radius([one.fixed[:, :p] for one in steps], phases)


def lossy_recursion(
    experiment: Experiment, faults: LinkFaults, periods: Periods
) -> tuple[LinearStep, LossyStep] | None:
    """Return a period and the recursion where links lose samples; None where it is not known.

    None too of digraphs in turn.
    """
    step = step_over(experiment, periods.constant_period)
    if not faults.loss.any() or why_unknown_over(experiment, faults):
        return None
    lossy = lossy_steps(experiment, faults, step, faults.loss)
    return (step, lossy[0]) if step and lossy and not experiment.topologies.switching else None


def factor_over_links(
    experiment: Experiment, spectrum: Spectrum, periods: Periods
) -> RadiusBounds | None:
    """Return bounds on the factor over links that are late or lose samples; None if not known.

    Where they lose some it is of the root of the mean square.
    """
    faults, alone = link_faults_of(experiment), lasting_digraph(experiment.topologies)
    step = step_over(experiment, periods.constant_period)
    if step is None or not faults.fixed or why_unknown_over(experiment, faults):
        return None
    if not faults.loss.any():
        if alone:
            late = LateStep(step, alone, faults.most)
            radius = RadiusBounds(*bounds_by(late.radius, spectrum))
        else:
            radius = RadiusBounds(*[radius_of_turns(experiment, faults, step)] * 2)
        return None if isnan(radius.upper) else radius
    lossy = lossy_steps(experiment, faults, step, faults.loss)
    phases = ticks_of(experiment.topologies, faults, faults.loss)[1]
    return mean_square_radius(lossy, phases) if lossy else None


@np.errstate(all="ignore")  # what overflows is infinite, or not a number: nothing is known
def radius_over(experiment: Experiment) -> RadiusBounds:
    """Return by what errors are multiplied over the links that there are, of theory alone (R1).

    It is that of `link_analysis`, without what else that looks for, but for delays that are drawn.
    """
    if experiment.byzantine:
        return UNKNOWN
    topologies, periods = experiment.topologies, periods_of(experiment)
    spectra = spectra_of(topologies)
    if experiment.impaired:
        found = factor_over_links(experiment, spectra[-1][0], periods)
        faults = link_faults_of(experiment)
        if found or why_unknown_over(experiment, faults) or not faults.arrive_in_time:
            return found or UNKNOWN
    return rho_of(nominal_of(experiment.algorithm), topologies, spectra, periods)


@np.errstate(all="ignore")  # as above
def growth_over(experiment: Experiment) -> RadiusBounds:
    """Return e^λ, by which almost every run grows: by simulation where links draw (L4).

    Where they lose nothing, and are late by fixed times, it is ρ. Not a number if it is not known.
    """
    if experiment.impaired and not experiment.byzantine:
        faults = link_faults_of(experiment)
        if faults.loss.any() or not faults.fixed:
            known = not why_unknown_over(experiment, faults)
            step = step_over(experiment, periods_of(experiment).constant_period)
            found = simulated_over(experiment, faults, step) if known and step else None
            return found or UNKNOWN
    return radius_over(experiment)


def simulated_over(
    experiment: Experiment, faults: LinkFaults, step: LinearStep
) -> RadiusBounds | None:
    """Return where e^λ lies over links as they are drawn, with a confidence of 99.9 %."""
    turns = turns_of(experiment.topologies, faults.links)
    drawn = faults.least, faults.most, faults.loss
    return simulated_growth(step, faults.links, *drawn, experiment.missing, turns)


def lossy_steps(
    experiment: Experiment,
    faults: LinkFaults,
    step: LinearStep | None,
    loss: NDArray[np.float64],
) -> list[LossyStep] | None:
    """Return the recursion at each of `ticks_of`; None where it is not known."""
    if step is None or not faults.fixed:
        return None
    ticks, _ = ticks_of(experiment.topologies, faults, loss)
    return lossy_ticks(step, faults.links, faults.most, ticks, experiment.missing)


def why_unknown_over(experiment: Experiment, faults: LinkFaults) -> str:
    """Return why nothing follows from links by any statement; empty where something may."""
    reasons = {
        "robots lie": bool(experiment.byzantine),
        "robots decide when they send": experiment.algorithm.TRIGGERED,
        "a link loses every sample, and agents hold what they never received": (
            experiment.missing == "hold" and not faults.some_arrive
        ),
        "a delay is longer than the run": faults.since > experiment.clock.ticks
        and int(faults.most.max(initial=0)) > experiment.clock.ticks,
        "an outage, or a digraph of before, lasts to the end of the run": faults.since
        > experiment.clock.ticks,
    }
    return next((why for why, so in reasons.items() if so), "")


def step_over(experiment: Experiment, h: float | None) -> LinearStep | None:
    """Return a period of h, s, where it is known and the age of samples is nothing to it."""
    step = None if h is None else linear_step(nominal_of(experiment.algorithm), h)
    return step if step and step.ageless else None


def joint_radius_over(experiment: Experiment, periods: Periods) -> JointRadius | None:
    """Return bounds for any order of digraphs over links that are late by fixed times.

    What is due depends on the digraphs of as many ticks as the longest delay has: of each such past
    there are states of their own, of which a tick goes from one to the next.
    """
    topologies, faults = experiment.topologies, link_faults_of(experiment)
    step = step_over(experiment, periods.constant_period)
    troubled = not faults.fixed or faults.loss.any() or why_unknown_over(experiment, faults)
    weights, longest = turns_of(topologies, faults.links)[0], int(faults.most.max(initial=0))
    pasts = [*product(range(len(weights)), repeat=longest)]
    if step is None or troubled or len(pasts) > PASTS:
        return None
    has = np.array([weight.any(axis=0) for weight in weights])
    edges, stories = np.arange(len(faults.most)), [*product(range(len(weights)), pasts)]
    sent = [has[np.array([now, *past])[faults.most], edges] for now, past in stories]
    ticks = [
        TickEdges(weights[now], np.where(there, 0.0, 1.0))
        for (now, _), there in zip(stories, sent, strict=True)
    ]
    steps = lossy_ticks(step, faults.links, faults.most, ticks, experiment.missing)
    if steps is None:
        return None
    p = len(steps[0].fixed)
    whole = np.zeros((len(weights), len(pasts), p, len(pasts), p))
    for (now, past), one in zip(stories, steps, strict=True):
        then = pasts.index((now, *past)[:longest])
        whole[now, then, :, pasts.index(past)] = one.fixed[:, :p]
    return joint_spectral_radius([*whole.reshape(len(weights), len(pasts) * p, -1)])
