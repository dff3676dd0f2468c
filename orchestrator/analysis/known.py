"""What is known of estimates in the long run: what they settle to, and bounds on their errors."""

from typing import NamedTuple

from nrs_cosim.estimator_agents.target import Harmonic, Target
from nrs_cosim.estimator_agents.theory.delays import LateStep
from nrs_cosim.estimator_agents.theory.estimates import (
    EstimateBounds,
    PaperBound,
    SteadyMotion,
    paper_bound,
    steady_motion,
    worst_case,
    worst_case_always,
)
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.step_responses import (
    Steps,
    steps_of,
    steps_of_late,
    worst_after,
)
from nrs_cosim.estimator_agents.theory.target_response import worst_of_step


class Known(NamedTuple):
    """What is known of estimates in the long run; None where it is not."""

    motion: SteadyMotion | None = None
    worst: EstimateBounds | None = None
    always: EstimateBounds | None = None
    """At all times, and not right before sampling times alone."""
    paper: PaperBound | None = None
    steps: Steps | None = None


def of_step(step: LateStep, target: Target, radius: float, added: EstimateBounds | None) -> Known:
    """Return what is known of agents that keep more, or over late links."""
    motion = step.steady_motion(target) if isinstance(target, Harmonic) else None
    worst = worst_of_step(step, *target.bounds(), radius)
    if added or worst is None:
        return Known(motion, worst.plus(added) if worst and added else worst)
    steps = steps_of_late(step, radius)
    always = worst.most(worst_after(steps, *target.bounds())) if steps else None
    return Known(motion, worst, always, None, steps)


def of_recursion(
    recursion: Recursion,
    target: Target,
    radius: float,
    added: EstimateBounds | None,
    switching: bool,
) -> Known:
    """Return what is known of a constant recursion; ρ is `radius`."""
    whole = target.bounds()
    motion = steady_motion(recursion, target, radius) if isinstance(target, Harmonic) else None
    worst = worst_case(recursion, *whole, radius)
    if added:
        return Known(motion, worst.plus(added) if worst else None)
    always = worst_case_always(recursion, *whole, radius, worst)
    paper = None if switching else paper_bound(recursion, *whole)
    return Known(motion, worst, always, paper, steps_of(recursion) if always else None)
