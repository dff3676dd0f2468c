"""The variables of a bundled model: declared once, in TOML, and numbered here.

A value reference is the index of a variable's first number among all numbers of the
model, row-major. FMI 3 names whole arrays by it; in FMI 2 each element has its own,
which follow one another. So one table serves both, and nobody writes numbers by hand.
In C the same numbers are the struct `Values`, whose fields are the variables.
"""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

MODELS = Path(__file__).with_name("models")
KINDS = ("independent", "input", "parameter", "local", "state", "derivative", "output")


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of the model, with FMI's attributes (FMI 3.0.2, section 2.4.7).

    `shape` is empty for a scalar; `start` holds for every element and is None where the
    model calculates it; `derivative_of` and `equals` are names of variables of the same
    shape, the latter when this one is always equal to it.
    """

    name: str
    kind: str
    shape: tuple[int, ...]
    unit: str | None
    start: float | None
    derivative_of: str | None
    equals: str | None
    description: str
    value_reference: int

    @property
    def size(self) -> int:
        return prod(self.shape)

    @property
    def causality(self) -> str:
        return {"state": "output", "derivative": "local"}.get(self.kind, self.kind)

    @property
    def variability(self) -> str:
        return "fixed" if self.kind == "parameter" else "continuous"

    @property
    def initial(self) -> str | None:
        """None where FMI does not let the attribute be given."""
        return {
            "parameter": "exact",
            "state": "exact",
            "local": "calculated",
            "derivative": "calculated",
            "output": "calculated",
        }.get(self.kind)


@dataclass(frozen=True, slots=True)
class Declaration:
    """A model: its name, its named dimensions, and its variables by value reference.

    States lie side by side, and so do their derivatives, in the same order.
    """

    name: str
    description: str
    dimensions: dict[str, int]
    variables: tuple[Variable, ...]

    def of_kind(self, *kinds: str) -> tuple[Variable, ...]:
        return tuple(v for v in self.variables if v.kind in kinds)

    def variable(self, name: str) -> Variable:
        return next(v for v in self.variables if v.name == name)


def bundled_models() -> tuple[str, ...]:
    """The names of the models that come with the package, sorted."""
    return tuple(sorted(path.parent.name for path in MODELS.glob("*/model.toml")))


def declaration(name: str) -> Declaration:
    """The declaration of the bundled model `name`."""
    return declare(name, tomllib.loads((MODELS / name / "model.toml").read_text(encoding="utf-8")))


def declare(name: str, own: Mapping[str, Any]) -> Declaration:
    """The declaration of a robot: what all robots share, and its `own` tables, as in model.toml."""
    shared = tomllib.loads((MODELS / "robot.toml").read_text(encoding="utf-8"))
    dimensions = {**shared["dimensions"], **own["dimensions"]}
    tables = {**shared["variables"], **own["variables"]}
    variables: list[Variable] = []
    reference = 0
    for key in sorted(tables, key=lambda key: KINDS.index(tables[key]["kind"])):
        variable = _variable(key, tables[key], dimensions, own["units"], reference)
        variables.append(variable)
        reference += variable.size
    return Declaration(name, own["description"], dimensions, tuple(variables))


def _variable(
    name: str,
    table: dict[str, Any],
    dimensions: dict[str, int],
    units: dict[str, str],
    reference: int,
) -> Variable:
    has_start = table["kind"] in {"input", "parameter", "state"}
    return Variable(
        name=name,
        kind=table["kind"],
        shape=tuple(dimensions[length] for length in table.get("shape", ())),
        unit=_unit(table.get("unit"), units),
        start=float(table.get("start", 0.0)) if has_start else None,
        derivative_of=table.get("of"),
        equals=table.get("equals"),
        description=table["description"],
        value_reference=reference,
    )


def _unit(template: str | None, units: dict[str, str]) -> str | None:
    """None for a pure number, and for what has the axes' unit where the axes have not one."""
    if template is None or ("{" in template and not units):
        return None
    return template.format(**units)


def c_header(model: Declaration, token: str) -> str:
    """variables.h: the struct `Values`, the dimensions, and the token of the FMU."""
    dimensions = ", ".join(f"{name.upper()} = {n}" for name, n in model.dimensions.items())
    fields = "".join(
        f"    double {_c_name(v)}{_c_shape(v)}; /* {v.unit or '1'}: {v.description} */\n"
        for v in model.variables
    )
    states, derivatives = model.of_kind("state"), model.of_kind("derivative")
    return f"""/* Generated from the declaration of {model.name}. */

#ifndef VARIABLES_H
#define VARIABLES_H

#define INSTANTIATION_TOKEN "{token}"

enum {{ {dimensions} }};

typedef struct {{
{fields}}} Values;

enum {{ VALUES = {sum(v.size for v in model.variables)}, STATES = {sum(v.size for v in states)} }};

static inline double *states_of(Values *values)
{{
    return (double *)values + {states[0].value_reference};
}}

static inline double *derivatives_of(Values *values)
{{
    return (double *)values + {derivatives[0].value_reference};
}}

#endif
"""


def c_tables(model: Declaration) -> str:
    """variables.c: for each number of `Values`, what may be done with it, and its start."""
    rights = "".join(
        f'    {{"{v.name}", {0 if i else v.size}, {_settable_in(v)}, '
        f"{'true' if v.kind == 'derivative' else 'false'}}},\n"
        for v in model.variables
        for i in range(v.size)
    )
    starts = "".join(
        f"    [{v.value_reference + i}] = {v.start!r}, /* {v.name} */\n"
        for v in model.variables
        if v.start
        for i in range(v.size)
    )
    return f"""/* Generated from the declaration of {model.name}. */

#include "core.h"

const Variable variables[VALUES] = {{
{rights}}};

const double start_values[VALUES] = {{
{starts}}};
"""


def _c_name(variable: Variable) -> str:
    return re.sub(r"\W+", "_", variable.name).strip("_")


def _c_shape(variable: Variable) -> str:
    return "".join(f"[{length}]" for length in variable.shape)


def _settable_in(variable: Variable) -> str:
    modes = {"input": "UNTIL_THE_END", "parameter": "BEFORE_START", "state": "BEFORE_START"}
    return modes.get(variable.kind, "NEVER")
