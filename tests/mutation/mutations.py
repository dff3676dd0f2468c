"""A mutation changes one place of a module: an operator, a number, a condition, a statement.

It is known by its module, the function that it is in, what is replaced by what, and the how many of
the same there it is. So it keeps its name when lines move, and the sample that a seed draws stays
the same for all that did not change.
"""

import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import blake2b
from itertools import accumulate

_COMPARED = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
_COMPUTED = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.MatMult: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
_SWAPPED = {"min": "max", "max": "min", "any": "all", "all": "any"}
_LEFT_OUT = {"abs", "copy", "reversed", "sorted", "cumsum"}
"""Calls that a value may do without."""
_UNREAD = {"annotation", "bases", "decorator_list", "returns", "type_params"}
"""What of a function or a class is not run, or says how it is made."""


@dataclass(frozen=True, slots=True)
class Mutation:
    """What becomes of the bytes start … stop of a module."""

    module: str
    place: str
    """The function or class that it is in."""
    old: str
    new: str
    count: int
    """How many of the same there are before it in the same place."""
    line: int
    start: int
    stop: int

    @property
    def key(self) -> str:
        """What it is known by."""
        again = f" ({self.count + 1})" if self.count else ""
        change = f"{' '.join(self.old.split())} => {' '.join(self.new.split())}"
        return f"{self.module}: {self.place}: {change}{again}"

    def rank(self, seed: int) -> bytes:
        """Return its place in the order in which a seed draws."""
        return blake2b(self.key.encode(), key=seed.to_bytes(8, "little")).digest()

    def of(self, source: bytes) -> bytes:
        """Return the module with this change."""
        return source[: self.start] + self.new.encode() + source[self.stop :]


def mutations_of(module: str, source: bytes) -> list[Mutation]:
    """Return all mutations of a module, in the order of its text."""
    begins = [0, *accumulate(len(line) for line in source.splitlines(keepends=True))]
    seen: Counter[tuple[str, str, str]] = Counter()
    found = []
    for place, node, new in _changes(ast.parse(source), ""):
        start = begins[node.lineno - 1] + node.col_offset
        stop = begins[node.end_lineno - 1] + node.end_col_offset
        old = source[start:stop].decode()
        count = seen[place, old, new]
        seen[place, old, new] += 1
        found.append(Mutation(module, place, old, new, count, node.lineno, start, stop))
    return sorted(found, key=lambda one: (one.start, one.stop, one.new))


def _changes(node: ast.AST, place: str) -> Iterator[tuple[str, ast.AST, str]]:
    """Yield what can be replaced in a node and below it, and by what."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        if any("Protocol" in ast.unparse(base) for base in getattr(node, "bases", ())):
            return
        place = f"{place}.{node.name}" if place else node.name
    for target, new in _replaced(node):
        yield place, target, f"({ast.unparse(new)})" if isinstance(new, ast.expr) else new
    for name, value in ast.iter_fields(node):
        for child in () if name in _UNREAD else value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not _is_text(child):
                yield from _changes(child, place)


def _is_text(node: ast.AST) -> bool:
    """Return whether it is a docstring, a text for people, or decides nothing."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant)
    if isinstance(node, ast.keyword):
        return node.arg == "strict"  # of zip, which holds what is so anyway
    return isinstance(node, ast.JoinedStr | ast.Import | ast.ImportFrom)


def _replaced(node: ast.AST) -> Iterator[tuple[ast.AST, ast.expr | str]]:  # noqa: PLR0912
    """Yield what of a node is replaced, itself or its condition, and by what."""
    match node:
        case ast.Compare(left=left, ops=ops, comparators=others):
            for i, op in enumerate(ops):
                turned = [*ops[:i], _COMPARED[type(op)](), *ops[i + 1 :]]
                yield node, ast.Compare(left, turned, others)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _COMPUTED:
            yield node, ast.BinOp(left, _COMPUTED[type(op)](), right)
        case ast.BoolOp(op=op, values=values):
            yield node, ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield node, operand
        case ast.Constant(value=bool(value)):
            yield node, ast.Constant(not value)
        case ast.Constant(value=int(value)):
            yield node, ast.Constant(value + 1)
        case ast.Constant(value=float(value)):
            yield node, ast.Constant(2 * value + 1)
        case ast.Return(value=ast.expr() as value) if ast.unparse(value) != "None":
            yield node, "return None"
        case ast.Raise() | ast.AugAssign() | ast.Delete() | ast.Expr(value=ast.Call()):
            yield node, "pass"
        case ast.Break():
            yield node, "continue"
        case ast.Continue():
            yield node, "break"
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test):
            if not isinstance(test, ast.Compare | ast.Constant | ast.UnaryOp):
                yield test, ast.UnaryOp(ast.Not(), test)
        case ast.Call(func=ast.Name(id=name), args=args, keywords=keywords) if name in _SWAPPED:
            yield node, ast.Call(ast.Name(_SWAPPED[name]), args, keywords)
        case ast.Call(func=ast.Attribute(value=value, attr=name), args=[]) if name in _LEFT_OUT:
            yield node, value
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=[value]) if (
            name in _LEFT_OUT
        ):
            yield node, value
