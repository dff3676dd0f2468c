"""Numbers as people write and read them: robots like pages, `1-3,7`, factors beside 1."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.plurals import numbered
from nrs_cosim.bus.text import nearest, quoted

_PART = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?", re.ASCII)


def parse_robots(
    text: str, where: str, most: int | None = None, noun: str = "robot"
) -> tuple[int, ...]:
    """Return the robots, or what else `noun` says, that a text names, in increasing order.

    `where` is the option or field that gave it, and `most` the number of robots where that is
    known; `InputError` names both, and the part that is wrong.
    """
    named: set[int] = set()
    for part in (part.strip() for part in text.split(",")):
        match = _PART.fullmatch(part)
        if match is None:
            raise InputError(
                f"{where}: expected {noun}s like 1-3,7, got {quoted(part)} in {quoted(text)}"
            )
        first, last = int(match[1]), int(match[2] or match[1])
        if not 1 <= first <= last:
            why = f"{noun}s count from 1" if first < 1 else f"{first} is more than {last}"
            raise InputError(f"{where}: expected {noun}s like 1-3,7, got {quoted(part)}: {why}")
        if last > (most or 1_000_000):
            there = f"there are {noun}s 1 to {most}" if most else f"at most {noun} 1000000"
            raise InputError(f"{where}: got {quoted(part)} in {quoted(text)}, but {there}")
        again = named.intersection(range(first, last + 1))
        if again:
            raise InputError(f"{where}: {noun} {min(again)} is named twice in {quoted(text)}")
        named.update(range(first, last + 1))
    return tuple(sorted(named))


def parse_joints(
    text: str, where: str, most: int, fmus: Iterable[Sequence[str]]
) -> tuple[int, ...]:
    """Return the joints that a text names by number or, as `fmus` have them, by name."""
    places: dict[str, set[int]] = {}
    for names in fmus:
        for number, name in enumerate(names, 1):
            places.setdefault(name, set()).add(number)
    parts = []
    for part in (part.strip() for part in text.split(",")):
        numbers = () if _PART.fullmatch(part) else places.get(part, ())
        if len(numbers) > 1:
            raise InputError(f"{where}: {quoted(part)} is {numbered('joint', sorted(numbers))}")
        parts.append(str(*numbers) or part)
        if part[:1].isalpha() and not numbers:
            raise InputError(
                f"{where}: no joint is called {quoted(part)}{nearest(part, [*places])}"
            )
    return parse_robots(",".join(parts), where, most, "joint")


def named(numbers: Sequence[int]) -> str:
    """Return `robot 7` or `robots 1-3, 7`."""
    return numbered("robot", numbers)


def multiple(factor: float) -> str:
    """Return a factor with six decimals; as its distance from 1 where these are those of 1."""
    if factor != 1 and f"{factor:.6f}" == "1.000000":
        return f"1 {'-' if factor < 1 else '+'} {abs(factor - 1):.2g}"
    return decimals(factor)


def growth_said(least: float, most: float | None) -> str:
    """Say by what errors grow: a factor, by simulation between two, or at least by one."""
    if most is None:
        return f"at least {multiple(least)}"
    if most - least < 1e-6:
        return f"a factor of {multiple(least)}"
    return f"{least:.4g} to {most:.4g} (99.9 %)"


def decimals(number: float) -> str:
    """Return a number with six decimals, or in short where it has seven digits before them."""
    return f"{number:.6f}" if abs(number) < 1e6 else f"{number:.6g}"


def with_parameters(name: str, parameters: Mapping[str, Any]) -> str:
    """Return `dcea1 (alpha = 0.9, beta = 1.1)`."""
    given = ", ".join(f"{key} = {_written(value)}" for key, value in parameters.items())
    return f"{name} ({given})" if given else name


def _written(value: Any) -> str:
    """Return a value as TOML has it, a number in as few digits as say it whole."""
    match value:
        case bool():
            return str(value).lower()
        case float():
            return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return repr(value)
