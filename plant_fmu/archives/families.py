"""Tools name the entries of a vector each in its own way: a family is a pattern that all obey.

A pattern holds `{i}`, and `{j}` where the family is a matrix; both count from the base without a
gap. Entries are read row by row, in whatever order the names come.
"""

import json
import re
from collections import defaultdict
from collections.abc import Collection
from dataclasses import dataclass
from itertools import takewhile

STYLES = ("[{i}]", "[{i},{j}]", "({i})", "({i},{j})", "_{i}", ".{i}", "{i}")
"""What may follow a family's stem."""
_INDEX = r"(?:0|[1-9]\d{0,8})"
_SLICE = re.compile(r"(?P<stem>.+)\[(?P<first>\d{0,9}):(?P<last>\d{0,9})\]")


@dataclass(frozen=True, slots=True)
class NamePattern:
    """The names that it gives for i, j = base, base + 1, …"""

    pattern: str
    base: int = 1

    def entries(self, names: Collection[str]) -> tuple[str, ...]:
        """Return the entries, row by row: as many as there are of the first column and row."""
        counted = range(self.base, self.base + len(names))
        rows = takewhile(lambda i: self._entry(i, self.base) in names, counted)
        if "{j}" not in self.pattern:
            return tuple(self._entry(i) for i in rows)
        columns = list(takewhile(lambda j: self._entry(self.base, j) in names, counted))
        return tuple(self._entry(i, j) for i in rows for j in columns)

    def _entry(self, i: int, j: int = 0) -> str:
        return self.pattern.replace("{i}", str(i)).replace("{j}", str(j))


Spec = str | tuple[str, ...] | NamePattern
"""What a user may write for a quantity: a name, a stem or a slice of either; names; a pattern."""


@dataclass(frozen=True, slots=True)
class Family:
    """Entries that an FMU has for a stem, and what to write to mean just them."""

    spec: Spec
    entries: tuple[str, ...]

    def __str__(self) -> str:
        """Return the spec as TOML."""
        return as_toml(self.spec)


def as_toml(spec: Spec) -> str:
    """Return as TOML what a user may write."""
    if isinstance(spec, NamePattern):
        return f"{{ pattern = {json.dumps(spec.pattern)}, base = {spec.base} }}"
    if isinstance(spec, tuple) and len(spec) > 1:
        return json.dumps(spec)
    return json.dumps(spec if isinstance(spec, str) else spec[0])


def families(stem: str, names: Collection[str]) -> list[Family]:
    """Return the families of a stem, and the names that end with it below a prefix: `arm.q`."""
    candidates = [Family(name, (name,)) for name in names if name.endswith(f".{stem}")]
    members: defaultdict[str, set[str]] = defaultdict(set)
    for style in STYLES:
        expression = _expression(stem, style)
        for name in names:
            if match := expression.fullmatch(name):
                members[f"{match['prefix']}{stem}{style}"].add(name)
    for pattern, found in members.items():
        for spec in (NamePattern(pattern, base=0), NamePattern(pattern, base=1)):
            entries = spec.entries(found)
            if set(entries) == found:
                candidates.append(Family(spec, entries))
    return sorted(candidates, key=str)


def split_slice(name: str) -> tuple[str, slice] | None:
    """Return stem and slice of `q[0:2]`, counted from 0 without the end as in Python, or None."""
    match = _SLICE.fullmatch(name)
    if match is None or _SLICE.fullmatch(match["stem"]):
        return None
    first, last = match["first"] or "0", match["last"]
    return match["stem"], slice(int(first), int(last) if last else None)


def _expression(stem: str, style: str) -> re.Pattern[str]:
    index = re.escape(style).replace(r"\{i\}", _INDEX).replace(r"\{j\}", _INDEX)
    return re.compile(rf"(?P<prefix>(?:.*\.)?){re.escape(stem)}{index}", re.DOTALL)
