"""A recording on grids, a chunk at a time: what was recorded where it belongs, NaN everywhere else.

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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import Field
from nrs_cosim.recordings.export.selection import ALL, Selected
from nrs_cosim.recordings.export.tables import (
    AGENT_STATES,
    MEASUREMENTS,
    SAMPLES,
    STATES,
    MessageTable,
    TableLayout,
    layout,
    rows_of,
    topics_of,
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
_PREFIX = {STATES: "", SAMPLES: "sample_", AGENT_STATES: "agent_", MEASUREMENTS: "measured_"}
DIMENSIONS = {"time": (STATES,), "sampling_time": (SAMPLES, AGENT_STATES, MEASUREMENTS)}
"""What grows, and of which tables."""
SECONDS = {"units": "s", "long_name": "simulated time"}
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GridVariable:
    """A field of a table on its grid."""

    table: MessageTable
    field: str
    is_target: bool
    dimensions: tuple[str, ...]
    shape: tuple[int, ...]
    """Without the first dimension, which grows."""
    attributes: Mapping[str, str]


class Grids:
    """What variables there are of a selection, and their values."""

    def __init__(self, reader: Reader, selection: Selected = ALL) -> None:
        self._reader, self._selection = reader, selection
        self._run, self._types = about(reader).run, recorded_types(reader)
        self.robots = [*(selection.robots or range(1, self._run.robots + 1))]
        self._place = np.zeros(self._run.robots + 1, np.intp)
        """Of each robot, behind the target."""
        self._place[self.robots] = np.arange(1, len(self.robots) + 1)
        self.variables: dict[str, GridVariable] = {}
        self.axes: dict[str, Sequence[int]] = {}
        """Of each other dimension what its places are called, by numbers from 1."""
        self.axes["joint"] = selection.joints or range(1, self._run.joints + 1)
        self._layouts = {table: layout(self._types, table, selection.joints) for table in _PREFIX}
        for dimension, tables in DIMENSIONS.items():
            for table in tables:
                for name in self._layouts[table].shapes:
                    self._add(dimension, self._layouts[table], name, _PREFIX[table] + name)
                    if table is SAMPLES:
                        self._add(dimension, self._layouts[table], name, f"target_{name}")

    def _add(self, dimension: str, of: TableLayout, name: str, full: str) -> None:
        assert of.codec is not None  # it has a field
        field, is_target = of.codec.kind.fields[name], full.startswith("target_")
        axes = dict(zip(_axes(full, field), of.numbers[name], strict=True))
        self.axes |= axes
        attributes = {"long_name": _MEANING.get(full) or field.doc or name}
        if unit := field_unit(name, field, coordinate_of(self._run)):
            attributes["units"] = unit
        robot = () if is_target else ("robot",)
        shape = (*(len(self.robots) for _ in robot), *map(len, axes.values()))
        dimensions = (dimension, *robot, *axes)
        self.variables[full] = GridVariable(
            of.table, name, is_target, dimensions, shape, attributes
        )

    @property
    def joints(self) -> dict[str, list[list[str]]]:
        """What each robot's joints are called, and the units of their positions."""
        of_each = joints_of_each(self._run)
        chosen = [[of_each[i][j - 1] for j in self.axes["joint"]] for i in self.robots]
        return {
            "joint_name": [[joint.name for joint in of] for of in chosen],
            "joint_unit": [[joint.unit for joint in of] for of in chosen],
        }

    @property
    def attributes(self) -> dict[str, str | int]:
        """What is told of the run."""
        reader, run = self._reader, self._run
        digest = {"digest": reader.digest} if reader.digest else {}
        return {"name": run.name, "status": reader.status, **digest, "seed": run.seed}

    def parts(self) -> Iterator[tuple[str, Array, dict[str, Array]]]:
        """Yield a dimension that grows, its next times, s, and the values of its variables then.

        Raises `UnreadableError` as `rows` does.
        """
        reader, selection, nodes = self._reader, self._selection, self._selection.nodes
        topics = topics_of(reader, [*_PREFIX], nodes)
        for messages in reader.columns(topics, selection.start_ns, selection.end_ns):
            for dimension, tables in DIMENSIONS.items():
                found = {
                    table: self._layouts[table].narrowed(rows)
                    for table in tables
                    if (rows := rows_of(reader, self._types, table, messages, nodes)) is not None
                }
                if found:
                    times, values = self._spread(dimension, found)
                    yield dimension, times / 1e9, values

    def _spread(
        self, dimension: str, found: Mapping[MessageTable, NDArray[np.void]]
    ) -> tuple[NDArray[np.int64], dict[str, Array]]:
        times = np.unique(np.concatenate([rows["time_ns"] for rows in found.values()]))
        values = {}
        for full, of in self.variables.items():
            if of.dimensions[0] != dimension:
                continue
            values[full] = grid = np.full((len(times), *of.shape), np.nan)
            if (rows := found.get(of.table)) is not None:
                rows = rows[(rows["robot"] == 0) == of.is_target]
                at = np.searchsorted(times, rows["time_ns"])
                place = (at,) if of.is_target else (at, self._place[rows["robot"]] - 1)
                grid[place] = rows[of.field]
        return times, values


def _axes(variable: str, field: Field) -> list[str]:
    """Return the names of a field's axes, each once."""
    seen: Counter[str] = Counter()
    found = []
    for number, axis in enumerate(field.shape, 1):
        name = _AXES.get(str(axis), "")
        seen[name] += 1
        own = not name or seen[name] > 1
        found.append(f"{variable}_axis_{number}" if own else name)
    return found
