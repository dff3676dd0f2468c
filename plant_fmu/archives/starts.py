"""A quantity may start where a parameter has it: which one, as far as an FMU's description tells.

The description names what a start depends on (InitialUnknowns; FMI 2.0, section 2.2.8; FMI 3.0,
section 2.4.8). Of these, or of all parameters where it names none, one stands out whose own start
is the number that was found, or whose name is that of the variable and a word for its start.
"""

import re
from collections.abc import Iterator, Sequence
from math import isclose

from fmpy.model_description import ModelVariable

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.lookup import identity
from nrs_cosim.plant_fmu.archives.quantities import TYPES, Part, Quantity
from nrs_cosim.plant_fmu.archives.units import unit_of

_START = re.compile(r"start|initial|init|_0$|0$")
_NO_NAME = re.compile(r"[^a-z0-9]")


def start_parameters(
    archive: Archive, quantity: Quantity, found: Sequence[float], wanted: Sequence[float]
) -> dict[str, float]:
    """Return parameters by which a quantity that started at `found` would start at `wanted`.

    Both are the quantity's numbers, in SI; the parameters' are in the unit of the variable. Empty
    unless there is one for each number that is not as it is wanted.
    """
    values: dict[str, float] = {}
    numbers = iter(zip(found, wanted, strict=True))
    for part in quantity.parts:
        for was, is_wanted in [next(numbers) for _ in range(part.size)]:
            if isclose(was, is_wanted, rel_tol=1e-9, abs_tol=1e-9):
                continue
            fitting = _fitting(archive, part, was / part.factor) if part.length == 1 else None
            if fitting is None:
                return {}
            values[fitting.name] = is_wanted / part.factor
    return values


def _fitting(archive: Archive, part: Part, was: float) -> ModelVariable | None:
    """Return the only parameter that can be expected to hold the start of a scalar."""
    aliases = [
        variable
        for variable in archive.description.modelVariables
        if variable.type in TYPES and variable.valueReference == part.reference
    ]
    known = list(_depended(archive, aliases))
    pool = known or [v for v in archive.description.modelVariables if _may_be(v)]
    units = {None, *map(unit_of, aliases)}
    pool = [v for v in pool if unit_of(v) in units]
    namesakes = [v for v in pool if any(_names(v, alias) for alias in aliases)]
    equal = [v for v in pool if was and isclose(float(v.start), was)]
    both = [v for v in namesakes if v in equal]
    # The best evidence first: name and number, name, number, or the description's word alone.
    return next(
        (few[0] for few in (both, namesakes, equal, pool if known else []) if len(few) == 1),
        None,
    )


def _depended(archive: Archive, aliases: Sequence[ModelVariable]) -> Iterator[ModelVariable]:
    """Yield the parameters of which the description says that the variable's start needs them."""
    own = set(map(identity, aliases))
    for unknown in archive.description.initialUnknowns:
        if identity(unknown.variable) in own:
            yield from filter(_may_be, unknown.dependencies or ())


def _may_be(variable: ModelVariable) -> bool:
    """Whether it is a parameter with one number of its own."""
    if variable.causality != "parameter" or variable.type not in TYPES or variable.dimensions:
        return False
    try:
        float(variable.start)
    except (TypeError, ValueError):
        return False
    return True


def _names(parameter: ModelVariable, variable: ModelVariable) -> bool:
    """Whether a parameter has a variable's name, or the end of it, and a word for its start."""
    name = parameter.name.lower()
    bare = _NO_NAME.sub("", _START.sub("", name))
    own = variable.name.lower()
    return bare != _NO_NAME.sub("", name) and bare in {
        _NO_NAME.sub("", own),
        _NO_NAME.sub("", own.rpartition(".")[2]),
    }
