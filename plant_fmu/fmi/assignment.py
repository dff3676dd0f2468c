"""What a user gives to variables of an FMU: each value in its FMI type, or an error.

Values are in the units that the FMU declares. Only what FMI lets be set before initialisation can
be given: parameters, inputs, and start values (FMI 3.0, section 2.4.7.4). Structural parameters
come first, since they decide how many numbers the others hold.
"""

import ctypes
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from math import prod
from numbers import Integral, Real
from typing import Any

import numpy as np

from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.lookup import find_variables, listed, suggestion
from nrs_cosim.plant_fmu.archives.records import ModelVariable
from nrs_cosim.plant_fmu.archives.variables import shape_of
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.calls import Calls, c_references

_FLOATS = {"Real": ctypes.c_double, "Float64": ctypes.c_double, "Float32": ctypes.c_float}
_PARAMETERS = {"parameter", "structuralParameter"}
_INTEGERS = {
    "Integer": ctypes.c_int32,
    **{f"Int{bits}": getattr(ctypes, f"c_int{bits}") for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": getattr(ctypes, f"c_uint{bits}") for bits in (8, 16, 32, 64)},
}


@dataclass(frozen=True, slots=True, eq=False)
class StartValues:
    """Values for variables of one FMI type, ready to be passed."""

    name: str
    """As the user wrote it."""
    type: str
    references: tuple[int, ...]
    values: Any
    """A C array."""
    structural: bool

    def acts(self, calls: Calls, handle: int) -> Iterator[int]:
        """Set the values in an instance that is not initialised yet; yield each FMI status."""
        count = (len(self.values),) if calls.counts_values else ()
        which = c_references(self.references)
        if self.structural:
            yield calls.enter_configuration(handle)
        yield calls.set_typed(self.type)(handle, which, len(which), self.values, *count)
        if self.structural:
            yield calls.exit_configuration(handle)


def assignments(archive: Archive, parameters: Mapping[str, Any]) -> list[StartValues]:
    """Return what to set, structural parameters first.

    A value is a number, a truth, a text, or lists of them, as the variable's shape; a flat list is
    row-major. `FmuError` names the variable, its type, and what was given or why it cannot be set.
    """
    found = [(name, _settable(archive, name), value) for name, value in parameters.items()]
    found.sort(key=lambda item: item[1][0].causality != "structuralParameter")
    assigned: list[StartValues] = []
    for name, variables, value in found:
        assigned.append(_assignment(archive, name, variables, value, sizes_of(assigned)))
    return assigned


def sizes_of(assigned: Iterable[StartValues]) -> dict[int, int]:
    """Return the values of structural parameters by value reference."""
    return {
        assignment.references[0]: assignment.values[0]
        for assignment in assigned
        if assignment.structural and assignment.type in _INTEGERS
    }


def _settable(archive: Archive, name: str) -> tuple[ModelVariable, ...]:
    variables = find_variables(archive, name)
    if not variables:
        settable = [v for v in archive.description.modelVariables if not unsettable(v)]
        known = [v.name for v in settable if v.causality in _PARAMETERS]
        what = suggestion(name, known) if known else "; it has none"
        raise FmuError(f"{archive.label}: has no parameter {quoted(name)}{what}")
    for variable in variables:
        if reason := unsettable(variable):
            raise FmuError(
                f"{archive.label}: {quoted(variable.name)} cannot be set: it is {reason}"
            )
    return variables


def unsettable(variable: ModelVariable) -> str:
    """Return why FMI does not let a variable be set before initialisation, or nothing."""
    if variable.variability == "constant":
        return "a constant"
    if variable.causality == "independent":
        return "the time"
    if variable.causality == "calculatedParameter":
        return "calculated from other parameters"
    if variable.causality in {"output", "local"} and variable.initial not in {"exact", "approx"}:
        article = "an" if variable.causality == "output" else "a"
        return f"{article} {variable.causality} that the FMU calculates"
    if variable.type in {"Binary", "Clock"}:
        return f"of type {variable.type}, which a scenario cannot give"
    return ""


def _assignment(
    archive: Archive,
    name: str,
    variables: tuple[ModelVariable, ...],
    value: Any,
    sizes: Mapping[int, int],
) -> StartValues:
    first = variables[0]
    shape = shape_of(archive, first, sizes) if len(variables) == 1 else (len(variables),)
    for variable in variables:
        if variable.type != first.type or (len(variables) > 1 and variable.dimensions):
            raise FmuError(f"{archive.label}: the entries of {name} are not numbers of one type")
    entries = _entries(archive, name, value, shape)
    check, c_type = _encoding(archive, first)
    try:
        c_values = (c_type * len(entries))(*map(check, entries))
    except (TypeError, ValueError) as error:
        raise FmuError(f"{archive.label}: {name} is of type {first.type}, {error}") from None
    return StartValues(
        name,
        first.type,
        tuple(variable.valueReference for variable in variables),
        c_values,
        first.causality == "structuralParameter",
    )


def _entries(archive: Archive, name: str, value: Any, shape: tuple[int, ...]) -> list[Any]:
    """Return the values one by one, when they are as many as asked for."""
    given = np.array(value, dtype=object)
    if given.size != prod(shape) or (given.ndim > 1 and len(shape) > 1 and given.shape != shape):
        got = f"{given.size}" if given.ndim < 2 else " x ".join(map(str, given.shape))
        raise FmuError(f"{archive.label}: {name} takes {_size(shape)}, got {got}")
    return given.ravel().tolist()


def _size(shape: tuple[int, ...]) -> str:
    return f"{' x '.join(map(str, shape)) or 1} value{'s' if shape else ''}"


def _encoding(archive: Archive, variable: ModelVariable) -> tuple[Callable[[Any], Any], Any]:
    """Return how a value of a variable's type is checked, and its type in C.

    The check raises `TypeError` or `ValueError`, which say what was expected and what was given.
    """
    kind, fmi2 = variable.type, archive.description.fmiMajorVersion == 2
    if kind in _FLOATS:
        return _number, _FLOATS[kind]
    if kind in _INTEGERS:
        return partial(_integer, c_type=_INTEGERS[kind]), _INTEGERS[kind]
    if kind == "Boolean":
        return _truth, ctypes.c_int if fmi2 else ctypes.c_bool
    if kind == "Enumeration":
        return partial(_item, variable), ctypes.c_int if fmi2 else ctypes.c_int64
    return _text, ctypes.c_char_p


def _number(entry: Any) -> float:
    if isinstance(entry, bool | np.bool_) or not isinstance(entry, Real):
        raise TypeError(f"expected a number, got {quoted(entry)}")
    try:
        return float(entry)
    except OverflowError:
        raise ValueError("expected a number of 64 bits, got one that is too large") from None


def _integer(entry: Any, c_type: Any) -> int:
    if isinstance(entry, bool) or not isinstance(entry, Integral):
        raise TypeError(f"expected a whole number, got {quoted(entry)}")
    if c_type(int(entry)).value != entry:  # a C type wraps around, and says nothing
        raise ValueError(
            f"expected a number of {8 * ctypes.sizeof(c_type)} bits, got {quoted(entry)}"
        )
    return int(entry)


def _truth(entry: Any) -> bool:
    if not isinstance(entry, bool | np.bool_):
        raise TypeError(f"expected true or false, got {quoted(entry)}")
    return bool(entry)


def _text(entry: Any) -> bytes:
    if not isinstance(entry, str) or "\0" in entry:
        raise ValueError(f"expected a text, got {quoted(entry)}")
    return entry.encode()


def _item(variable: ModelVariable, entry: Any) -> int:
    """Return the number of an enumeration's item, given by number or by name."""
    items = variable.declaredType.items if variable.declaredType else []
    numbers = {item.name: int(item.value) for item in items}
    if isinstance(entry, str) and entry in numbers:
        return numbers[entry]
    whole = isinstance(entry, Integral) and not isinstance(entry, bool)
    if whole and (not numbers or int(entry) in numbers.values()):
        return int(entry)
    raise ValueError(f"expected {listed(list(numbers)) or 'a whole number'}, got {quoted(entry)}")
