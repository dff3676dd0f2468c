"""An algorithm's parameters are the fields of its dataclass, which a scenario gives by name.

    alpha: float = parameter("gain on the positions", above=0)
    order: Literal["sum", "mean"] = parameter("how samples are combined", "mean")
    decay: float = 0.5

Each has a type, and may have a default, a meaning, a unit and bounds. A class that declares them
wrongly is one line, which says where.
"""

import inspect
import operator
import re
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from math import ceil, inf, isfinite, nextafter
from typing import Annotated, Any, Literal, get_args, get_origin

from nrs_cosim.bus.text import quoted
from nrs_cosim.estimator_agents.errors import AlgorithmError

RESERVED = ("name", "missing")
"""Keys that a scenario's table of an algorithm has beside the parameters."""
KINDS = {float: "a valid number", int: "a whole number", bool: "true or false", str: "a text"}
"""What is expected of each type."""
RELATIONS = {
    "above": ("greater than", operator.gt),
    "least": ("greater than or equal to", operator.ge),
    "below": ("less than", operator.lt),
    "most": ("less than or equal to", operator.le),
}
"""What a value is to be to each bound."""


@dataclass(frozen=True, slots=True)
class Declared:
    """What `parameter` says of a field beside its type and its default."""

    meaning: str = ""
    unit: str = ""
    bounds: Mapping[str, float] = field(default_factory=dict)
    """By name: `above`, `least`, `below`, `most`."""


def parameter(
    meaning: str,
    default: Any = MISSING,
    *,
    unit: str = "",
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
) -> Any:
    """Declare a parameter of an algorithm: a dataclass field with a meaning, a unit and bounds.

    Args:
        meaning: What it is, in a few words.
        default: Its value where a scenario gives none; without a default it must be given.
        unit: Such as `1/s`; none for a pure number.
        above: What a number must be greater than.
        least: What a number must be greater than or equal to.
        below: What a number must be less than.
        most: What a number must be less than or equal to.

    Example:
        >>> from dataclasses import dataclass
        >>> @dataclass(frozen=True)
        ... class Leaky:
        ...     alpha: float = parameter("gain on the positions", above=0)
        ...     leak: float = parameter("of the velocity, at each t_k", 0.01, least=0, below=1)
        >>> [one.name for one in declared_parameters(Leaky, "leaky") if one.required]
        ['alpha']
    """
    given = {"above": above, "least": least, "below": below, "most": most}
    bounds = {name: bound for name, bound in given.items() if bound is not None}
    return field(default=default, metadata={Declared: Declared(meaning, unit, bounds)})


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of an algorithm, as its class declares it."""

    name: str
    kind: type
    """`float`, `int`, `bool` or `str`."""
    choices: tuple[str, ...]
    """The texts of which it is one; none where it is not one of some."""
    default: Any
    """`MISSING` where it must be given."""
    declared: Declared

    @property
    def required(self) -> bool:
        """Whether a scenario must give it."""
        return self.default is MISSING

    def value(self, given: Any) -> Any:
        """Return what is given as a value of its type; `ValueError` says what was expected."""
        whole = isinstance(given, int) and not isinstance(given, bool)
        fits = whole or isinstance(given, float) if self.kind is float else type(given) is self.kind
        if self.choices:
            if given not in self.choices:
                raise ValueError(" or ".join(map(repr, self.choices)))
            return given
        if not fits:
            raise ValueError(KINDS[self.kind])
        if self.kind in {float, int}:
            if not _finite(given):
                raise ValueError("a finite number")
            for name, bound in self.declared.bounds.items():
                words, holds = RELATIONS[name]
                if not holds(given, bound):
                    raise ValueError(f"{words} {bound:g}")
        return self.kind(given)


def declared_parameters(kind: Any, name: str) -> tuple[Parameter, ...]:
    """Return what an algorithm's class declares; `AlgorithmError` names its first fault."""
    if not isinstance(kind, type) or not is_dataclass(kind):
        raise _wrong(kind, name, "", "is no dataclass; put @dataclass(frozen=True) above the class")
    for base in kind.__mro__:
        for word, annotation in _annotations(base).items():
            if word not in kind.__dataclass_fields__ and "ClassVar" not in str(annotation):
                fault = "is no field; put @dataclass(frozen=True) above the class that has it"
                raise _wrong(kind, name, word, fault)
    return tuple(_parameter(kind, name, one) for one in fields(kind) if one.init)


def _annotations(base: type) -> dict[str, Any]:
    """Return what a class itself declares; a protocol declares nothing of others."""
    own = {} if getattr(base, "_is_protocol", False) else inspect.get_annotations(base)
    return {word: annotation for word, annotation in own.items() if word != "_"}  # of KW_ONLY


def _parameter(kind: type, name: str, one: "Field[Any]") -> Parameter:
    declared = one.metadata.get(Declared, Declared())
    if one.name in RESERVED:
        fault = f"a parameter cannot be called {one.name}, which is a key of every algorithm"
        raise _wrong(kind, name, one.name, fault)
    try:
        type_, choices = _type(kind, one)
        default = one.default if one.default_factory is MISSING else one.default_factory()
    except Exception as error:  # either may be any code
        fault = " ".join(f"{type(error).__name__}: {error}".split())
        raise _wrong(kind, name, one.name, fault) from None
    if not any(type_ is known for known in KINDS):
        fault = f"expected a float, int, bool, str or Literal of texts, got {_called(type_)}"
        raise _wrong(kind, name, one.name, fault)
    if declared.bounds and type_ not in {float, int}:
        raise _wrong(kind, name, one.name, f"bounds are of numbers, and this is a {_called(type_)}")
    made = Parameter(one.name, type_, choices, default, declared)
    if _is_empty(declared.bounds, whole=type_ is int):
        asked = " and ".join(f"{RELATIONS[name][0]} {b:g}" for name, b in declared.bounds.items())
        raise _wrong(kind, name, one.name, f"there is no number {asked}")
    if not made.required:
        try:
            made.value(default)
        except ValueError as expected:
            fault = f"its default: expected {expected}, got {quoted(default)}"
            raise _wrong(kind, name, one.name, fault) from None
    return made


def _is_empty(bounds: Mapping[str, float], *, whole: bool) -> bool:
    """Return whether no number is within all bounds: the first above some is not below the rest."""
    firsts = [bounds["least"]] if "least" in bounds else []
    if "above" in bounds:
        firsts.append(nextafter(bounds["above"], inf))
    if not firsts:
        return False
    first = max(firsts)
    if whole and isfinite(first):
        first = ceil(first)
    return not all(RELATIONS[name][1](first, bound) for name, bound in bounds.items())


def _type(kind: type, one: "Field[Any]") -> tuple[Any, tuple[str, ...]]:
    """Return a field's type, and the texts that it may be."""
    found: Any = one.type
    if isinstance(found, str):  # as all are under `from __future__ import annotations`
        owner = next(base for base in kind.__mro__ if one.name in inspect.get_annotations(base))
        found = eval(found, vars(sys.modules[owner.__module__]))
    if get_origin(found) is Annotated:
        found = get_args(found)[0]
    if get_origin(found) is Literal and all(isinstance(choice, str) for choice in get_args(found)):
        return str, get_args(found)
    return found, ()


def _finite(number: float) -> bool:
    try:
        return isfinite(number)
    except OverflowError:  # a whole number that no float reaches
        return False


def _called(type_: Any) -> str:
    return type_.__name__ if isinstance(type_, type) else str(type_)


def _wrong(kind: Any, name: str, word: str, fault: str) -> AlgorithmError:
    """Return the error of a class or of one of its fields, with its place."""
    called = getattr(kind, "__qualname__", type(kind).__name__)
    what = f"{called}.{word}" if word else called
    return AlgorithmError(f"algorithm.name: {name}: {what}: {fault}{_place(kind, word)}")


def _place(kind: Any, word: str) -> str:
    """Return where a field of a class is declared, or where the class begins."""
    for base in getattr(kind, "__mro__", (kind,)):
        with suppress(OSError, TypeError):
            lines, first = inspect.getsourcelines(base)
            for number, line in enumerate(lines, first):
                if not word or re.match(rf"\s*{re.escape(word)}\s*[:=]", line):
                    return f", at {inspect.getsourcefile(base)}:{number}"
    return ""
