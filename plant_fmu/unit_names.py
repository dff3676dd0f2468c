"""What a unit's name says in SI: factors joined by dots; those after a slash divide.

A number at the end of a factor is its exponent: kg.m2, N.m.s/rad, deg/s. A name is of the units
that mechanics has; a multiple such as kN is none, since its FMU has to say what it takes it for.
"""

import re
from dataclasses import dataclass
from math import pi

Exponents = tuple[int, int, int, int]
"""Of kg, m, s, rad."""


@dataclass(frozen=True, slots=True)
class SiUnit:
    """A unit in SI: factor · kg^a m^b s^c rad^d."""

    factor: float
    exponents: Exponents


_SECOND = (0, 0, 1, 0)
_ANGLE = (0, 0, 0, 1)
_RATE = (0, 0, -1, 1)
_SYMBOLS = {
    "1": SiUnit(1, (0, 0, 0, 0)),
    "kg": SiUnit(1, (1, 0, 0, 0)),
    "m": SiUnit(1, (0, 1, 0, 0)),
    "s": SiUnit(1, _SECOND),
    "min": SiUnit(60, _SECOND),
    "rad": SiUnit(1, _ANGLE),
    **dict.fromkeys(("deg", "degree", "degrees", "°"), SiUnit(pi / 180, _ANGLE)),
    "rev": SiUnit(2 * pi, _ANGLE),
    "rpm": SiUnit(2 * pi / 60, _RATE),
    "Hz": SiUnit(2 * pi, _RATE),
    "N": SiUnit(1, (1, 1, -2, 0)),
    "Nm": SiUnit(1, (1, 2, -2, 0)),
    "J": SiUnit(1, (1, 2, -2, 0)),
}
_FACTOR = re.compile(r"(?P<symbol>[^\d\s^+-]+|1)\^?(?P<power>[+-]?\d)?")
_MULTIPLE = re.compile(rf"[GMkcdmuµn](?:{'|'.join(map(re.escape, _SYMBOLS))})(?:\^?[+-]?\d)?$")


def parse_unit(name: str) -> SiUnit | None:
    """Return the unit of a name; None where a factor of it is none that is known."""
    factor, exponents = 1.0, (0, 0, 0, 0)
    for sign, text in _factors(name):
        match = _FACTOR.fullmatch(text)
        symbol = _SYMBOLS.get(match["symbol"]) if match else None
        if match is None or symbol is None:
            return None
        power = sign * int(match["power"] or 1)
        factor *= symbol.factor**power
        exponents = _sum(exponents, symbol.exponents, power)
    return SiUnit(factor, exponents)


def has_multiple(name: str) -> bool:
    """Return whether a factor of a name is a multiple of a unit, by a prefix."""
    return any(_MULTIPLE.match(text) for _, text in _factors(name))


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
