"""What robots start with, (rows, m), a row a robot: as given for all or for one, or as drawn.

A draw is keyed by (seed, what is drawn, robot): it depends neither on the order in which robots
are built nor on where they run.
"""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.random_streams import random_stream
from nrs_cosim.orchestrator.scenario.tables.scenario import Scenario
from nrs_cosim.orchestrator.scenario.tables.values import Uniform

Array = NDArray[np.float64]
Quantity = Literal["position", "velocity", "q", "qd"]


def initial_rows(scenario: Scenario, name: Quantity, robots: Sequence[int]) -> Array:
    """Return one of the four initial quantities of some robots, (rows, m)."""
    given = getattr(scenario.initial, name)
    own = {robot.id: getattr(robot.initial, name) for robot in scenario.robots}
    rows = np.empty((len(robots), scenario.m))
    for row, robot in enumerate(robots):
        source = own.get(robot)
        if source is None:
            source = given[robot - 1] if _is_matrix(given) else given
        if isinstance(source, Uniform):
            source = draw(scenario.run.seed, name, robot, source, scenario.m)
        rows[row] = source
    return rows


def _is_matrix(given: Any) -> bool:
    return isinstance(given, tuple) and any(isinstance(row, tuple) for row in given)


def draw(seed: int, purpose: str, robot: int, uniform: Uniform, m: int) -> Array:
    """Draw m numbers, uniform in [low, high), for one purpose and robot."""
    low, high = uniform.uniform
    return low + (high - low) * random_stream(seed, purpose, robot).random(m)
