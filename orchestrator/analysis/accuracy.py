"""Gains and a period for which it is proven that robots stay near the target."""

from dataclasses import replace
from functools import cache

import numpy as np

from nrs_cosim.estimator_agents.theory.aperiodic import Periods
from nrs_cosim.estimator_agents.theory.cascade import cascade_ball
from nrs_cosim.estimator_agents.theory.design import Design, Gains, design
from nrs_cosim.estimator_agents.theory.estimates import (
    EstimateBounds,
    paper_bound,
    worst_case_always,
)
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.reference_filter import filtered
from nrs_cosim.estimator_agents.theory.step_responses import steps_of
from nrs_cosim.estimator_agents.theory.tracking import worst_tracking
from nrs_cosim.estimator_agents.theory.tracking_bounds import Filtered
from nrs_cosim.orchestrator.analysis.convergence import (
    lasting,
    recursions_of,
    rho_of,
    spectra_of,
)
from nrs_cosim.orchestrator.analysis.plant_bounds import Find, plant_bounds
from nrs_cosim.orchestrator.analysis.tracking import loop_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment


@np.errstate(all="ignore")
def designed(
    experiment: Experiment, wanted: EstimateBounds, epsilon: float, find: Find | None = None
) -> Design | None:
    """Return gains and a period for a wanted accuracy; None without P3."""
    topologies, whole = experiment.topologies, experiment.target.bounds()
    algorithm = experiment.algorithm
    spectra = spectra_of(topologies)
    parts = plant_bounds(experiment, find)
    pairs = [(part.constants, loop_of(part, experiment.target)) for part in parts]
    robots = [(own, loop) for own, loop in pairs if own is not None and loop is not None]
    if len(robots) < len(parts):
        return None

    def recursion_at(h: float) -> Recursion | None:
        return lasting(recursions_of(algorithm, topologies, h), topologies)

    def paper_of(h: float) -> EstimateBounds | None:
        recursion = None if topologies.switching else recursion_at(h)
        found = paper_bound(recursion, *whole) if recursion else None
        return found.bound if found else None

    def known(h: float) -> tuple[EstimateBounds, Filtered] | None:
        recursion = recursion_at(h)
        radius = rho_of(algorithm, topologies, spectra, Periods((h,))).radius
        if recursion is None or not radius < 1:
            return None
        always = worst_case_always(recursion, *whole, radius)
        if always is None:
            return None
        return always, cache(lambda rate: filtered(recursion, whole, always, rate))

    def tight(h: float, kp: float, kd: float) -> EstimateBounds | None:
        recursion, unit = recursion_at(h), np.eye(experiment.m)
        steps = steps_of(recursion) if recursion else None
        if steps is None:
            return None
        each = [replace(loop, kp=kp * unit, kd=kd * unit) for _, loop in robots]
        pairs = zip(each, parts, strict=True)
        balls = [cascade_ball(loop, steps, np.array(part.robots) - 1) for loop, part in pairs]
        return worst_tracking(balls)

    found = design(robots, wanted, epsilon, paper_of, known, tight)
    return replace(found, sampled=any(part.sampled for part in parts))


def accuracy_rows(found: Design, wanted: EstimateBounds) -> dict[str, str]:
    """Return lines of what gains and period are proven to give an accuracy, and of the paper's."""
    proven = "sampled" if found.sampled else "proven"
    return {
        "accuracy": f"|q - eps_0|2 -> {wanted.position:g}, |qd - ups_0|2 -> "
        f"{wanted.velocity:g}, a share of {found.epsilon:g} for the robots' own error",
        proven: _gains(found.proven) + "; as far as P3 was sampled" * found.sampled,
        "paper": f"{_gains(found.paper)} (equations 6.1, 6.2): unproven",
    }


def _gains(found: Gains | None) -> str:
    if found is None:
        return "no gains are found"
    return f"kp = {found.kp:.6g}, kd = {found.kd:.6g}, {_period(found)}"


def _period(found: Gains) -> str:
    if found.period is not None:
        return f"h <= {found.period:.4g} s"
    if found.bounds_from is None:
        return "no bounds are known, whatever h is"
    if found.status != "not computed":
        return found.status
    tried = f"{found.bounds_from:.4g} s"
    return f"h not computed: of {tried} and more none is short enough, of less no bounds are known"
