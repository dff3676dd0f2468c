"""The units of a message's fields: as declared, or from the joints' coordinates, rad or m."""

from nrs_cosim.bus.fields import Field
from nrs_cosim.recordings.metadata import RunRecord

_UNITS = {
    "position": {"rad": "rad", "m": "m"},
    "velocity": {"rad": "rad/s", "m": "m/s"},
    "acceleration": {"rad": "rad/s^2", "m": "m/s^2"},
    "effort": {"rad": "N m", "m": "N"},
}


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
    of = _UNITS.get(name.rpartition("_")[2]) or _UNITS.get(field.truth or "", {})
    return of.get(coordinate, "")
