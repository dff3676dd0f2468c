"""What robots start with, a row a robot: as given for all or for one, or as drawn.

A draw is keyed by (seed, what is drawn, robot): it depends neither on the order in which robots
are built nor on where they run.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.random_streams import random_stream
from nrs_cosim.orchestrator.scenario.tables.scenario import Initial, Scenario
from nrs_cosim.orchestrator.scenario.tables.values import Uniform

Array = NDArray[np.float64]
Shape = tuple[int, ...]


def initial_rows(
    scenario: Scenario, name: str, robots: Sequence[int], shape: Shape, default: float = 0.0
) -> Array:
    """Return what some robots start with of one field, (rows, *shape)."""
    given = scenario.initial.given(name)
    own = {robot.id: robot.initial.given(name) for robot in scenario.robots}
    drawn, of_all = isinstance(given, Uniform), np.zeros(0)
    if not drawn:
        of_all = np.asarray(default if given is None else given, float)
    rows = np.empty((len(robots), *shape))
    for row, robot in enumerate(robots):
        source = own.get(robot)
        if source is None:
            source = given if drawn else of_all[robot - 1] if of_all.ndim > len(shape) else of_all
        if isinstance(source, Uniform):
            source = draw(scenario.run.seed, _purpose(name), robot, source, shape)
        rows[row] = source
    return rows


def _purpose(name: str) -> str:
    """Return what is drawn: other draws have names of their own, which fields may have too."""
    return name if name in Initial.model_fields else f"initial {name}"


def draw(seed: int, purpose: str, robot: int, uniform: Uniform, shape: Shape) -> Array:
    """Draw numbers, uniform in [low, high), for one purpose and robot."""
    low, high = uniform.uniform
    return low + (high - low) * random_stream(seed, purpose, robot).random(shape)
