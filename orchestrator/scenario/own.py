"""What one robot has of its own: the keys that its table gives, over those that all robots share.

A table of `[[robots]]` changes the keys that it has and keeps the others, `parameters` and
`variables` name by name. An FMU is the exception: names, parameters and the way of driving are of
one FMU, so a plant that gives its own `fmu` is whole, and takes nothing of the shared one.
"""

from typing import TypeVar

from pydantic import BaseModel

from nrs_cosim.orchestrator.scenario.tables.fmus import Plant
from nrs_cosim.orchestrator.scenario.tables.scenario import Controller, Disturbance, Robot, Scenario

Shared = TypeVar("Shared", bound=BaseModel)


def plant_of(scenario: Scenario, robot: Robot) -> Plant:
    """Return the plant of a robot."""
    own, shared = robot.plant, scenario.plant
    if own is None:
        return shared
    if own.fmu is not None:
        return _over(Plant(fmu=own.fmu), own)
    merged = _over(shared, own)
    names = {
        "parameters": {**shared.parameters, **own.parameters},
        "variables": {**shared.variables, **own.variables},
    }
    return merged.model_copy(update=names)


def controller_of(scenario: Scenario, robot: Robot) -> Controller:
    """Return the PD gains of a robot."""
    return _over(scenario.controller, robot.controller)


def disturbance_of(scenario: Scenario, robot: Robot) -> Disturbance:
    """Return the disturbance of a robot."""
    return _over(scenario.disturbance, robot.disturbance)


def own_plants(scenario: Scenario) -> dict[int, Plant]:
    """Return the plants of those robots that have something of their own in theirs."""
    return {robot.id: plant_of(scenario, robot) for robot in scenario.robots if robot.plant}


def _over(shared: Shared, own: BaseModel | None) -> Shared:
    """Return a table with the keys of another, as they were given, in place of its own."""
    given = own.model_fields_set if own else ()
    return shared.model_copy(update={name: getattr(own, name) for name in given})
