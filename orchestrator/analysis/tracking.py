"""How near the robots come to the target, by what is known of their estimates."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from nrs_cosim.estimator_agents.target import Target
from nrs_cosim.estimator_agents.theory.cascade import cascade_ball
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.reference_filter import filtered
from nrs_cosim.estimator_agents.theory.step_responses import Steps
from nrs_cosim.estimator_agents.theory.tracking import balls, worst_tracking
from nrs_cosim.estimator_agents.theory.tracking_bounds import Loop, tracking_ball
from nrs_cosim.orchestrator.analysis.plant_bounds import Bounded


@dataclass(frozen=True, slots=True)
class Tracking:
    """Bounds on lim ‖e_i‖₂ and lim ‖ė_i‖₂ over all robots; None where there is none."""

    paper: EstimateBounds | None
    """δ3 and δ4, or δ5 and δ6, of the paper's bounds on the estimates."""
    paper_of_worst_case: EstimateBounds | None
    """The same of worst-case bounds on the estimates."""
    worst_case: EstimateBounds | None
    """What is proven of worst-case estimates, as the paper's step from V̇ does not follow."""


def tracking_of(
    robots: Sequence[Bounded],
    target: Target,
    recursion: Recursion | None,
    always: EstimateBounds | None,
    paper: EstimateBounds | None,
    steps: Steps | None,
) -> Tracking:
    """Return the bounds on tracking from those on estimates at all times, and from the paper's.

    `recursion` is that of the estimates at constant periods, and `steps` their responses: without
    these less is known of how their positions and velocities go together.
    """
    whole = target.bounds()

    @cache
    def filter_of(rate: float) -> EstimateBounds:
        assert always is not None
        return filtered(recursion, whole, always, rate)

    def proven(part: Bounded) -> EstimateBounds | None:
        loop = loop_of(part, target)
        if loop is None or always is None:
            return None
        exact = cascade_ball(loop, steps, np.array(part.robots) - 1) if steps else None
        return exact or tracking_ball(loop, always, filter_of)

    return Tracking(
        worst_tracking([_stated(part, paper) for part in robots]),
        worst_tracking([_stated(part, always) for part in robots]),
        worst_tracking([proven(part) for part in robots]),
    )


def loop_of(part: Bounded, target: Target) -> Loop | None:
    """Return a robot's loop; None where P3 is not known, or nothing is proven of its gains."""
    symmetric = np.array_equal(part.kp, part.kp.T) and np.array_equal(part.kd, part.kd.T)
    if part.bounds is None or not symmetric or not np.isfinite(part.lambda_d):
        return None
    gammas, norms = target.bounds(), target.norm_bounds()
    return Loop(part.bounds, part.kp, part.kd, part.disturbance, gammas, *norms)


def _stated(part: Bounded, estimates: EstimateBounds | None) -> EstimateBounds | None:
    if part.constants is None or estimates is None:
        return None
    return balls(part.constants, part.drive, estimates)
