"""Where q and q̇ start: at continuous states, which may be set, or where parameters say.

In Model Exchange a continuous state is set after initialisation, whatever it starts from. Else
parameters are named, and which ones is told as far as an FMU's description does. It names what a
start depends on (InitialUnknowns; FMI 2.0, section 2.2.8; FMI 3.0, section 2.4.8). Of these, or of
all parameters where it names none, one stands out whose own start is the number that was found, or
whose name is that of the variable and a word for its start.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from math import isclose, prod

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.lookup import identity
from nrs_cosim.plant_fmu.archives.quantities import TYPES, Part, Quantity
from nrs_cosim.plant_fmu.archives.records import ModelVariable
from nrs_cosim.plant_fmu.archives.units import unit_of
from nrs_cosim.plant_fmu.archives.variables import shape_of

_START = re.compile(r"start|initial|init|_0$|0$")
_NO_NAME = re.compile(r"[^a-z0-9]")


def continuous_states(
    archive: Archive, quantity: Quantity, sizes: Mapping[int, int]
) -> tuple[int, ...]:
    """Return which of the continuous states each of a quantity's numbers is; empty unless all are.

    They are in the order of their derivatives in the model structure (FMI 2.0, section 2.2.8; FMI
    3.0, section 2.4.8), and a variable of the same reference is the same number.
    """
    first: dict[int, int] = {}
    count = 0
    for unknown in archive.description.derivatives:
        state = unknown.variable.derivative
        if state is not None and state.type in TYPES:
            first[state.valueReference] = count
        count += prod(shape_of(archive, unknown.variable, sizes))
    if not all(part.reference in first for part in quantity.parts):
        return ()
    return tuple(
        first[part.reference] + number
        for part in quantity.parts
        for number in range(part.first, part.first + part.size)
    )


def start_parameters(
    archive: Archive, quantity: Quantity, found: Sequence[float]
) -> tuple[str, ...]:
    """Return the parameters where a quantity starts that was found at these numbers, in SI.

    Empty unless there is one for each of them.
    """
    names: list[str] = []
    numbers = iter(found)
    for part in quantity.parts:
        for was in [next(numbers) for _ in range(part.size)]:
            fitting = _fitting(archive, part, was / part.factor) if part.length == 1 else None
            if fitting is None or fitting.name in names:
                return ()
            names.append(fitting.name)
    return tuple(names)


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
