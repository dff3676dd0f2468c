"""A scenario's robots by what bounds them: P3 of their plants, their gains and their disturbances.

P3 is known of bundled models alone. Of another FMU it can be sampled from outside, which never
tells the worst: what rests on that is marked, and not proven. `nrs check` samples; a run and what
is said after it do not, and no bound on tracking then.
"""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, sqrt
from typing import Any

import numpy as np

from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.theory.tracking import Constants, Drive, constants
from nrs_cosim.estimator_agents.waves import supremum
from nrs_cosim.orchestrator.scenario.conversion import Array, gains, terms
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.fmus import Plant
from nrs_cosim.orchestrator.scenario.tables.scenario import Controller, Robot
from nrs_cosim.orchestrator.scenario.tables.targets import Axis
from nrs_cosim.plant_fmu.bundled.bounds import Bounds, bounds_of

Find = Callable[[Plant, int], Bounds | str]
"""Returns P3 of a robot's plant that is not bundled, or why there is none."""


@dataclass(frozen=True, slots=True)
class Bounded:
    """Robots with the same bounds."""

    robots: tuple[int, ...]
    plant: str
    drive: Drive
    kp: Array
    """(m, m), as kd."""
    kd: Array
    disturbance: tuple[float, ...]
    """(m,) N m, the most of each axis; infinite where one grows with time."""
    bounds: Bounds | None
    constants: Constants | None
    why: str
    """Why there are no constants; empty where there are."""

    @property
    def lambda_d(self) -> float:
        """‖τ_d‖₂ ≤ λ_d, N m: as if all axes had theirs at once; infinite for one that grows."""
        return sqrt(sum(size * size for size in self.disturbance))

    @property
    def sampled(self) -> bool:
        """Whether the constants rest on states that were looked at, and on no proof."""
        return self.bounds is not None and self.bounds.states is not None


def plant_bounds(experiment: Experiment, find: Find | None = None) -> list[Bounded]:
    """Return an experiment's robots, those together that have the same bounds.

    P3 of an FMU that is not bundled is what `find` finds.
    """
    whole = experiment.target.bounds()
    return [_bounded(experiment, robots, whole, find) for robots in alike(experiment)]


def alike(experiment: Experiment) -> list[list[int]]:
    """Return the robots, those together that differ in nothing but where they start."""
    if not experiment.scenario.robots:
        return [[*range(1, experiment.n + 1)]]
    own = {robot.id: _table(robot) for robot in experiment.scenario.robots}
    none, together = _table(Robot(id=1)), defaultdict[str, list[int]](list)
    for number in range(1, experiment.n + 1):
        together[own.get(number, none)].append(number)
    return [*together.values()]


def _table(robot: Robot) -> str:
    """Return what of a robot's own table matters to bounds."""
    return robot.model_dump_json(exclude={"id", "initial"})


def tracking_conditions(experiment: Experiment, find: Find | None = None) -> list[Condition]:
    """Return the conditions of Theorems 2 and 3 on the gains, each of the robot nearest to it.

    None unless P3 is known of all robots.
    """
    parts = plant_bounds(experiment, find)
    known = [part.constants.conditions(part.drive) for part in parts if part.constants]
    if len(known) < len(parts):
        return []
    sampled = any(part.sampled for part in parts)
    nearest = [min(same, key=lambda c: c.margin) for same in zip(*known, strict=True)]
    return [replace(condition, sampled=sampled) for condition in nearest]


def _bounded(
    experiment: Experiment,
    robots: list[int],
    whole: tuple[float, float],
    find: Find | None,
) -> Bounded:
    """Return what bounds some robots; `whole` are γ1 and γ2."""
    own, m = experiment.of_robot(robots[0]), experiment.m
    plant = own.plant
    kp, kd = gains(own.controller, m)
    disturbance = _largest(own.disturbance.axes, m)
    lambda_d = sqrt(sum(size * size for size in disturbance))
    p3: Bounds | str | None = _beyond_the_law(own.controller) or bounds_of(
        plant.fmu, _parameters(plant), m
    )
    if p3 is None:
        unknown = f"the bounds of P3 are not known of {plant.fmu}; `nrs check` samples them"
        p3 = find(plant, robots[0]) if find else unknown
    if isinstance(p3, str):
        why, p3 = p3, None
    else:
        if own.controller.gravity_compensation:
            p3 = replace(p3, lambda_g=0.0)
        why = _inapplicable(kp, kd, lambda_d)
    found = None
    if p3 is not None and not why:
        found = constants(p3, m, lambda_d, *whole)
    drive = Drive.of(kp, kd)
    return Bounded(tuple(robots), plant.fmu, drive, kp, kd, disturbance, p3, found, why)


def _beyond_the_law(controller: Controller) -> str:
    """Return why nothing is proven of a controller; empty of one whose law is PD, and gravity."""
    given = [
        key
        for key in ("frequency", "ki", "torque_limit", "acceleration_feedforward")
        if np.any(getattr(controller, key) or 0)
    ]
    return f"what is proven is of PD alone, and not with {', '.join(given)}" if given else ""


def _parameters(plant: Plant) -> dict[str, Any]:
    return {name: value for name, value in plant.parameters.items() if not isinstance(value, str)}


def _inapplicable(kp: np.ndarray, kd: np.ndarray, lambda_d: float) -> str:
    """Return why Theorems 2 and 3 say nothing of a robot whose P3 is known; empty where they do."""
    if np.any(kp - np.diag(np.diag(kp))) or np.any(kd - np.diag(np.diag(kd))):
        return "their proof needs diagonal gains"
    return "the disturbance grows with time" if lambda_d == inf else ""


def _largest(axes: tuple[Axis, ...], m: int) -> tuple[float, ...]:
    """Return sup |τ_d| on each of m axes, N m."""
    if any(axis.rate for axis in axes):
        return (inf,) * m
    if not axes:
        return (0.0,) * m
    torque = Harmonic(*terms(axes))
    omega, waves = torque.phasors()
    each = zip(torque.offset.tolist(), waves.T, strict=True)
    return tuple(supremum(offset, omega, wave) for offset, wave in each)
