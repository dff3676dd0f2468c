"""A quantity of ours is a variable of the FMU's: an array (FMI 3), or scalars `name[i]`, 1-based.

Its values are always passed flat, in row-major order, so that both look alike from here on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from math import prod

from fmpy.model_description import ModelVariable

from plant_fmu.archive import Archive
from plant_fmu.errors import FmuError

_REAL = ("Real", "Float64")


@dataclass(frozen=True, slots=True)
class Quantity:
    """The value references that stand for one quantity, and how many numbers they hold."""

    name: str
    references: tuple[int, ...]
    size: int


def find_quantity(archive: Archive, name: str) -> Quantity:
    """Return the value references of a quantity; `FmuError` when the FMU has none of that name."""
    family = [
        variable
        for variable in archive.description.modelVariables
        if variable.name == name or _is_entry(variable.name, name)
    ]
    if not family:
        raise FmuError(f"{archive.label}: has no variable {name!r}{_suggestion(archive, name)}")
    for variable in family:
        if variable.type not in _REAL:
            raise FmuError(
                f"{archive.label}: variable {variable.name!r} is of type {variable.type}, "
                f"expected {' or '.join(_REAL)}"
            )
    size = sum(prod(variable.shape or (1,)) for variable in family)
    return Quantity(name, tuple(variable.valueReference for variable in family), size)


def references(quantities: Sequence[Quantity]) -> tuple[int, ...]:
    """Return the value references of several quantities, to be passed in one call."""
    return tuple(reference for quantity in quantities for reference in quantity.references)


def _is_entry(name: str, family: str) -> bool:
    """Whether a scalar is an entry of a family: `q[2]` of `q`, or `kp[1,2]` of `kp`."""
    head, bracket, index = name.partition("[")
    return head == family and bracket == "[" and index.rstrip("]").replace(",", "").isdigit()


def _suggestion(archive: Archive, name: str) -> str:
    variables: list[ModelVariable] = archive.description.modelVariables
    known = sorted({variable.name.partition("[")[0] for variable in variables})
    close = get_close_matches(name, known, n=1)
    return f"; did you mean {close[0]!r}?" if close else f"; it has {', '.join(known)}"
