"""Conditions between the values of a point: comparisons of keys of the axes, as in Python.

    algorithm.alpha <= algorithm.beta
    algorithm.alpha < 1 or 2 * run.sampling_period < controller.kp / 100
    algorithm.name != "dcea2" and run.seed in [1, 5]

There are numbers, texts in quotation marks, `true`, `false`, lists, `+ - * /`, comparisons, `in`,
`and`, `or`, `not` and parentheses.
"""

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import nearest, quoted, shortened

Where = Callable[[Mapping[str, Any]], bool]
"""Says of a point's values whether it is in the study."""

_WORDS = {"and", "or", "not", "in"}
_QUOTED, _KEY = r""""[^"]*"|'[^']*'""", r"[A-Za-z_]\w*(?:\.\w+)*"
_NODES = (
    ast.Expression, ast.BoolOp, ast.And, ast.Or, ast.UnaryOp, ast.Not, ast.USub, ast.UAdd,
    ast.BinOp, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Compare, ast.Lt, ast.LtE, ast.Gt, ast.GtE,
    ast.Eq, ast.NotEq, ast.In, ast.NotIn, ast.List, ast.Name, ast.Load,
)  # fmt: skip
"""What a condition may consist of, beside numbers and texts: nothing that is called."""


def where_of(option: str, text: str | None, keys: Sequence[str]) -> Where:
    """Read a condition on keys, none that holds always; `InputError` says what is wrong with it."""
    if text is None:
        return lambda _values: True
    names: dict[str, str] = {}
    known = "|".join(rf"{re.escape(key)}(?!\w)" for key in sorted(keys, key=len, reverse=True))
    token = re.compile(rf"({_QUOTED})|(?<![\w.])({known}{'|' if known else ''}{_KEY})")

    def named(found: re.Match[str]) -> str:
        key = found[2]
        if found[1] or key in _WORDS:
            return found[0]
        if key in {"true", "false"}:
            return key.title()
        if key not in keys:
            raise InputError(f"{option}: {shortened(key)}: is on no axis{nearest(key, keys)}")
        return names.setdefault(key, f"k{len(names)}")

    try:
        tree = ast.parse(token.sub(named, text).strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        tree = None
    if tree is None or not all(map(_is_known, ast.walk(tree))):
        raise InputError(
            f"{option}: expected a condition such as algorithm.alpha <= 2 * run.sampling_period, "
            f"got {quoted(text)}"
        )
    code = compile(tree, option, "eval")

    def where(values: Mapping[str, Any]) -> bool:
        known = {name: values.get(key) for key, name in names.items()}
        try:
            return bool(eval(code, {"__builtins__": {}}, known))
        except (TypeError, ArithmeticError) as error:
            at = ", ".join(f"{key} = {shortened(str(values.get(key)))}" for key in names)
            raise InputError(f"{option}: {quoted(text)} says nothing at {at}: {error}") from None

    return where


def _is_known(node: ast.AST) -> bool:
    """Return whether a node is one of a condition."""
    return isinstance(node, _NODES) or (
        isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float | str)
    )
