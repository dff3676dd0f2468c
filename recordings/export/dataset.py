"""A recording as an xarray Dataset: what was recorded where it belongs, NaN everywhere else.

position, velocity, effort              (time, robot, joint)           the joints, output grid
reference_position, reference_velocity  (time, robot, joint)           what they follow
sample_position, sample_velocity        (sampling_time, robot, joint)  left limits at t_k
target_position, target_velocity        (sampling_time, joint)         the target's

An algorithm may send other fields, `sample_<field>` and `target_<field>`, and its agents may keep
more, `agent_<field>`; what pinned robots measured at t_k is `measured_<field>`. An axis of m
numbers is `joint`, one of n `other_robot`, one of in-degrees `in_neighbour`, and any other one the
variable's own, as is a second one of a kind. `joint_name` and `joint_unit` say what each robot's
joints are called, and what their positions are in.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np
import xarray
from numpy.typing import NDArray

from nrs_cosim.bus.fields import Field, Shape
from nrs_cosim.recordings.export.tables import (
    AGENT_STATES,
    MEASUREMENTS,
    SAMPLES,
    STATES,
    MessageTable,
    layout,
    rows,
)
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.schemas import about, recorded_types
from nrs_cosim.recordings.units import coordinate_of, field_unit, joints_of_each

_MEANING = {
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
_AXES = {"m": "joint", "n": "other_robot", "in_degree": "in_neighbour"}
Array = NDArray[np.float64]
_Variable = tuple[tuple[str, ...], Array, dict[str, str]]
_PREFIX = {"state": "", "sample": "sample_", "agent_state": "agent_", "measurement": "measured_"}


def dataset(reader: Reader) -> xarray.Dataset:
    """Return all samples and states of a recording, which must fit into memory twice.

    The unit of a variable is an attribute where all joints of all robots have the same. Raises
    `UnreadableError` as `rows` does.
    """
    run, types = about(reader).run, recorded_types(reader)
    n, sampled = run.robots, [SAMPLES, AGENT_STATES, MEASUREMENTS]
    parts: dict[str, list[NDArray[np.void]]] = {table.name: [] for table in (STATES, *sampled)}
    for table, part in rows(reader, [STATES, *sampled]):
        parts[table.name].append(part)

    def spread(tables: Sequence[MessageTable]) -> tuple[Array, dict[tuple[str, str], Array]]:
        """Return the times of tables, s, and arrays (times, n + 1, …) by kind and field."""
        layouts = [layout(types, table) for table in tables]
        found = [
            np.concatenate([np.empty(0, of.dtype), *parts.pop(of.table.name)]) for of in layouts
        ]
        times = np.unique(np.concatenate([table["time_ns"] for table in found]))
        grids = {}
        for of, table in zip(layouts, found, strict=True):
            row = np.searchsorted(times, table["time_ns"])
            for name, shape in of.shapes.items():
                grid = np.full((len(times), n + 1, *shape), np.nan)
                grid[row, table["robot"]] = table[name]
                grids[of.table.kind, name] = grid
        return times / 1e9, grids

    grid, states = spread([STATES])
    at, samples = spread(sampled)
    coordinate = coordinate_of(run)
    sizes: dict[str, int] = {"joint": run.joints}

    def variable(dims: Sequence[str], full: str, kind: str, name: str, values: Array) -> _Variable:
        field = types.codecs[kind].kind.fields[name]
        axes = _axes(full, field, values.shape[len(dims) :])
        sizes.update(axes)
        attributes = {"long_name": _MEANING.get(full) or field.doc or name}
        if unit := field_unit(name, field, coordinate):
            attributes["units"] = unit
        return (*dims, *axes), values, attributes

    variables = {}
    for (kind, name), values in {**states, **samples}.items():
        full = _PREFIX[kind] + name
        dims = ("time" if kind == "state" else "sampling_time", "robot")
        variables[full] = variable(dims, full, kind, name, values[:, 1:])
        if kind == "sample":
            full = f"target_{name}"
            variables[full] = variable(dims[:1], full, kind, name, values[:, 0])
    joints = joints_of_each(run).values()
    seconds = {"units": "s", "long_name": "simulated time"}
    return xarray.Dataset(
        variables,
        {
            "time": ("time", grid, seconds),
            "sampling_time": ("sampling_time", at, seconds),
            "robot": ("robot", np.arange(1, n + 1)),
            "joint_name": (("robot", "joint"), [[one.name for one in of] for of in joints]),
            "joint_unit": (("robot", "joint"), [[one.unit for one in of] for of in joints]),
            **{
                axis: (axis, np.arange(1, sizes[axis] + 1))
                for axis in _AXES.values()
                if axis in sizes
            },
        },
        {
            "name": run.name,
            "status": reader.status,
            **({"digest": reader.digest} if reader.digest else {}),
            "seed": run.seed,
        },
    )


def _axes(variable: str, field: Field, shape: Shape) -> dict[str, int]:
    """Return the names of a field's axes, each once, with their sizes."""
    seen: Counter[str] = Counter()
    found = {}
    for number, (axis, size) in enumerate(zip(field.shape, shape, strict=True), 1):
        name = _AXES.get(str(axis), "")
        seen[name] += 1
        own = not name or seen[name] > 1
        found[f"{variable}_axis_{number}" if own else name] = size
    return found
