"""A field is a declared quantity: doubles of one shape, with a name, a unit and a meaning.

A shape is a tuple of numbers and of the symbols m (axes of a robot), n (robots) and in_degree (the
largest number of in-neighbours); the empty one is a scalar's. An array of shape (r, c) has the
columns name_1_1, name_1_2, …, name_r_c, in the order of its numbers in a message.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from keyword import iskeyword
from math import isfinite, prod
from typing import Any

SYMBOLS = ("m", "n", "in_degree")
TRUTHS = ("position", "velocity", "acceleration")
"""What a target can be asked for."""
RESERVED = frozenset(
    {"robot", "k", "time_ns", "t", "source", "lost", "outage", "delay", "duplicates"}
)
"""Names that messages and tables have for themselves."""
MOST_AXES = 4
MOST_NUMBERS = 2**20
"""Of one field; more than any robot has joints, and 8 MiB."""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_INDICES = re.compile(r"(_[0-9]+)+")
Shape = tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Sizes:
    """What the symbols of shapes stand for in a run."""

    m: int
    n: int = 1
    in_degree: int = 1


@dataclass(frozen=True, slots=True)
class Field:
    """One declared quantity."""

    shape: tuple[str | int, ...] = ("m",)
    """Numbers, and symbols of `SYMBOLS`; () is a scalar."""
    initial: float = 0.0
    """Of each number, unless a scenario gives another."""
    truth: str | None = None
    """Which quantity of the target it stands for, of `TRUTHS`; None for one that has no truth."""
    unit: str | None = None
    """None where it follows from the joint's coordinate, or is not known."""
    doc: str = ""
    """What it means, in a few words."""

    def size(self, sizes: Sizes) -> Shape:
        """Return its shape in numbers."""
        return tuple(getattr(sizes, axis) if isinstance(axis, str) else axis for axis in self.shape)


Fields = Mapping[str, Field]

ESTIMATE: Fields = {
    "position": Field(truth="position", doc="estimate of the target's position"),
    "velocity": Field(truth="velocity", doc="estimate of the target's velocity"),
}
"""What an algorithm sends and keeps that declares neither: ε and υ."""


def column_names(name: str, shape: Shape) -> list[str]:
    """Return a name for each number of an array: name, name_i, name_i_j, …, from 1."""
    return indexed_names(name, [range(1, size + 1) for size in shape])


def indexed_names(name: str, axes: Sequence[Sequence[int]]) -> list[str]:
    """Return the same for a part of an array, of the given numbers along each axis."""
    return ["_".join([name, *map(str, index)]) for index in product(*axes)]


def wrong_fields(fields: Mapping[str, Any]) -> Iterator[str]:
    """Yield what is wrong with declared fields, in words that begin with the field's name."""
    flat: dict[str, str] = {}
    for name, field in fields.items():
        if not isinstance(name, str) or not _NAME.fullmatch(name) or iskeyword(name):
            yield f"{name!r}: expected a name of letters, digits and _, which begins with a letter"
            continue
        if name in RESERVED:
            yield f"{name}: is a name that every message has; give another"
        # The JSON names of protobuf have neither underscores nor, for some readers, case.
        if (other := flat.setdefault(name.replace("_", "").lower(), name)) != name:
            yield f"{name}: differs from {other} in case or _ alone; give another name"
        for other in fields:
            if isinstance(other, str) and _INDICES.fullmatch(name.removeprefix(other) or " "):
                yield f"{name}: is what a column of {other} may be called; give another name"
        if not isinstance(field, Field):
            yield f"{name}: expected a Field, got {field!r}"
        else:
            yield from (f"{name}: {what}" for what in _wrong_field(field))


def _wrong_field(field: Field) -> Iterator[str]:
    shape: Any = field.shape
    if not isinstance(shape, tuple) or not all(map(_is_axis, shape)):
        yield (
            f"shape: expected a tuple of whole numbers > 0 and of {', '.join(SYMBOLS)}, "
            f"got {shape!r}"
        )
    elif len(shape) > MOST_AXES:
        yield f"shape: expected at most {MOST_AXES} axes, got {len(shape)}"
    elif prod(axis for axis in shape if isinstance(axis, int)) > MOST_NUMBERS:
        yield f"shape: expected at most {MOST_NUMBERS} numbers, got {shape!r}"
    initial: Any = field.initial
    if isinstance(initial, bool) or not isinstance(initial, int | float) or not isfinite(initial):
        yield f"initial: expected a finite number, got {initial!r}"
    if field.truth is not None and field.truth not in TRUTHS:
        yield f"truth: expected one of {', '.join(TRUTHS)}, got {field.truth!r}"
    for what, text in (("unit", field.unit or ""), ("doc", field.doc)):
        if not isinstance(text, str):
            yield f"{what}: expected text, got {text!r}"


def _is_axis(axis: Any) -> bool:
    if isinstance(axis, str):
        return axis in SYMBOLS
    return isinstance(axis, int) and not isinstance(axis, bool) and axis > 0
