"""The variables of a bundled model: declared once, in TOML, and numbered here.

A value reference is the index of a variable's first number among all numbers of the
model, row-major. FMI 3 names whole arrays by it; in FMI 2 each element has its own,
which follow one another. So one table serves both, and nobody writes numbers by hand.
In C the same numbers are the struct `Values`, whose fields are the variables.

A dimension is a number, or in FMI 3 a structural parameter: there is room for the most
that it may be, and an array takes the first rows and columns of its room.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from pathlib import Path
from typing import Any

MODELS = Path(__file__).with_name("models")
KINDS = (
    "independent",
    "structural",
    "input",
    "parameter",
    "local",
    "state",
    "derivative",
    "memory",
    "rate",
    "output",
)


@dataclass(frozen=True, slots=True)
class Dimension:
    """How many elements there are: `start`, until the structural parameter `by` is set."""

    name: str
    start: int
    most: int
    by: str | None = None


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of the model, with FMI's attributes (FMI 3.0.2, section 2.4.7).

    `dimensions` is empty for a scalar; `start`, `min`, `max` and `nominal` hold for every element,
    `start` being None where the model calculates it, or a number for each, row-major, and the
    limits None where there are none; `most` bounds a structural parameter; `derivative_of` and
    `equals` are names of variables of the same shape, the latter when this one is always equal to
    it; of those in `each_of` element i depends on element i alone; `stepped` is what changes by
    steps of co-simulation alone, whatever inputs are set to in between. A memory and its rate are
    integrated while the variable `condition` is not 0.
    """

    name: str
    kind: str
    dimensions: tuple[Dimension, ...]
    unit: str | None
    start: float | tuple[float, ...] | None
    min: float | None
    max: float | None
    nominal: float
    most: int | None
    derivative_of: str | None
    equals: str | None
    each_of: tuple[str, ...]
    stepped: bool
    condition: str | None
    description: str
    value_reference: int

    @property
    def shape(self) -> tuple[int, ...]:
        """With all structural parameters at their starts."""
        return tuple(dimension.start for dimension in self.dimensions)

    @property
    def size(self) -> int:
        return prod(self.shape)

    @property
    def room(self) -> int:
        """How many numbers there is room for."""
        return prod(dimension.most for dimension in self.dimensions)

    @property
    def starts(self) -> tuple[float, ...]:
        """Of each element that there is room for, none where the model calculates them."""
        if self.start is None:
            return ()
        return self.start if isinstance(self.start, tuple) else (self.start,) * self.room

    @property
    def causality(self) -> str:
        other = {
            "structural": "structuralParameter",
            "state": "output",
            **dict.fromkeys(("derivative", "memory", "rate"), "local"),
        }
        return other.get(self.kind, self.kind)

    @property
    def variability(self) -> str:
        if self.kind == "local" and self.stepped:
            return "discrete"
        fixed = {"structural", "parameter", "local"}
        return "fixed" if self.kind in fixed else "continuous"

    @property
    def initial(self) -> str | None:
        """None where FMI does not let the attribute be given."""
        return {
            "structural": "exact",
            "parameter": "exact",
            "state": "calculated" if self.start is None else "exact",
            "local": "calculated",
            "derivative": "calculated",
            "memory": "calculated",
            "rate": "calculated",
            "output": "calculated",
        }.get(self.kind)


@dataclass(frozen=True, slots=True)
class Declaration:
    """A model: its name, its dimensions, and its variables by value reference.

    States follow one another, and so do their derivatives, in the same order.
    """

    name: str
    description: str
    dimensions: tuple[Dimension, ...]
    variables: tuple[Variable, ...]
    interfaces: tuple[str, ...] = ("ModelExchange", "CoSimulation")

    @property
    def has_agent(self) -> bool:
        """Whether an estimator agent is in it."""
        return any(v.name == "sampling_period" for v in self.variables)

    def of_kind(self, *kinds: str) -> tuple[Variable, ...]:
        return tuple(v for v in self.variables if v.kind in kinds)

    def variable(self, name: str) -> Variable:
        return next(v for v in self.variables if v.name == name)


def bundled_models() -> tuple[str, ...]:
    """The names of the models that come with the package, sorted."""
    return tuple(sorted(path.parent.name for path in MODELS.glob("*/model.toml")))


def declaration(name: str, fmi: int = 3) -> Declaration:
    """The declaration of the bundled model `name` for FMI 2 or 3; a run asks for it many times."""
    return _declared(name, fmi, MODELS)


@lru_cache(maxsize=64)
def _declared(name: str, fmi: int, _models: Path) -> Declaration:
    return declare(name, own_tables(name), fmi)


def own_tables(name: str) -> dict[str, Any]:
    """What is in the model.toml of a bundled model."""
    return tomllib.loads((MODELS / name / "model.toml").read_text(encoding="utf-8"))


def declare(name: str, own: Mapping[str, Any], fmi: int = 3) -> Declaration:
    """The declaration of a robot: what all robots share, and its `own` tables, as in model.toml."""
    shared = tomllib.loads((MODELS / "robot.toml").read_text(encoding="utf-8"))
    return declare_tables(name, [shared, own], fmi)


def declare_tables(name: str, parts: Sequence[Mapping[str, Any]], fmi: int) -> Declaration:
    """The declaration of tables as in model.toml, of which the last one has the description.

    FMI 2 knows no structural parameters: there each is the number with which it starts.
    """
    own = parts[-1]
    tables = {key: table for part in parts for key, table in part["variables"].items()}
    lengths = {key: length for part in parts for key, length in part["dimensions"].items()}
    dimensions = {key: _dimension(key, length, tables, fmi) for key, length in lengths.items()}
    if fmi == 2:
        tables = {key: table for key, table in tables.items() if table["kind"] != "structural"}
    variables: list[Variable] = []
    reference = 0
    # By kind, so that states follow one another; within a kind as the tables have them.
    for key in sorted(tables, key=lambda key: KINDS.index(tables[key]["kind"])):
        variable = _variable(key, tables[key], dimensions, own["units"], reference)
        variables.append(variable)
        reference += variable.room
    return Declaration(name, own["description"], tuple(dimensions.values()), tuple(variables))


def _dimension(
    name: str, length: int | str, tables: dict[str, dict[str, Any]], fmi: int
) -> Dimension:
    if isinstance(length, int):
        return Dimension(name, length, length)
    start, most = tables[length]["start"], tables[length]["max"]
    return Dimension(name, start, start) if fmi == 2 else Dimension(name, start, most, length)


def _variable(
    name: str,
    table: dict[str, Any],
    dimensions: dict[str, Dimension],
    units: dict[str, str],
    reference: int,
) -> Variable:
    has_start = table["kind"] in {"structural", "input", "parameter", "state"}
    is_structural = table["kind"] == "structural"
    return Variable(
        name=name,
        kind=table["kind"],
        dimensions=tuple(dimensions[length] for length in table.get("shape", ())),
        unit=_unit(table.get("unit"), units),
        start=float(table.get("start", 0.0)) if has_start else None,
        min=table.get("min"),
        max=None if is_structural else table.get("max"),
        nominal=float(table.get("nominal", 1.0)),
        most=table["max"] if is_structural else None,
        derivative_of=table.get("of"),
        equals=table.get("equals"),
        each_of=tuple(table.get("each_of", ())),
        stepped=table.get("stepped", False),
        condition=table.get("while"),
        description=table["description"],
        value_reference=reference,
    )


def _unit(template: str | None, units: dict[str, str]) -> str | None:
    """None for a pure number, and for what has the axes' unit where the axes have not one."""
    if template is None or ("{" in template and not units):
        return None
    return template.format(**units)
