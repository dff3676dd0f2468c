"""The units of a message's vectors follow from the units of the joints' coordinates: rad or m."""

_UNITS = {
    "position": {"rad": "rad", "m": "m"},
    "velocity": {"rad": "rad/s", "m": "m/s"},
    "effort": {"rad": "N m", "m": "N"},
}


def vector_unit(vector: str, coordinate: str) -> str:
    """Return the unit of a joint's number in a vector; empty where the coordinate has none.

    A vector's name ends with what it is: position, velocity or effort.
    """
    return _UNITS[vector.rpartition("_")[2]].get(coordinate, "")
