"""A study's rows in columns, with a column for each key of the axes.

A row that is older than an axis has the value there that the scenario has. Rows with the same
values but for the seed are a cell. Of rows with the same values and seed, which have other keys
because a version or a file is another one, the last holds.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.scenario.file import tables_of
from nrs_cosim.orchestrator.study.axes import SEED
from nrs_cosim.orchestrator.study.points import SCENARIO_AXIS
from nrs_cosim.orchestrator.study.rows import RESULTS
from nrs_cosim.orchestrator.study.store import StudyStore

Cell = tuple[Any, ...]
"""A value for each key of the axes, as text of JSON where it is a list or a table."""


@dataclass(frozen=True)
class StudyTable:
    """Rows as they came, by column."""

    keys: tuple[str, ...]
    """Of the axes, without the seed."""
    leading: tuple[str, ...]
    """Those that tell a cell: of keys that go together the first, where its values are distinct."""
    columns: Mapping[str, Sequence[Any]]
    values: Mapping[str, Sequence[Any]]
    """By key of the axes, of each row."""

    @classmethod
    def of(cls, store: StudyStore, *only: str) -> "StudyTable":
        """Read all columns of a study, or some."""
        definition = store.definition()
        names = [key for axis in definition["axes"] for key in axis["keys"] if key != SEED]
        keys = tuple(dict.fromkeys(names))
        texts = {one["name"]: tables_of(one["text"]) for one in definition["scenarios"]}
        wanted = {*only, "key", "point", "scenario", "seed", "status"} if only else ()
        columns = store.columns(*wanted)
        distinct = {*zip(columns["point"], columns["scenario"], strict=True)}
        found = {one: _values_of(*one, keys, texts) for one in distinct}
        columns = _latest(columns, found)
        rows = [found[one] for one in zip(columns["point"], columns["scenario"], strict=True)]
        values = {key: [row[at] for row in rows] for at, key in enumerate(keys)}
        leading = [key for axis in definition["axes"] for key in _leading(axis) if key != SEED]
        return cls(keys, tuple(dict.fromkeys(leading)), columns, values)

    def __len__(self) -> int:
        return len(self.columns["key"])

    @cached_property
    def cells(self) -> dict[Cell, list[int]]:
        """The places of rows by cell, in the order of the axes' values, and by seed."""
        found: dict[Cell, list[int]] = {}
        columns = [[cell_value(value) for value in self.values[key]] for key in self.keys]
        for place in range(len(self)):
            found.setdefault(tuple(column[place] for column in columns), []).append(place)
        for places in found.values():
            places.sort(key=lambda place: self.columns["seed"][place])
        return dict(sorted(found.items(), key=lambda item: tuple(map(_order, item[0]))))

    @property
    def counts(self) -> Counter[str]:
        """How many rows there are of each status."""
        return Counter(self.columns["status"])

    def axis(self, key: str) -> list[Any]:
        """Return the values of a key, ascending; `InputError` where it is on no axis."""
        self.expect_key(key)
        return sorted({cell_value(value) for value in self.values[key]}, key=_order)

    def expect_key(self, key: str) -> None:
        """Raise `InputError` for a key that is on no axis."""
        if key not in self.keys:
            raise InputError(
                f"{quoted(key)}: is on no axis of the study; these are: {', '.join(self.keys)}"
            )

    def share_converged(self, places: Sequence[int]) -> tuple[int, int]:
        """Return how many rows of some converged, and how many have a result at all."""
        statuses = [self.columns["status"][place] for place in places]
        return statuses.count("converged"), sum(status in RESULTS for status in statuses)


def _values_of(
    point: str, scenario: str, keys: Sequence[str], texts: Mapping[str, Mapping[str, Any]]
) -> Cell:
    """Return the values of a row's point, and those of its scenario where it says none."""
    given = json.loads(point)
    there = texts.get(scenario, {})
    return tuple(given[key] if key in given else _at(there, scenario, key) for key in keys)


def _latest(
    columns: dict[str, list[Any]], found: Mapping[tuple[str, str], Cell]
) -> dict[str, list[Any]]:
    """Return, of rows with the same values and seed, the last: others are of other versions."""
    cells = {one: tuple(map(cell_value, values)) for one, values in found.items()}
    rows = zip(columns["point"], columns["scenario"], columns["seed"], strict=True)
    last = {(cells[text, scenario], seed): at for at, (text, scenario, seed) in enumerate(rows)}
    if len(last) == len(columns["key"]):
        return columns
    kept = sorted(last.values())
    return {name: [column[at] for at in kept] for name, column in columns.items()}


def _leading(axis: Mapping[str, Any]) -> list[str]:
    """Return the keys of an axis that tell a place on it; of a draw all."""
    firsts = [json.dumps(values[0]) for values in axis["values"]]
    is_told = len({*firsts}) == len(firsts) and not axis.get("drawn")
    found: list[str] = axis["keys"][:1] if is_told else axis["keys"]
    return found


def _at(tables: Mapping[str, Any], scenario: str, key: str) -> Any:
    if key == SCENARIO_AXIS:
        return scenario
    found: Any = tables
    for part in key.split("."):
        found = found.get(part) if isinstance(found, Mapping) else None
    return found


def cell_value(value: Any) -> Any:
    """Return a value that can be a key: what is a list or a table, as its text."""
    return json.dumps(value) if isinstance(value, list | dict) else value


def _order(value: Any) -> tuple[int, Any]:
    """Return what values are sorted by: numbers, then texts, then what is none."""
    if isinstance(value, bool | int | float):
        return 0, value
    return (2, "") if value is None else (1, str(value))
