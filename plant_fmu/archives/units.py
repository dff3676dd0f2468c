"""A number of the FMU's times the factor of its unit is ours, in SI: rad, m, s, N, N m.

What a unit is, its definition in the FMU says (BaseUnit: exponents, factor, offset), else its
name. A unit that neither explains is refused. No unit is SI.
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import isclose, isfinite, pi

from fmpy.model_description import BaseUnit, ModelVariable, Unit

Exponents = tuple[int, int, int, int]
"""Of kg, m, s, rad."""


@dataclass(frozen=True, slots=True)
class Meaning:
    """A unit in SI: factor · kg^a m^b s^c rad^d."""

    factor: float
    exponents: Exponents


_SECOND = (0, 0, 1, 0)
_ANGLE = (0, 0, 0, 1)
_RATE = (0, 0, -1, 1)
_SYMBOLS = {
    "1": Meaning(1, (0, 0, 0, 0)),
    "kg": Meaning(1, (1, 0, 0, 0)),
    "m": Meaning(1, (0, 1, 0, 0)),
    "s": Meaning(1, _SECOND),
    "min": Meaning(60, _SECOND),
    "rad": Meaning(1, _ANGLE),
    **dict.fromkeys(("deg", "degree", "degrees", "°"), Meaning(pi / 180, _ANGLE)),
    "rev": Meaning(2 * pi, _ANGLE),
    "rpm": Meaning(2 * pi / 60, _RATE),
    "Hz": Meaning(2 * pi, _RATE),
    "N": Meaning(1, (1, 1, -2, 0)),
    "Nm": Meaning(1, (1, 2, -2, 0)),
    "J": Meaning(1, (1, 2, -2, 0)),
}
_FACTOR = re.compile(r"(?P<symbol>[^\d\s^+-]+|1)\^?(?P<power>[+-]?\d)?")
_MULTIPLE = re.compile(rf"[GMkcdmuµn](?:{'|'.join(map(re.escape, _SYMBOLS))})(?:\^?[+-]?\d)?$")


def read(name: str) -> Meaning | None:
    """Return what a unit's name says: factors joined by dots, those after a slash divide."""
    factor, exponents = 1.0, (0, 0, 0, 0)
    for sign, text in _factors(name):
        match = _FACTOR.fullmatch(text)
        symbol = _SYMBOLS.get(match["symbol"]) if match else None
        if match is None or symbol is None:
            return None
        power = sign * int(match["power"] or 1)
        factor *= symbol.factor**power
        exponents = _sum(exponents, symbol.exponents, power)
    return Meaning(factor, exponents)


def unit_of(variable: ModelVariable) -> str | None:
    """Return the name of a variable's unit, its own or that of its type, if it has one."""
    return variable.unit or (variable.declaredType.unit if variable.declaredType else None)


NO_UNIT = frozenset({"", "-"})


def si_factor(name: str, definitions: Sequence[Unit], expected: Sequence[str]) -> float:
    """Return the factor to SI of a unit that must be like one of those expected, named in SI.

    `ValueError` says what is wrong with the unit.
    """
    base = next((unit.baseUnit for unit in definitions if unit.name == name), None)
    unit = read(name) if base is None else _defined(base)
    if unit is None:
        if any(_MULTIPLE.match(text) for _, text in _factors(name)):
            raise ValueError("a multiple of an SI unit that the FMU does not define")
        if name.strip() not in NO_UNIT:
            raise ValueError("a unit that the FMU does not define")
        return 1.0
    if not any(_is_like(unit, read(other), name) for other in expected):
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


def _defined(base: BaseUnit) -> Meaning:
    if base.offset:
        raise ValueError(f"it has an offset of {base.offset:g}")
    if base.A or base.K or base.mol or base.cd or not isfinite(base.factor) or base.factor <= 0:
        raise ValueError("its definition is not one of a mechanical unit")
    return Meaning(base.factor, (base.kg, base.m, base.s, base.rad))


def _is_like(unit: Meaning, other: Meaning | None, name: str) -> bool:
    """Whether two units measure the same; where one leaves out rad, its factor must be clear."""
    if other is None or unit.exponents[:3] != other.exponents[:3]:
        return False
    if unit.exponents[3] == other.exponents[3]:
        return True
    said = read(name)
    factor = said.factor if said and said.exponents == other.exponents else 1.0
    return unit.exponents[3] == 0 and isclose(unit.factor, factor, rel_tol=1e-6)


def _factors(name: str) -> list[tuple[int, str]]:
    """Return the factors of a unit's name, each with 1, or −1 where it divides."""
    above, *below = name.strip().split("/")
    return [
        (sign, text)
        for sign, product in [(1, above), *((-1, product) for product in below)]
        for text in re.split(r"[\s.*·]+", product)
    ]


def _sum(a: Exponents, b: Exponents, power: int) -> Exponents:
    return (
        a[0] + power * b[0],
        a[1] + power * b[1],
        a[2] + power * b[2],
        a[3] + power * b[3],
    )
