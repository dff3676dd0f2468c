"""Studies from Python: many runs of a scenario, in a folder that keeps every row."""

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nrs_cosim.api.scenario import Scenario
from nrs_cosim.bus.errors import MissingExtraError
from nrs_cosim.bus.plurals import count_of
from nrs_cosim.orchestrator.study.boundary import changes_along
from nrs_cosim.orchestrator.study.rows import COLUMNS, StudyRow, table_digest
from nrs_cosim.orchestrator.study.statistics import statistics_of
from nrs_cosim.orchestrator.study.store import StudyStore
from nrs_cosim.orchestrator.study.study import experiment_at
from nrs_cosim.orchestrator.study.table import StudyTable

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class Study:
    """A study in its folder: a row for each run, as far as they are done.

    Args:
        folder: Where `nrs.sweep` or `nrs sweep` has put it.

    Raises:
        InputError: There is no study.

    Example:
        >>> import nrs_cosim as nrs
        >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
        >>> short = scenario.replace({"run.duration": 2.0})
        >>> study = nrs.sweep(short, {"algorithm.alpha": [0.9, 1.4]}, jobs=0)
        >>> study
        Study(2 runs: 1 converged, 1 not_converged)
    """

    def __init__(self, folder: str | PathLike[str]) -> None:
        self.folder = Path(folder)
        """Where it is."""
        self._store = StudyStore(self.folder)
        self._store.definition()

    @property
    def rows(self) -> list[StudyRow]:
        """The rows as they came, one for each run."""
        return list(self._store.rows())

    @property
    def digest(self) -> str:
        """SHA-256 of the rows by key, without what is of the machine that ran them."""
        return table_digest(self._store.rows())

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of the axes, without the seed."""
        return self._table("status").keys

    def __len__(self) -> int:
        """Return how many runs have a row."""
        return len(self._table("status"))

    def __repr__(self) -> str:
        """Return how many runs there are, by status."""
        counts = self._table("status").counts
        counted = ", ".join(f"{count} {status}" for status, count in sorted(counts.items()))
        return f"Study({count_of(sum(counts.values()), 'run')}: {counted or 'none'})"

    def scenario(self, key: str) -> Scenario:
        """Return the scenario of a row, to be run again with a recording.

        Args:
            key: The row's, or how it begins.

        Raises:
            InputError: No row, or more than one, has a key that begins so.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> short = scenario.replace({"run.duration": 1.0})
            >>> study = nrs.sweep(short, {"algorithm.alpha": [0.9]}, jobs=0)
            >>> row = study.rows[0]
            >>> with nrs.run(study.scenario(row.key)) as recording:
            ...     recording.digest == row.digest
            True
        """
        experiment = experiment_at(self._store, key)
        return Scenario._of(experiment)

    def boundary(self, key: str) -> list[dict[str, Any]]:
        """Return between which values of a key runs stop converging, for all other values.

        Args:
            key: An axis of numbers.

        Returns:
            Dicts of the other keys' values, `low` and `high`, and `converges_below`.

        Raises:
            InputError: It is no such axis.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> short = scenario.replace({"run.duration": 3.0})
            >>> study = nrs.sweep(short, {"algorithm.alpha": [0.9, 1.1, 1.4]}, jobs=0)
            >>> study.boundary("algorithm.alpha")
            [{'low': 1.1, 'high': 1.4, 'converges_below': True}]
        """
        return [
            {
                **dict(one.others),
                "low": one.low,
                "high": one.high,
                "converges_below": one.converges_below,
            }
            for one in changes_along(self._table("status"), key)
        ]

    def to_pandas(self) -> "pd.DataFrame":
        """Return the rows in the order of the axes; needs the extra `analysis`.

        Each key of the axes has a column, under its name.

        Raises:
            InputError: pandas is not installed.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> short = scenario.replace({"run.duration": 1.0})
            >>> frame = nrs.sweep(short, {"algorithm.alpha": [0.8, 0.9]}, jobs=0).to_pandas()
            >>> frame[["algorithm.alpha", "spectral_radius"]].round(3).values.tolist()
            [[0.8, 0.878], [0.9, 0.878]]
        """
        pandas = _pandas()
        table = self._table()
        kept = {name: table.columns[name] for name in COLUMNS if name != "point"}
        frame: pd.DataFrame = pandas.DataFrame({**table.values, **kept})
        order = [place for places in table.cells.values() for place in places]
        in_order: pd.DataFrame = frame.iloc[order].reset_index(drop=True)
        return in_order

    def statistics(self) -> "pd.DataFrame":
        """Return, over the seeds, the share that converged and the errors, with their intervals.

        The share has Wilson's interval of 95 %, the median of an error that of the bootstrap.

        Raises:
            InputError: pandas is not installed.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> short = scenario.replace({"run.duration": 2.0})
            >>> study = nrs.sweep(short, {"algorithm.alpha": [0.9]}, seeds=3, jobs=0)
            >>> study.statistics()[["runs", "converged", "converged_low"]].round(3).values.tolist()
            [[3.0, 1.0, 0.439]]
        """
        pandas = _pandas()
        table = self._table()
        found = []
        for one in statistics_of(table):
            row = dict(zip(table.keys, one.cell, strict=True))
            row |= {"runs": one.runs, "results": one.results}
            for name, estimated in {"converged": one.converged, **one.errors}.items():
                row[name] = estimated.value
                row[f"{name}_low"], row[f"{name}_high"] = estimated.low, estimated.high
            found.append(row)
        frame: pd.DataFrame = pandas.DataFrame(found)
        return frame

    def dataset(self) -> "xr.Dataset":
        """Return the rows over the axes and seeds; needs the extra `analysis`.

        What was not run is NaN, or an empty text. Keys of axes are dimensions, `seed` the last; of
        keys that go together the first is.

        Raises:
            InputError: xarray is not installed.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> short = scenario.replace({"run.duration": 1.0})
            >>> study = nrs.sweep(short, {"algorithm.alpha": [0.8, 0.9]}, seeds=2, jobs=0)
            >>> data = study.dataset()
            >>> dict(data.sizes), data.status.sel(seed=1).values.tolist()
            ({'algorithm.alpha': 2, 'seed': 2}, ['converged', 'converged'])
        """
        try:
            import xarray as xr  # noqa: PLC0415 (an extra)
        except ImportError:
            raise MissingExtraError("a Dataset needs xarray", "analysis") from None
        table = self._table()
        axes = {key: table.axis(key) for key in table.leading}
        axes["seed"] = sorted({*table.columns["seed"]})
        shape = tuple(map(len, axes.values()))
        where = {key: {value: at for at, value in enumerate(found)} for key, found in axes.items()}
        at = np.empty((len(shape), len(table)), np.intp)
        for cell, rows in table.cells.items():
            for axis, key in enumerate(table.leading):
                at[axis, rows] = where[key][cell[table.keys.index(key)]]
        at[-1] = [where["seed"][seed] for seed in table.columns["seed"]]
        variables = {}
        together = {key: table.values[key] for key in table.keys if key not in table.leading}
        for name, values in {**table.columns, **together}.items():
            if name in {"point", "seed"}:
                continue
            is_text = any(isinstance(value, str | list | dict) for value in values)
            number = COLUMNS.get(name, "str" if is_text else "float") != "str"
            data = np.full(shape, np.nan) if number else np.full(shape, "", object)
            empty = np.nan if number else ""
            data[tuple(at)] = [empty if value is None else value for value in values]
            variables[name] = (tuple(axes), data if number else data.astype(str))
        return xr.Dataset(variables, axes)

    def report(self, path: str | PathLike[str]) -> None:
        """Draw the study: `.html` is a page, `.png`, `.pdf` and `.svg` its figures.

        Args:
            path: Where it goes.

        Raises:
            InputError: matplotlib is not installed, or the file cannot be made or replaced.

        Example:
            >>> import nrs_cosim as nrs
            >>> from tempfile import TemporaryDirectory
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> short = scenario.replace({"run.duration": 1.0})
            >>> study = nrs.sweep(short, {"algorithm.alpha": [0.8, 0.9, 1.4]}, jobs=0)
            >>> with TemporaryDirectory() as folder:
            ...     study.report(f"{folder}/study.html")
        """
        from nrs_cosim.orchestrator.cli.formats import format_of  # noqa: PLC0415, of this alone
        from nrs_cosim.orchestrator.cli.report_files import BEGINS, write_study  # noqa: PLC0415

        path = Path(path)
        write_study(self._store, path, format_of(path, None, tuple(BEGINS)))

    def _table(self, *only: str) -> StudyTable:
        return StudyTable.of(self._store, *only)


def _pandas() -> Any:
    try:
        import pandas  # noqa: PLC0415 (an extra)
    except ImportError:
        raise MissingExtraError("a DataFrame needs pandas", "analysis") from None
    return pandas
