"""What is known of estimates in the long run: what they settle to, and bounds on their errors."""

from typing import NamedTuple

from nrs_cosim.estimator_agents.algorithm import Spectrum
from nrs_cosim.estimator_agents.target import Harmonic, Target
from nrs_cosim.estimator_agents.theory.aperiodic import Periods
from nrs_cosim.estimator_agents.theory.delays import LateStep, contraction
from nrs_cosim.estimator_agents.theory.drawn_delays import worst_of_drawn
from nrs_cosim.estimator_agents.theory.estimates import (
    EstimateBounds,
    PaperBound,
    SteadyMotion,
    paper_bound,
    steady_motion,
    worst_case,
    worst_case_always,
)
from nrs_cosim.estimator_agents.theory.received_errors import Added
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.step_responses import (
    Steps,
    steps_of,
    steps_of_late,
)
from nrs_cosim.estimator_agents.theory.target_response import worst_of_step
from nrs_cosim.orchestrator.analysis.link_faults import lasting_digraph, link_faults_of
from nrs_cosim.orchestrator.analysis.link_recursions import step_over, why_unknown_over
from nrs_cosim.orchestrator.analysis.noise import rounds
from nrs_cosim.orchestrator.scenario.experiment import Experiment


class Known(NamedTuple):
    """What is known of estimates in the long run; None where it is not."""

    motion: SteadyMotion | None = None
    worst: EstimateBounds | None = None
    always: EstimateBounds | None = None
    """At all times, and not right before sampling times alone."""
    paper: PaperBound | None = None
    steps: Steps | None = None


def of_step(
    step: LateStep, target: Target, radius: float, added: Added | None, chord: float
) -> Known:
    """Return what is known of agents that keep more, or over late links.

    Robots are given chords of what agents estimate over `chord`, s, where that is not 0.
    """
    motion = step.steady_motion(target) if isinstance(target, Harmonic) else None
    found = worst_of_step(step, *target.bounds(), radius, chord)
    if found is None:
        return Known(motion)
    worst, always = found
    if added:
        return Known(motion, worst.plus(added.sampled), _plus(always, added.always))
    steps = steps_of_late(step, radius) if always else None
    return Known(motion, worst, always, None, steps)


def of_recursion(
    recursion: Recursion,
    target: Target,
    radius: float,
    added: Added | None,
    switching: bool,
) -> Known:
    """Return what is known of a constant recursion; ρ is `radius`."""
    whole = target.bounds()
    motion = steady_motion(recursion, target, radius) if isinstance(target, Harmonic) else None
    worst = worst_case(recursion, *whole, radius)
    always = worst_case_always(recursion, *whole, radius, worst)
    if added:
        sum_of_both = worst.plus(added.sampled) if worst else None
        return Known(motion, sum_of_both, _plus(always, added.always))
    paper = None if switching else paper_bound(recursion, *whole)
    return Known(motion, worst, always, paper, steps_of(recursion) if always else None)


def of_drawn_delays(
    experiment: Experiment, spectrum: Spectrum, periods: Periods, chord: float
) -> Known | None:
    """Return what is known over links whose delays are drawn; None where nothing is (W7)."""
    faults, links = link_faults_of(experiment), lasting_digraph(experiment.topologies)
    step = step_over(experiment, periods.constant_period)
    troubled = faults.noisy or faults.fixed or faults.loss.any() or rounds(experiment)
    if step is None or links is None or troubled or why_unknown_over(experiment, faults):
        return None
    if experiment.missing != "hold" or not contraction([step], spectrum) < 1:
        return None
    found = worst_of_drawn(step, links, faults.most, experiment.target.bounds(), chord)
    return None if found is None else Known(None, *found)


def _plus(one: EstimateBounds | None, other: EstimateBounds | None) -> EstimateBounds | None:
    return one.plus(other) if one and other else None
