"""A quantity of ours is some of an FMU's numbers: found by name, counted, and brought to SI.

A name is looked for as it is, then as the stem of a family (see `naming`), below one prefix too:
`q` finds `arm.q[1]`, `arm.q[2]`. Two families that fit are an error, since none is better. Without
any, qd is the derivative of q: `der(…)` of each of its variables. So is a target's velocity that of
its position. A target has no inputs: nothing sets them, and it would stand still.
"""

import json
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import prod
from types import MappingProxyType

from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import NamePattern, Spec, families, split_slice
from nrs_cosim.plant_fmu.archives.lookup import by_name, listed, only, suggestion, variable_named
from nrs_cosim.plant_fmu.archives.quantities import INTEGRALS, MOTION, TYPES, UNITS, Part, Quantity
from nrs_cosim.plant_fmu.archives.records import ModelVariable
from nrs_cosim.plant_fmu.archives.units import si_factor, si_name, unit_of
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.joints import Joint

MOST_NUMBERS = 1_000_000
"""That one variable may hold."""

JOINTS = {"position": "q", "velocity": "qd"}
"""What a robot calls what a target calls otherwise."""
MOVING = {"output", "local"}
"""The causalities of variables that may move though nothing is set."""

Pick = tuple[ModelVariable, slice]
"""A variable, and which of its numbers."""
NO_NAMES: Mapping[str, Spec] = MappingProxyType({})
NO_SIZES: Mapping[int, int] = MappingProxyType({})


def find_quantity(
    archive: Archive,
    name: str,
    names: Mapping[str, Spec] = NO_NAMES,
    *,
    size: int | None = None,
    sizes: Mapping[int, int] = NO_SIZES,
) -> Quantity:
    """Return the numbers that are a quantity of ours, as many as a size asks for if it does.

    `names` gives what the user wrote for quantities of ours, and `sizes` the values of structural
    parameters by value reference where they are not the FMU's own. `FmuError` says what is missing,
    ambiguous, or of the wrong size, type or unit.
    """
    integral = None
    if name in INTEGRALS and name not in names:
        integral = names.get(INTEGRALS[name], INTEGRALS[name])
    known_sizes = tuple(sorted(sizes.items()))
    found = _found(archive, name, names.get(name, name), integral, size, known_sizes)
    if isinstance(found, str):
        raise FmuError(found)
    return found


def units_of(archive: Archive, quantity: Quantity) -> tuple[str, ...]:
    """Return in which of its units of SI each part of a quantity is; empty where none is given."""
    known = {v.valueReference: v for v in archive.description.modelVariables if v.type in TYPES}
    names = [unit_of(known[part.reference]) for part in quantity.parts]
    definitions = archive.description.unitDefinitions
    return tuple(si_name(name or "", definitions, UNITS[quantity.name]) for name in names)


def joints_of(archive: Archive, q: Quantity) -> tuple[Joint, ...]:
    """Return the joints whose coordinates a quantity is.

    Where the FMU does not name them, a joint goes by the name of the number that is its coordinate.
    """
    if len(archive.joints) == q.size:
        return archive.joints
    known = {v.valueReference: v for v in archive.description.modelVariables if v.type in TYPES}
    return tuple(
        Joint(name if part.length == 1 else f"{name}[{at + 1}]", unit)
        for part, unit in zip(q.parts, units_of(archive, q), strict=True)
        for name in [known[part.reference].name]
        for at in range(part.first, part.first + part.size)
    )


@lru_cache(maxsize=256)
def _found(
    archive: Archive,
    name: str,
    spec: Spec,
    integral: Spec | None,
    size: int | None,
    sizes: tuple[tuple[int, int], ...],
) -> Quantity | str:
    """Return a quantity, or what is wrong: once for all robots.

    What has an integral may be its derivative.
    """
    try:
        picks = _picks(archive, name, spec)
        if not picks and integral:
            picks = _derivatives(archive, _picks(archive, INTEGRALS[name], integral))
        if not picks:
            return _unknown(archive, name, spec)
        parts = tuple(_part(archive, name, pick, dict(sizes)) for pick in picks)
        if name in MOTION and any(variable.causality == "input" for variable, _ in picks):
            return _moves_not(archive, name, picks)
    except FmuError as error:
        return str(error)
    quantity = Quantity(name, parts)
    if size is not None and quantity.size != size:
        return _wrong_size(archive, quantity, picks, size)
    return quantity


def table_of(ours: str) -> str:
    """Return the table of a scenario whose FMU has a quantity of ours."""
    return "target" if ours in MOTION else "plant"


def shape_of(
    archive: Archive, variable: ModelVariable, sizes: Mapping[int, int] = NO_SIZES
) -> tuple[int, ...]:
    """Return an array's shape, empty for a scalar; `FmuError` when it can be none."""
    shape = tuple(
        sizes.get(dimension.valueReference, int(dimension.variable.start))
        if dimension.start is None
        else int(dimension.start)
        for dimension in variable.dimensions
    )
    if any(length < 0 for length in shape) or prod(shape) > MOST_NUMBERS:
        raise FmuError(
            f"{archive.label}: variable {quoted(variable.name)} has the dimensions {list(shape)}, "
            f"expected up to {MOST_NUMBERS} numbers"
        )
    return shape


@lru_cache(maxsize=256)
def _picks(archive: Archive, ours: str, spec: Spec) -> tuple[Pick, ...]:
    """Return what a spec means; empty when it is a name or a pattern that the FMU does not know."""
    known = by_name(archive)
    if isinstance(spec, NamePattern):
        return tuple((variable_named(archive, entry), slice(None)) for entry in spec.entries(known))
    if isinstance(spec, tuple):
        return tuple(_listed_pick(archive, name) for name in spec)
    if spec in known:
        return ((variable_named(archive, spec), slice(None)),)
    if sliced := split_slice(spec):
        stem, cut = sliced
        return _cut(archive, spec, _picks(archive, ours, stem), cut)
    found = families(spec, known)
    choices = " or ".join(f"variables.{ours} = {family}" for family in found)
    where = f"write in the scenario's [{table_of(ours)}]"
    chosen = only(archive, spec, found, f"{where}: {choices}")
    return tuple((variable, slice(None)) for variable in chosen)


def _listed_pick(archive: Archive, name: str) -> Pick:
    """Return what a name in a list means: a variable, or a slice of one."""
    sliced = None if name in by_name(archive) else split_slice(name)
    stem, cut = sliced or (name, slice(None))
    return variable_named(archive, stem), cut


def _cut(archive: Archive, spec: str, picks: Sequence[Pick], cut: slice) -> tuple[Pick, ...]:
    """Return a slice of a family's entries, or of the numbers of the only variable."""
    if not picks:
        return ()
    if len(picks) == 1:
        return ((picks[0][0], cut),)
    # A slice of Python's ends where the list does; here what is beyond is a mistake.
    if not picks[cut] or (cut.stop or 0) > len(picks):
        raise FmuError(
            f"{archive.label}: {quoted(spec)} is beyond the {len(picks)} entries that it has"
        )
    return tuple(picks[cut])


def _derivatives(archive: Archive, picks: Sequence[Pick]) -> tuple[Pick, ...]:
    """Return `der(…)` of each variable; empty unless the FMU has them all."""
    names = [f"der({variable.name})" for variable, _ in picks]
    if not all(name in by_name(archive) for name in names):
        return ()
    return tuple(
        (variable_named(archive, name), cut) for name, (_, cut) in zip(names, picks, strict=True)
    )


def _part(archive: Archive, ours: str, pick: Pick, sizes: Mapping[int, int]) -> Part:
    variable, cut = pick
    if variable.type not in TYPES:
        reason = ", whose 7 digits are too few for a run" if variable.type == "Float32" else ""
        raise FmuError(
            f"{archive.label}: variable {quoted(variable.name)} for {ours} is of type "
            f"{variable.type}{reason}; expected Real or Float64"
        )
    length = prod(shape_of(archive, variable, sizes))
    first, last, _ = cut.indices(length)
    if cut != slice(None) and (first >= last or (cut.stop or 0) > length):
        raise FmuError(
            f"{archive.label}: {variable.name}[{cut.start}:{cut.stop or ''}] for {ours} is "
            f"beyond the {length} numbers of {quoted(variable.name)}"
        )
    start = () if last - first == length else _start(variable, length)
    factor = _factor(archive, ours, variable)
    return Part(variable.valueReference, length, first, last - first, factor, start)


def _start(variable: ModelVariable, length: int) -> tuple[float, ...]:
    """Return the start values that the FMU declares, or zeros."""
    try:
        declared = tuple(map(float, (variable.start or "").split()))
    except ValueError:
        declared = ()
    return declared if len(declared) == length else (0.0,) * length


def _factor(archive: Archive, ours: str, variable: ModelVariable) -> float:
    unit = unit_of(variable)
    try:
        return _unit_factor(archive, ours, unit) if unit else 1.0
    except ValueError as error:
        raise FmuError(
            f"{archive.label}: variable {quoted(variable.name)} for {ours} is in {quoted(unit)}: "
            f"{error}"
        ) from None


@lru_cache(maxsize=256)
def _unit_factor(archive: Archive, ours: str, unit: str) -> float:
    if ours not in UNITS:
        return 1.0
    return si_factor(unit, archive.description.unitDefinitions, UNITS[ours])


def _unknown(archive: Archive, ours: str, spec: Spec) -> str:
    """Say that there is no such quantity, what is near, and what to write."""
    looked_for = spec.pattern if isinstance(spec, NamePattern) else spec
    what = f"variable {quoted(looked_for)}" + (f" for {ours}" if spec != ours else "")
    near = suggestion(str(looked_for), _moving(archive) if ours in MOTION else by_name(archive))
    write = f'"its name", or a list of names, or {{ pattern = "{ours}[{{i}}]", base = 1 }}'
    if joints := _joints(archive, ours):
        near, write = f"; a robot's {JOINTS[ours]} is there.", joints
    return (
        f"{archive.label}: has no {what}{near} Write in the scenario's [{table_of(ours)}]: "
        f"variables.{ours} = {write}{'' if ours in MOTION else proposing(archive)}"
    )


def proposing(archive: Archive) -> str:
    """Return who proposes names of a robot's quantities, as the end of a sentence."""
    return f"; `nrs fmu check {archive.label}` proposes a line"


def _moves_not(archive: Archive, ours: str, picks: Sequence[Pick]) -> str:
    """Say that a target's quantity is an input, and what to take instead."""
    names = listed([variable.name for variable, _ in picks])
    instead = _joints(archive, ours) or f"one of {listed(_moving(archive))}"
    return (
        f"{archive.label}: variables.{ours} = {names}: an input, which nothing sets, so that the "
        f"target would stand still; take an output or a state, {instead}"
    )


def _joints(archive: Archive, ours: str) -> str:
    """Return as TOML what a robot calls a target's quantity; empty where that is not there."""
    stem, moving = JOINTS.get(ours, ""), _moving(archive)
    if stem in moving:
        return f'"{stem}"'
    found = families(stem, moving) if stem else []
    return str(found[0]) if len(found) == 1 else ""


def _moving(archive: Archive) -> list[str]:
    """Return the names of outputs, and of what is known inside alone, as states are."""
    return [v.name for v in archive.description.modelVariables if v.causality in MOVING]


def _wrong_size(archive: Archive, quantity: Quantity, picks: Sequence[Pick], size: int) -> str:
    """Say how many numbers were found, where, and how to have as many as are asked for."""
    members = listed([variable.name for variable, _ in picks])
    advice = ""
    if structural := _structural(archive, picks, size):
        advice = f"; set its structural parameter: parameters = {{ {structural} = {size} }}"
    elif quantity.size > size:
        advice = f'; a part of it would be variables.{quantity.name} = "{quantity.name}[0:{size}]"'
    why = ", one for each of the scenario's target.axes," if quantity.name == "q" else ""
    return (
        f"{archive.label}: {quantity.name} takes {size} numbers here{why or ','} but the FMU has "
        f"{quantity.size}: {members}{advice}"
    )


def _structural(archive: Archive, picks: Sequence[Pick], size: int) -> str:
    """Return as TOML the structural parameter that can be the size of a whole array, if any is."""
    if len(picks) != 1 or picks[0][1] != slice(None):
        return ""
    for dimension in picks[0][0].dimensions:
        decides = dimension.variable
        if decides is None or decides.causality != "structuralParameter":
            continue
        if prod(shape_of(archive, picks[0][0], {decides.valueReference: size})) == size:
            return bare_or_quoted(decides.name)
    return ""


def bare_or_quoted(name: str) -> str:
    """Return a name as a key of TOML."""
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else json.dumps(name)
