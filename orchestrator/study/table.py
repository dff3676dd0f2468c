"""A study's rows in columns, with a column for each key of the axes.

A row that is older than an axis has the value there that the scenario has. Rows with the same
values but for the seed are a cell.
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
        parsed = {text: json.loads(text) for text in {*columns["point"]}}
        values: dict[str, list[Any]] = {key: [] for key in keys}
        for text, scenario in zip(columns["point"], columns["scenario"], strict=True):
            point = parsed[text]
            for key in keys:
                found = point[key] if key in point else _at(texts.get(scenario, {}), scenario, key)
                values[key].append(found)
        leading = [key for axis in definition["axes"] for key in _leading(axis) if key != SEED]
        return cls(keys, tuple(dict.fromkeys(leading)), columns, values)

    def __len__(self) -> int:
        return len(self.columns["key"])

    @cached_property
    def cells(self) -> dict[Cell, list[int]]:
        """The places of rows by cell, in the order of the axes' values, and by seed."""
        found: dict[Cell, list[int]] = {}
        plain = [[_plain(value) for value in self.values[key]] for key in self.keys]
        for place in range(len(self)):
            found.setdefault(tuple(column[place] for column in plain), []).append(place)
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
        return sorted({_plain(value) for value in self.values[key]}, key=_order)

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


def _plain(value: Any) -> Any:
    """Return a value that can be a key: what is a list or a table, as its text."""
    return json.dumps(value) if isinstance(value, list | dict) else value


def _order(value: Any) -> tuple[int, Any]:
    """Return what values are sorted by: numbers, then texts, then what is none."""
    if isinstance(value, bool | int | float):
        return 0, value
    return (2, "") if value is None else (1, str(value))
