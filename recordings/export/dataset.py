"""A recording as an xarray Dataset: what was recorded where it belongs, NaN everywhere else.

position, velocity, effort              (time, robot, joint)           the joints, output grid
reference_position, reference_velocity  (time, robot, joint)           what they follow
sample_position, sample_velocity        (sampling_time, robot, joint)  left limits at t_k
target_position, target_velocity        (sampling_time, joint)         the target's
"""

import numpy as np
import xarray
from numpy.typing import NDArray

from nrs_cosim.recordings.export.tables import (
    SAMPLES,
    STATES,
    MessageTable,
    about,
    joints,
    robots,
    rows,
)
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.units import vector_unit

_WHAT = {
    "position": "joint positions",
    "velocity": "joint velocities",
    "effort": "applied generalised forces",
    "reference_position": "estimate of the target's position, which the robot follows",
    "reference_velocity": "estimate of the target's velocity, which the robot follows",
    "sample_position": "estimate of the target's position, left limit at t_k",
    "sample_velocity": "estimate of the target's velocity, left limit at t_k",
    "target_position": "the target's position",
    "target_velocity": "the target's velocity",
}
_Variable = tuple[tuple[str, ...], NDArray[np.float64], dict[str, str]]


def dataset(reader: Reader) -> xarray.Dataset:
    """Return all samples and states of a recording, which must fit into memory twice.

    The unit of a variable is an attribute where all joints of all robots have the same. Raises
    `UnreadableError` as `rows` does.
    """
    run = about(reader).run
    n, m = robots(reader), joints(reader)
    parts: dict[str, list[NDArray[np.void]]] = {SAMPLES.name: [], STATES.name: []}
    for table, part in rows(reader, [SAMPLES, STATES]):
        parts[table.name].append(part)

    def spread(table: MessageTable) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
        found = np.concatenate([np.empty(0, table.dtype(m)), *parts.pop(table.name)])
        times, row = np.unique(found["time_ns"], return_inverse=True)
        grids = {}
        for name in table.kind.fields:
            grids[name] = np.full((len(times), n + 1, m), np.nan)
            grids[name][row, found["robot"]] = found[name]
        return times / 1e9, grids

    grid, states = spread(STATES)
    at, samples = spread(SAMPLES)
    units = {joint.unit for group in run.plants for joint in group.joints}
    coordinate = units.pop() if len(units) == 1 else ""

    def variable(dims: tuple[str, ...], name: str, values: NDArray[np.float64]) -> _Variable:
        attributes = {"long_name": _WHAT[name]}
        if unit := vector_unit(name, coordinate):
            attributes["units"] = unit
        return (*dims, "joint"), values, attributes

    variables = {
        name: variable(("time", "robot"), name, values[:, 1:]) for name, values in states.items()
    }
    for name, values in samples.items():
        sampled, target = f"sample_{name}", f"target_{name}"
        variables[sampled] = variable(("sampling_time", "robot"), sampled, values[:, 1:])
        variables[target] = variable(("sampling_time",), target, values[:, 0])
    seconds = {"units": "s", "long_name": "simulated time"}
    return xarray.Dataset(
        variables,
        {
            "time": ("time", grid, seconds),
            "sampling_time": ("sampling_time", at, seconds),
            "robot": ("robot", np.arange(1, n + 1)),
            "joint": ("joint", np.arange(1, m + 1)),
        },
        {
            "name": run.name,
            "status": reader.status,
            **({"digest": reader.digest} if reader.digest else {}),
            "seed": run.seed,
        },
    )
