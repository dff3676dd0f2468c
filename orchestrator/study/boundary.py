"""Where, on an axis, runs stop converging: between two values, closer with each refinement.

A value converges when at least half of its runs that have a result did. Between two values next to
one another, of which one converges and the other does not, lies a boundary; refinement runs the
value in the middle, with the same seeds, and so on until the two are as close as was asked. What is
run depends on the rows alone: the same table leads to the same points, whoever ran them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.study.axes import rounded
from nrs_cosim.orchestrator.study.table import StudyTable

WIDTH = 0.01
"""Of an axis' range: how close two values are, unless it is given."""


@dataclass(frozen=True, slots=True)
class StatusChange:
    """Two values of a key next to one another, of which one converges."""

    key: str
    others: tuple[tuple[str, Any], ...]
    """The values of the other keys."""
    low: float
    high: float
    converges_below: bool
    """Whether it is the lower one that does."""

    @property
    def is_of_whole_numbers(self) -> bool:
        """Whether both are, so that there may be none between."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    @property
    def middle(self) -> float:
        """The value between; a whole number between whole ones."""
        low, high = self.low, self.high
        if isinstance(low, int) and isinstance(high, int) and (low + high) % 2 == 0:
            return (low + high) // 2
        return rounded(self.key, (low + high) / 2)


def changes_along(table: StudyTable, key: str) -> Iterator[StatusChange]:
    """Yield where the status changes along a key; `InputError` where it is no axis of numbers."""
    values = table.axis(key)
    if len(values) < 2 or not all(
        isinstance(value, int | float) and not isinstance(value, bool) for value in values
    ):
        raise InputError(f"{key}: a boundary is between two numbers, and there are no two")
    at = table.keys.index(key)
    lines: dict[tuple[Any, ...], list[tuple[float, bool]]] = {}
    for cell, places in table.cells.items():
        converged, results = table.share_converged(places)
        if results:
            rest = (*cell[:at], *cell[at + 1 :])
            lines.setdefault(rest, []).append((cell[at], 2 * converged >= results))
    others = [name for name in table.keys if name != key]
    for rest, line in lines.items():
        for (low, below), (high, above) in pairwise(line):
            if below != above:
                yield StatusChange(key, tuple(zip(others, rest, strict=True)), low, high, below)


def to_refine(table: StudyTable, key: str, width: float | None) -> list[StatusChange]:
    """Return the boundaries that are not known to a width, by default a part of the range."""
    values = table.axis(key)
    if len(values) < 2:
        return []
    found = list(changes_along(table, key))
    most = width if width is not None else WIDTH * (values[-1] - values[0])
    if not most > 0:
        raise InputError(f"width: expected a number above 0, got {width}")
    return [one for one in found if one.high - one.low > most and one.low < one.middle < one.high]
