"""A scenario's robots by what bounds them: P3 of their plants, their gains and their disturbances.

P3 is known of bundled models alone; of another FMU, what its inertia is over all postures cannot be
told from outside, and nothing is promised of its tracking.
"""

from collections import defaultdict
from dataclasses import dataclass
from math import inf, sqrt
from typing import Any

import numpy as np

from estimator_agents.condition import Condition
from estimator_agents.theory.tracking import Constants, Drive, constants
from orchestrator.scenario.setting import gain, target_of
from orchestrator.scenario.tables import Axis, Plant, Robot, Scenario
from plant_fmu.bundled.bounds import Bounds, bounds_of


@dataclass(frozen=True, slots=True)
class Bounded:
    """Robots of which the same can be promised."""

    robots: tuple[int, ...]
    plant: str
    drive: Drive
    lambda_d: float
    """‖τ_d‖₂ ≤ λ_d, N m; infinite for one that grows with time."""
    bounds: Bounds | None
    constants: Constants | None
    why: str
    """Why there are no constants; empty where there are."""


def bounded(scenario: Scenario) -> list[Bounded]:
    """Return a scenario's robots, those together of which the same can be promised."""
    own = {robot.id: robot for robot in scenario.robots}
    alike: defaultdict[str, list[int]] = defaultdict(list)
    common: dict[str, Robot] = {}
    for number in range(1, scenario.n + 1):
        robot = own.get(number, Robot(id=number))
        key = robot.model_dump_json(exclude={"id", "initial"})
        alike[key].append(number)
        common.setdefault(key, robot)
    whole = target_of(scenario).bounds()
    return [_bounded(scenario, common[key], robots, whole) for key, robots in alike.items()]


def tracking_conditions(scenario: Scenario) -> list[Condition]:
    """Return the conditions of Theorems 2 and 3 on the gains, each of the robot nearest to it.

    None unless P3 is known of all robots.
    """
    parts = bounded(scenario)
    known = [part.constants.conditions(part.drive) for part in parts if part.constants]
    if len(known) < len(parts):
        return []
    return [min(same, key=lambda c: c.margin) for same in zip(*known, strict=True)]


def _bounded(
    scenario: Scenario, robot: Robot, robots: list[int], whole: tuple[float, float]
) -> Bounded:
    """Return what bounds some robots; `whole` are γ1 and γ2."""
    plant = robot.plant or scenario.plant
    controller = robot.controller or scenario.controller
    disturbance = robot.disturbance or scenario.disturbance
    kp, kd = (gain(value, scenario.m) for value in (controller.kp, controller.kd))
    lambda_d = _largest(disturbance.axes)
    p3 = bounds_of(plant.fmu, _parameters(plant), scenario.m)
    why = _unknown(plant, p3, kp, kd, lambda_d)
    found = None
    if p3 is not None and not why:
        found = constants(p3, scenario.m, lambda_d, *whole)
    return Bounded(tuple(robots), plant.fmu, Drive.of(kp, kd), lambda_d, p3, found, why)


def _parameters(plant: Plant) -> dict[str, Any]:
    return {name: value for name, value in plant.parameters.items() if not isinstance(value, str)}


def _unknown(
    plant: Plant, p3: Bounds | None, kp: np.ndarray, kd: np.ndarray, lambda_d: float
) -> str:
    """Return why Theorems 2 and 3 say nothing; empty where they do."""
    if p3 is None:
        return f"the bounds of P3 are not known of {plant.fmu}"
    if np.any(kp - np.diag(np.diag(kp))) or np.any(kd - np.diag(np.diag(kd))):
        return "their proof needs diagonal gains"
    return "the disturbance grows with time" if lambda_d == inf else ""


def _largest(axes: tuple[Axis, ...]) -> float:
    """Return sup ‖τ_d‖₂, N m: as if all waves met."""
    if any(axis.rate for axis in axes):
        return inf
    sizes = (
        abs(axis.offset) + sum(abs(wave.amplitude) for wave in (*axis.sines, *axis.cosines))
        for axis in axes
    )
    return sqrt(sum(size**2 for size in sizes))
