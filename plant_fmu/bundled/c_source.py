"""A declaration as C: the struct `Values`, and the table of what may be done with its numbers.

A field has room for the most elements that its variable may have; how many there are is
a function of `Values`, and a constant wherever it can be one.
"""

import re
from collections.abc import Iterable

from nrs_cosim.plant_fmu.bundled.declaration import Declaration, Dimension, Variable

_SETTABLE_IN = {"input": "UNTIL_THE_END", "parameter": "BEFORE_START", "state": "BEFORE_START"}
_CALCULATED = {"derivative": "DERIVATIVE", "rate": "DERIVATIVE", "output": "OUTPUT"}
_NONE, _ONE = Dimension("none", 0, 0), Dimension("one", 1, 1)


def c_header(model: Declaration, token: str) -> str:
    """variables.h: the struct `Values`, its dimensions and states, and the FMU's token."""
    most = ", ".join(f"{d.name.upper()} = {d.most}" for d in model.dimensions)
    fields = "".join(
        f"    double {_c_name(v)}{_c_shape(v)}; /* {v.unit or '1'}: {v.description} */\n"
        for v in model.variables
    )
    states, derivatives = model.of_kind("state", "memory"), model.of_kind("derivative", "rate")
    return f"""/* Generated from the declaration of {model.name}. */

#ifndef VARIABLES_H
#define VARIABLES_H

#define INSTANTIATION_TOKEN "{token}"
#define HAS_AGENT {int(model.has_agent)}

enum {{ {most} }}; /* at most */

typedef struct {{
{fields}}} Values;

enum {{
    VALUES = {sum(v.room for v in model.variables)},
    STATES = {max(sum(v.room for v in states), 1)}, /* at most; there is no array of none */
    STRUCTURAL_PARAMETERS = {len(model.of_kind("structural"))}
}};
{"".join(map(_count, model.dimensions))}
static inline int states_in(const Values *values)
{{
    (void)values;
    return {" + ".join(_size(v) for v in states) or 0};
}}

/* Of these, those that Model Exchange has. */
static inline int exchanged_states_in(const Values *values)
{{
    (void)values;
    return {" + ".join(_size(v) for v in model.of_kind("state")) or 0};
}}

{_access("states", states)}
{_access("derivatives", derivatives)}
#endif
"""


def c_tables(model: Declaration) -> str:
    """variables.c: for each number of `Values`, what may be done with it, and its start."""
    rights = "".join(
        f"    {_rights(model, v, i)},\n" for v in model.variables for i in range(v.room)
    )
    starts = "".join(
        f"    [{v.value_reference + i}] = {start!r}, /* {v.name} */\n"
        for v in model.variables
        for i, start in enumerate(v.starts)
        if start
    )
    return f"""/* Generated from the declaration of {model.name}. */

#include <math.h>

#include "core.h"

const Variable variables[VALUES] = {{
{rights}}};

const double start_values[VALUES] = {{
{starts}}};
"""


def _count(dimension: Dimension) -> str:
    """The function that says how many elements there are along a dimension."""
    number = dimension.name.upper() if dimension.by is None else f"(int)values->{dimension.by}"
    return f"""
static inline int {dimension.name}_of(const Values *values)
{{
    (void)values;
    return {number};
}}
"""


def _access(name: str, variables: Iterable[Variable]) -> str:
    """The functions that read and write vectors, one after the other."""
    loops = [(f"for (int i = 0; i < {_size(v)}; ++i)", _c_name(v)) for v in variables]
    get = "".join(f"    {loop}\n        *x++ = values->{field}[i];\n" for loop, field in loops)
    set_ = "".join(f"    {loop}\n        values->{field}[i] = *x++;\n" for loop, field in loops)
    return f"""static inline void get_{name}(const Values *values, double x[STATES])
{{
    (void)values, (void)x;
{get}}}

static inline void set_{name}(Values *values, const double x[STATES])
{{
    (void)values, (void)x;
{set_}}}
"""


def _size(vector: Variable) -> str:
    (dimension,) = vector.dimensions
    size = f"{dimension.name}_of(values)"
    return f"(values->{vector.condition} != 0.0 ? {size} : 0)" if vector.condition else size


def _rights(model: Declaration, variable: Variable, within: int) -> str:
    """The entry of a variable's number `within`: the first one stands for the whole."""
    rows, columns = (_ONE, _ONE, *variable.dimensions)[-2:]
    if within or variable.kind == "structural":
        rows = columns = _NONE
    entry = (
        f'"{variable.name}"',
        _length(model, rows),
        _length(model, columns),
        "NEVER" if variable.start is None else _SETTABLE_IN.get(variable.kind, "NEVER"),
        _CALCULATED.get(variable.kind, "NOT_CALCULATED"),
        "-INFINITY" if variable.min is None else repr(variable.min),
        "INFINITY" if variable.max is None else repr(variable.max),
        str(variable.most or 0),
    )
    return f"{{{', '.join(entry)}}}"


def _length(model: Declaration, dimension: Dimension) -> str:
    by = 0 if dimension.by is None else model.variable(dimension.by).value_reference
    return f"{{{dimension.most}, {by}}}"


def _c_name(variable: Variable) -> str:
    return re.sub(r"\W+", "_", variable.name).strip("_")


def _c_shape(variable: Variable) -> str:
    return "".join(f"[{dimension.name.upper()}]" for dimension in variable.dimensions)
