"""What joints are called, and the units of fields: as declared, or from joints' coordinates."""

import re
from collections.abc import Collection, Sequence

import numpy as np

from nrs_cosim.bus.fields import Field, column_names
from nrs_cosim.bus.messages import Codec
from nrs_cosim.recordings.metadata import JointRecord, RunRecord

_UNITS = {
    "position": {"rad": "rad", "m": "m"},
    "velocity": {"rad": "rad/s", "m": "m/s"},
    "acceleration": {"rad": "rad/s^2", "m": "m/s^2"},
    "effort": {"rad": "N m", "m": "N"},
}
MIXED, UNKNOWN = "mixed units", "unit not known"
"""Stand where a number is over joints some or all of which have no unit that an FMU gives."""
_BOTH = " and "


def coordinate_of(run: RunRecord) -> str:
    """Return the unit of all joints of all robots; empty where they have several, or none."""
    units = {joint.unit for group in run.plants for joint in group.joints}
    return units.pop() if len(units) == 1 else ""


def field_unit(name: str, field: Field, coordinate: str) -> str:
    """Return the unit of a joint's number in a field; empty where none is known.

    A field that declares none has that of what its name ends with, or of what it stands for.
    """
    if field.unit is not None:
        return field.unit
    return quantity_unit(name, coordinate) or _UNITS.get(field.truth or "", {}).get(coordinate, "")


def quantity_unit(name: str, coordinate: str) -> str:
    """Return the unit of what a name ends with; empty where it is none of a joint's quantities.

    >>> quantity_unit("reference_velocity", "rad"), quantity_unit("effort", "rad and m")
    ('rad/s', 'N m and N')
    """
    of = _UNITS.get(name.rpartition("_")[2], {})
    units = [of.get(one, "") for one in coordinate.split(_BOTH)]
    return _BOTH.join(units) if all(units) else ""


def unit_over(units: Collection[str]) -> str:
    """Return the unit of all of some joints, several as `rad and m`, or in words why there is none.

    >>> unit_over(["rad", "m", "rad"]), unit_over(["rad", ""]), unit_over([""])
    ('rad and m', 'mixed units', 'unit not known')
    """
    found = {*units} or {""}
    if "" in found or UNKNOWN in found or MIXED in found:
        return UNKNOWN if found <= {"", UNKNOWN} else MIXED
    return _BOTH.join(sorted({unit for one in found for unit in one.split(_BOTH)}, reverse=True))


def unit_of_joints(*runs: RunRecord) -> str:
    """Return `unit_over` all joints of all robots of some runs."""
    return unit_over({joint.unit for run in runs for group in run.plants for joint in group.joints})


def rate_of(unit: str) -> str:
    """Return the unit of a velocity, of the position's unit or what stands for it."""
    if unit in {MIXED, UNKNOWN}:
        return unit
    return _BOTH.join(f"{one}/s" for one in unit.split(_BOTH))


def on_axis(label: str, unit: str) -> str:
    """Return an axis' label: with a unit, but not with the words that none is known."""
    return label if unit == UNKNOWN else f"{label} ({unit})"


def joints_of_each(run: RunRecord) -> dict[int, tuple[JointRecord, ...]]:
    """Return the joints of each robot, in the order of their numbers."""
    return dict(sorted((robot, group.joints) for group in run.plants for robot in group.robots))


def shared_joints(run: RunRecord) -> tuple[JointRecord, ...]:
    """Return the joints of all robots where these are alike; none where they are not."""
    found = {group.joints for group in run.plants}
    return found.pop() if len(found) == 1 else ()


def joint_names(names: Sequence[str], m: int) -> list[str]:
    """Return what m joints are called; one by its number where its FMU has no better name."""
    return [
        f"joint {number}" if re.fullmatch(r"(q\[\d+\])?", name) else name
        for number, name in enumerate(names or [""] * m, 1)
    ]


def column_notes(codec: Codec | None, run: RunRecord) -> dict[str, dict[str, str]]:
    """Return the unit and the joint of each column of a table, as far as all robots share them."""
    notes = {"time_ns": {"unit": "ns"}, "t": {"unit": "s"}}
    joints, coordinate = shared_joints(run), coordinate_of(run)
    for name, field in codec.kind.fields.items() if codec else ():
        shape = codec.shapes[name] if codec else ()
        axis = field.shape.index("m") if "m" in field.shape and joints else None
        for column, index in zip(column_names(name, shape), np.ndindex(shape), strict=True):
            joint = None if axis is None else joints[index[axis]]
            note = {
                "unit": field_unit(name, field, joint.unit if joint else coordinate),
                "joint": joint.name if joint else "",
            }
            notes[column] = {key: value for key, value in note.items() if value}
    return notes
