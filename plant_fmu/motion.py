"""An FMU that nothing drives has a motion: its `position` and `velocity` at given times, from t_0.

Its inputs keep their start values. It is run once, in Co-Simulation if it can be.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import pairwise
from typing import Any

import numpy as np

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.drives.choice import Undriven
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of
from nrs_cosim.plant_fmu.isolation.isolated import IsolatedPlants
from nrs_cosim.plant_fmu.plants import Array, Body, Disturbance


def fmu_motion(
    archive: Archive,
    parameters: Mapping[str, Any],
    names: Mapping[str, Spec],
    times: Sequence[float],
    deadline: float | None,
) -> tuple[Array, Array]:
    """Return positions and velocities (s, m), in SI, at s increasing times, s, the first of them 0.

    With a deadline, s for each of its calls, the FMU runs in a process of its own. `FmuError` says
    what is wrong with it, `StepError` when it failed and why.
    """
    sizes = sizes_of(assignments(archive, parameters))
    m = find_quantity(archive, "position", names, sizes=sizes).size
    find_quantity(archive, "velocity", names, size=m, sizes=sizes)
    body, motion = _body(m, parameters), np.empty((2, len(times), m))
    with ExitStack() as stack:
        plants = (
            open_plants(stack, archive, [body], names, Undriven())
            if deadline is None
            else IsolatedPlants(stack, archive, [body], names, Undriven(), deadline)
        )
        motion[:, 0] = plants.q[0], plants.qd[0]
        for row, (start, end) in enumerate(pairwise(times), 1):
            plants.advance(start, end - start)
            motion[:, row] = plants.q[0], plants.qd[0]
    return motion[0], motion[1]


def _body(m: int, parameters: Mapping[str, Any]) -> Body:
    """Return node 0, of which nothing is known but its parameters."""
    none, matrix = np.zeros(m), np.zeros((m, m))
    still = Disturbance(none, none, *np.zeros((3, m, 0)))
    return Body(0, parameters, matrix, matrix, still, none, none, none, none)
