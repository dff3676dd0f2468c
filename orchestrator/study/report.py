"""What a study's page and figures show: maps, slices, what theory did not foresee, and failures."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.plurals import count_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.study.rows import RESULTS
from nrs_cosim.orchestrator.study.statistics import CellStatistics, median_of, statistics_of
from nrs_cosim.orchestrator.study.store import StudyStore, rerun_line
from nrs_cosim.orchestrator.study.study import bases_of
from nrs_cosim.orchestrator.study.table import StudyTable
from nrs_cosim.orchestrator.study.theory_boundary import (
    HALVINGS_SIMULATED,
    MOST_SIMULATED,
    Distance,
    almost_surely_below_one,
    below_one,
    least_margin,
    theory_boundary,
)
from nrs_cosim.recordings.report.study_figures import (
    Array,
    StudyLine,
    StudyMap,
    StudySlice,
    study_svgs,
    write_study_figures,
)
from nrs_cosim.recordings.report.study_page import MOST, Cell, Listing, study_page

ERROR = "position_estimate"
ALMOST_SURE = ("almost_sure_lower", "almost_sure")
READ = (ERROR, "bounds", "spectral_radius", *ALMOST_SURE, "margin", "measured_rate")
READ_OF_RUNS = ("convergence", "digest")
READ_OF_FAILURES = ("cause_kind", "reason", "recording")
MOST_PANELS = 6
"""Combinations of the other axes that have a map or a line of their own."""
_FORESEEN = {"converges": "converged", "diverges": "diverged"}


class StudyReport:
    """All that is drawn and listed of a study."""

    def __init__(self, store: StudyStore) -> None:
        self._store = store
        self._table = StudyTable.of(store, *READ, *READ_OF_RUNS, *READ_OF_FAILURES)
        self._cells = statistics_of(self._table, ())
        self._numeric = [key for key in self._table.leading if self._is_numeric(key)]

    def write(self, path: Path, form: str, origin: Path | None = None) -> None:
        """Write a page, or figures; links are relative to where the page is to be."""
        maps, slices = list(self.maps()), list(self.slices())
        if form != "html":
            write_study_figures(maps, slices, path, form)
            return
        lead, tables = self.lead(), self.tables(origin or path)
        title, figures = f"Study {self._store.folder.name}", study_svgs(maps, slices)
        path.write_text(study_page(title, lead, figures, tables), "utf-8")

    def lead(self) -> dict[str, str]:
        """Return lines by name: first of all where runs were not as theory has it."""
        table, unforeseen = self._table, self.unforeseen()
        counts = ", ".join(f"{count} {status}" for status, count in sorted(table.counts.items()))
        axes = {
            key: f"{count_of(len(found), 'value')}, {found[0]} to {found[-1]}"
            for key in table.keys
            if (found := table.axis(key))
        }
        seen = "every run that has a result is as theory foresees"
        if unforeseen:
            seen = f"{count_of(len(unforeseen), 'run')} not as theory foresees, listed below"
        lost = {"not drawn": f"lines of theory: {self._scenarios[1]}"} if self._scenarios[1] else {}
        return {"theory": seen, **lost, "runs": f"{len(table)}: {counts}", **axes}

    def unforeseen(self) -> list[int]:
        """Return the places of rows whose status is not what theory says."""
        found = []
        columns = self._table.columns
        for place, (status, convergence) in enumerate(
            zip(columns["status"], columns["convergence"], strict=True)
        ):
            foreseen = _FORESEEN.get(convergence or "")
            result = "diverged" if status == "not_converged" else status
            if status in RESULTS and foreseen and result != foreseen:
                found.append(place)
        return found

    def tables(self, path: Path) -> dict[str, Listing]:
        """Return the page's tables, by heading."""
        table, columns = self._table, self._table.columns
        failures = [p for p, status in enumerate(columns["status"]) if status not in RESULTS]
        here = path.absolute().parent == self._store.folder.absolute()

        def row(place: int, *more: str) -> list[Cell]:
            values: list[Cell] = [_shown(table.values[key][place]) for key in table.keys]
            return [*values, columns["seed"][place], *(columns[name][place] for name in more)]

        head = (*table.keys, "seed")
        found: dict[str, Listing] = {}
        if unforeseen := self.unforeseen():
            names = ("status", "convergence", "spectral_radius", "measured_rate")
            found["Not as theory foresees"] = (
                (*head, *names, "again"),
                [[*row(p, *names), rerun_line(self._store, columns["key"][p])] for p in unforeseen],
            )
        if failures:
            found["Failures"] = (
                (*head, "status", "cause", "reason", "recording", "again"),
                [
                    [
                        *row(p, "status", "cause_kind", "reason"),
                        columns["recording"][p] if here else None,
                        rerun_line(self._store, columns["key"][p]),
                    ]
                    for p in failures
                ],
            )
        around = ("95 % from", "to")
        found["Cells"] = (
            (*table.keys, "runs", "converged", *around, f"median {ERROR}", *around, "again"),
            [
                self._cell_row(one) if number < MOST else []
                for number, one in enumerate(self._cells)
            ],
        )
        return found

    def maps(self) -> Iterator[StudyMap]:
        """Yield a map for the first two axes of numbers, one for each combination of the others."""
        for x, y in list(combinations(self._numeric, 2))[:1]:
            for name, cells in self._grouped([x, y]):
                at = {key: self._table.keys.index(key) for key in (x, y)}
                rows = [self._table.cells[one.cell] for one in cells]
                places = [(one.cell[at[x]], one.cell[at[y]]) for one in cells]
                others = dict(zip(self._table.keys, cells[0].cell, strict=True))
                edge = partial(self._edge, others, (x, y), dict(zip(places, rows, strict=True)))
                simulated = almost_surely_below_one, MOST_SIMULATED, HALVINGS_SIMULATED
                almost = edge(self._almost_below_one, *simulated) if self._draws else None
                yield StudyMap(
                    name or f"{count_of(len(cells), 'cell')}",
                    x,
                    y,
                    _array(one.cell[at[x]] for one in cells),
                    _array(one.cell[at[y]] for one in cells),
                    _array(one.converged.value for one in cells),
                    _array(self._quantiles(places)[0] for places in rows),
                    np.array([one.results < one.runs for one in cells]),
                    edge(self._below_one, below_one),
                    edge(self._margin, least_margin),
                    self._impaired,
                    almost,
                )

    def _edge(
        self,
        others: Mapping[str, Any],
        keys: tuple[str, str],
        rows: Mapping[tuple[float, float], Sequence[int]],
        value_of: Callable[[Sequence[int]], float | None],
        distance: Distance,
        *effort: int,
    ) -> Array:
        """Return where theory has a boundary among cells of some rows, (places, 2)."""
        if not self._scenarios[0]:
            return np.empty((0, 2))
        values = {place: value_of(there) for place, there in rows.items()}
        found = theory_boundary(self._scenarios[0], others, keys, values, distance, *effort)
        return np.array(found).reshape(-1, 2)

    def _below_one(self, places: Sequence[int]) -> float | None:
        radius = self._mean("spectral_radius", places)
        return None if radius is None else 1.0 - radius

    def _almost_below_one(self, places: Sequence[int]) -> float | None:
        growth = self._growth(places)
        return None if growth is None else 1.0 - growth

    def _growth(self, places: Sequence[int]) -> float | None:
        """Return e^λ of some rows: the middle of its confidence."""
        low, high = (self._mean(name, places) for name in ALMOST_SURE)
        return None if low is None or high is None else (low + high) / 2

    @cached_property
    def _draws(self) -> bool:
        """Whether links somewhere draw what they lose, so that e^λ is not ρ."""
        columns = self._table.columns
        pairs = zip(columns["almost_sure"], columns["spectral_radius"], strict=True)
        return any(almost is not None and almost != radius for almost, radius in pairs)

    def _margin(self, places: Sequence[int]) -> float | None:
        return self._mean("margin", places)

    @property
    def _impaired(self) -> bool:
        """Whether links have faults somewhere on the axes, which conditions know nothing of."""
        bases = any(base.impaired for base in self._scenarios[0].values())
        return bases or any(key.startswith("faults.") for key in self._table.keys)

    @cached_property
    def _scenarios(self) -> tuple[dict[str, Experiment], str]:
        """Return the scenarios; none, and why, where what they name is not here any more."""
        try:
            return bases_of(self._store), ""
        except InputError as error:
            return {}, str(error)

    def slices(self) -> Iterator[StudySlice]:
        """Yield the slices along each axis of numbers, up to two."""
        for key in self._numeric[:2]:
            lines = [self._line(name, key, cells) for name, cells in self._grouped([key])]
            if lines:
                yield StudySlice(key, lines)

    def _line(self, name: str, key: str, cells: Sequence[CellStatistics]) -> StudyLine:
        at = self._table.keys.index(key)
        rows = [self._table.cells[one.cell] for one in cells]
        shares, several = [one.converged for one in cells], any(one.runs > 1 for one in cells)
        errors = [self._quantiles(places) for places in rows]
        bounds = [self._bounds(places) for places in rows]
        names = [law for law in ("steady_state", "worst_case") if any(b.get(law) for b in bounds)]
        return StudyLine(
            name,
            _array(one.cell[at] for one in cells),
            (
                _array(one.value for one in shares),
                _array(one.low if several else None for one in shares),
                _array(one.high if several else None for one in shares),
            ),
            (
                _array(one[0] for one in errors),
                _array(one[1] for one in errors),
                _array(one[2] for one in errors),
            ),
            {law: _array(b.get(law) for b in bounds) for law in names},
            _array(self._mean("measured_rate", places) for places in rows),
            _array(self._mean("spectral_radius", places) for places in rows),
            _array(map(self._growth, rows)) if self._draws else None,
        )

    def _grouped(self, along: Sequence[str]) -> Iterator[tuple[str, list[CellStatistics]]]:
        """Yield the cells for each combination of the keys that are not drawn along, evenly few."""
        table = self._table
        others = [table.keys.index(key) for key in table.leading if key not in along]
        groups: dict[tuple[Any, ...], list[CellStatistics]] = {}
        for one in self._cells:
            groups.setdefault(tuple(one.cell[at] for at in others), []).append(one)
        step = max(len(groups) / MOST_PANELS, 1)
        chosen = {int(at * step) for at in range(MOST_PANELS)}
        for number, (values, cells) in enumerate(groups.items()):
            if number not in chosen:
                continue
            names = (
                f"{table.keys[at]} = {_shown(value)}"
                for at, value in zip(others, values, strict=True)
            )
            yield ", ".join(names), cells

    def _cell_row(self, one: CellStatistics) -> list[Cell]:
        places = self._table.cells[one.cell]
        share, error = one.converged, median_of(self._errors(places))
        return [
            *map(_shown, one.cell),
            one.runs,
            *(share.value, share.low, share.high),
            *(error.value, error.low, error.high),
            rerun_line(self._store, self._table.columns["key"][places[0]]),
        ]

    def _mean(self, column: str, places: Sequence[int]) -> float | None:
        values = [v for p in places if (v := self._table.columns[column][p]) is not None]
        return float(np.mean(values)) if values else None

    def _quantiles(self, places: Sequence[int]) -> tuple[float | None, ...]:
        values = self._errors(places)
        if not values:
            return None, None, None
        return tuple(float(v) for v in np.quantile(values, [0.5, 0.1, 0.9]))

    def _errors(self, places: Sequence[int]) -> list[float]:
        columns = self._table.columns
        good = [p for p in places if columns["status"][p] == "converged"]
        return [v for p in good if (v := columns[ERROR][p]) is not None]

    def _bounds(self, places: Sequence[int]) -> dict[str, Any]:
        found = json.loads(self._table.columns["bounds"][places[0]] or "{}")
        return dict(found.get(ERROR, {}))

    def _is_numeric(self, key: str) -> bool:
        values = self._table.axis(key)
        return len(values) > 1 and all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in values
        )


def _shown(value: Any) -> Cell:
    """Return a value of an axis as a table has it."""
    if value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
        return value
    return str(value)


def _array(values: Any) -> Array:
    """Return numbers, (values,), with NaN for what is None."""
    return np.array([np.nan if value is None else value for value in values], float)
