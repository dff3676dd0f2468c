"""A number of the FMU's times the factor of its unit is ours, in SI: rad, m, s, N, N m.

What a unit is, its definition in the FMU says (BaseUnit: exponents, factor, offset), else its
name. A unit that neither explains is refused. No unit is SI.
"""

from collections.abc import Sequence
from contextlib import suppress
from math import isclose, isfinite

from nrs_cosim.plant_fmu.archives.records import BaseUnit, ModelVariable, Unit
from nrs_cosim.plant_fmu.unit_names import SiUnit, has_multiple, parse_unit


def unit_of(variable: ModelVariable) -> str | None:
    """Return the name of a variable's unit, its own or that of its type, if it has one."""
    return variable.unit or (variable.declaredType.unit if variable.declaredType else None)


NO_UNIT = frozenset({"", "-"})


def si_factor(name: str, definitions: Sequence[Unit], expected: Sequence[str]) -> float:
    """Return the factor to SI of a unit that must be like one of those expected, named in SI.

    `ValueError` says what is wrong with the unit.
    """
    base = next((unit.baseUnit for unit in definitions if unit.name == name), None)
    unit = parse_unit(name) if base is None else _defined(base)
    if unit is None:
        if has_multiple(name):
            raise ValueError("a multiple of an SI unit that the FMU does not define")
        if name.strip() not in NO_UNIT:
            raise ValueError("a unit that the FMU does not define")
        return 1.0
    if not any(_is_like(unit, parse_unit(other), name) for other in expected):
        raise ValueError(f"expected {' or '.join(expected)}, or a multiple")
    return unit.factor


def si_name(name: str, definitions: Sequence[Unit], expected: Sequence[str]) -> str:
    """Return which of some units in SI a unit is a multiple of; empty for no unit."""
    if name.strip() in NO_UNIT:
        return ""
    for other in expected:
        with suppress(ValueError):
            si_factor(name, definitions, (other,))
            return other
    return ""


def _defined(base: BaseUnit) -> SiUnit:
    if base.offset:
        raise ValueError(f"it has an offset of {base.offset:g}")
    if base.A or base.K or base.mol or base.cd or not isfinite(base.factor) or base.factor <= 0:
        raise ValueError("its definition is not one of a mechanical unit")
    return SiUnit(base.factor, (base.kg, base.m, base.s, base.rad))


def _is_like(unit: SiUnit, other: SiUnit | None, name: str) -> bool:
    """Whether two units measure the same; where one leaves out rad, its factor must be clear."""
    if other is None or unit.exponents[:3] != other.exponents[:3]:
        return False
    if unit.exponents[3] == other.exponents[3]:
        return True
    said = parse_unit(name)
    factor = said.factor if said and said.exponents == other.exponents else 1.0
    return unit.exponents[3] == 0 and isclose(unit.factor, factor, rel_tol=1e-6)
