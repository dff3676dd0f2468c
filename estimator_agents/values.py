"""Named arrays with one first axis: a row a robot, or a row an in-edge.

What an agent keeps, sends and receives is such values, by the names that its algorithm declares.
They do not change: an algorithm returns others.
"""

from collections.abc import Mapping
from typing import Any, Never

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import Fields, Sizes

Array = NDArray[np.float64]


class Values(dict[str, Array]):
    """Arrays by field: `x.position`, or `x["position"]`; `x.replace(position=…)` returns others."""

    __slots__ = ()

    def __getattr__(self, name: str) -> Array:
        """Return a field's array; `AttributeError` names those that there are."""
        try:
            return self[name]
        except KeyError:
            known = ", ".join(self) or "none"
            raise AttributeError(f"no field {name}; the fields here are {known}") from None

    def replace(self, **fields: Array) -> "Values":
        """Return the same values but for some fields; `TypeError` for one that is not there."""
        for name in fields:
            if name not in self:
                known = ", ".join(self) or "none"
                raise TypeError(f"no field {name}; the fields here are {known}")
        return Values({**self, **fields})

    def at(self, rows: Any) -> "Values":
        """Return some rows, by index or mask; of one row a field that is a number has no axis."""
        if isinstance(rows, np.ndarray) and rows.dtype != bool:  # `take` is ten times as fast
            return Values({name: value.take(rows, axis=0) for name, value in self.items()})
        return Values({name: np.asarray(value[rows]) for name, value in self.items()})

    def guarded(self) -> "Values":
        """Return the same values, whose arrays cannot be written."""
        views = {name: value.view() for name, value in self.items()}
        for view in views.values():
            view.flags.writeable = False
        return Values(views)

    def __setitem__(self, name: str, value: Array) -> Never:
        """Refuse."""
        raise TypeError(f"values do not change; x.replace({name}=…) returns others")

    def __setattr__(self, name: str, value: Any) -> Never:
        """Refuse."""
        raise TypeError(f"values do not change; x.replace({name}=…) returns others")


def initial_values(fields: Fields, rows: int, sizes: Sizes) -> Values:
    """Return rows of what fields are at first."""
    return Values(
        {
            name: np.full((rows, *field.size(sizes)), field.initial, float)
            for name, field in fields.items()
        }
    )


def flattened(values: Mapping[str, Array], rows: int) -> Array:
    """Return all fields side by side, (rows, …), in the order in which they are declared."""
    sizes = [int(np.prod(value.shape[1:], dtype=int)) for value in values.values()]
    columns = [
        value.reshape(rows, size) for value, size in zip(values.values(), sizes, strict=True)
    ]
    return np.concatenate([np.zeros((rows, 0)), *columns], axis=1)


def unflattened(flat: Array, fields: Fields, sizes: Sizes) -> Values:
    """Return the values of which `flattened` made rows; views where that can be."""
    found, at = {}, 0
    for name, field in fields.items():
        shape = field.size(sizes)
        width = int(np.prod(shape, dtype=int))
        found[name] = flat[:, at : at + width].reshape(len(flat), *shape)
        at += width
    return Values(found)
