"""What one robot has of its own: the keys that its table gives, over those that all robots share.

A table of `[[robots]]` changes the keys that it has and keeps the others, `parameters` and
`variables` name by name. An FMU is the exception: names, parameters and the way of driving are of
one FMU, so a plant that gives its own `fmu` is whole, and takes nothing of the shared one.
"""

from dataclasses import dataclass
from typing import TypeVar

from pydantic import BaseModel

from nrs_cosim.orchestrator.scenario.tables.fmus import OwnPlant, Plant
from nrs_cosim.orchestrator.scenario.tables.scenario import (
    Controller,
    Disturbance,
    OwnController,
    Scenario,
)

Shared = TypeVar("Shared", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class Own:
    """What one robot has, whether it is its own or shared."""

    field: str
    """Where the scenario gives its plant."""
    plant: Plant
    controller: Controller
    disturbance: Disturbance


def own_of(scenario: Scenario) -> dict[int, Own]:
    """Return what those robots have that have a table of their own, by number."""
    return {
        robot.id: Own(
            f"robots[{i}].plant" if robot.plant else "plant",
            _plant_over(scenario.plant, robot.plant),
            _controller_over(scenario.controller, robot.controller),
            _over(scenario.disturbance, robot.disturbance),
        )
        for i, robot in enumerate(scenario.robots)
    }


def _plant_over(shared: Plant, own: OwnPlant | None) -> Plant:
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


def _controller_over(shared: Controller, own: OwnController | None) -> Controller:
    """Return a controller with a robot's own keys; gains of the other kind are none beside them."""
    if own is None:
        return shared
    given = own.model_fields_set
    if given & {"frequency", "damping"}:
        shared = shared.model_copy(update={"kp": None, "kd": None})
    if given & {"kp", "kd"}:
        shared = shared.model_copy(update={"frequency": None, "damping": None})
    return _over(shared, own)


def _over(shared: Shared, own: BaseModel | None) -> Shared:
    """Return a table with the keys of another, as they were given, in place of its own."""
    if own is None:
        return shared
    given = own.model_fields_set
    return shared.model_copy(update={name: getattr(own, name) for name in given})
