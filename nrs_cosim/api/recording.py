"""A recording with what follows from its scenario: errors against the target, theory, report."""

from collections.abc import Collection, Sequence
from functools import cached_property
from html import escape
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nrs_cosim.api.scenario import Scenario
from nrs_cosim.bus.errors import InputError, MissingExtraError
from nrs_cosim.bus.fields import column_names
from nrs_cosim.bus.plurals import count_of
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.analysis.results import Result
from nrs_cosim.orchestrator.engine.summary import describe, experiment_of, lines, measure
from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings import Recording as Tables
from nrs_cosim.recordings.export.tables import MESSAGES, flat, layout
from nrs_cosim.recordings.schemas import recorded_types

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
Grid = Literal["output", "sampling"]
Table = Literal["states", "samples", "agent_states", "measurements", "link_events", "errors"]
GRIDS: Sequence[str] = get_args(Grid)
TABLES: Sequence[str] = get_args(Table)


class Recording(Tables):
    """The recording at a path, opened for reading; a context manager.

    Times are s of simulated time; ranges have their start and not their end. Robots are numbered
    from 1, and the target is 0.

    Args:
        path: The file (MCAP).

    Raises:
        InputError: There is no such file, or it is no recording of a run; and later, when a message
            cannot be what it should be.

    Example:
        >>> import nrs_cosim as nrs
        >>> from tempfile import TemporaryDirectory
        >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
        >>> with TemporaryDirectory() as folder:
        ...     nrs.run(scenario.replace({"run.duration": 1.0}), f"{folder}/run.mcap").close()
        ...     with nrs.Recording(f"{folder}/run.mcap") as recording:
        ...         recording
        ...         recording.to_scenario() == scenario.replace({"run.duration": 1.0})
        Recording('run.mcap': completed, 6 robots, 10 ticks, digest a53d8f96)
        True
    """

    _folder: TemporaryDirectory[str] | None = None

    @cached_property
    def _experiment(self) -> Experiment:
        return experiment_of(self._reader)

    @classmethod
    def _temporary(cls, path: Path, folder: TemporaryDirectory[str]) -> "Recording":
        """Open a recording whose folder is gone when it is closed."""
        recording = cls(path)
        recording._folder = folder
        return recording

    def close(self) -> None:
        """Close the file; what is known of it stays. A temporary one is gone then."""
        super().close()
        if self._folder:
            self._folder.cleanup()

    @property
    def path(self) -> Path:
        """Where the file is."""
        return Path(self._reader.path)

    def to_scenario(self) -> Scenario:
        """Return the scenario that was run, to be changed and run again.

        Raises:
            InputError: An algorithm or a file that it names is not here.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
            ...     recording.to_scenario().replace({"run.seed": 2})["run.seed"]
            2
        """
        return Scenario._of(self._experiment, is_recorded=True)

    def times(self, grid: Grid = "output") -> Array:
        """Return the times of a grid that are here, in s.

        Args:
            grid: `output`, t_0 and all times at which states are recorded, or `sampling`, t_1 and
                all later sampling times.

        Returns:
            (T,), ascending.

        Raises:
            InputError: There is no such grid, or the file is damaged or closed.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
            ...     recording.times("output").shape, recording.times("sampling")[:3].tolist()
            ((51,), [0.1, 0.2, 0.3])
        """
        _expect("grid", grid, GRIDS)
        return self.states(robots=1)["t"] if grid == "output" else self.samples(robots=0)["t"]

    def target(self, t: ArrayLike | Grid = "output") -> tuple[Array, Array]:
        """Return the target's position and velocity, at the times of a grid or at any others.

        Args:
            t: A grid, as `times` has it; or times of any shape (…), s.

        Returns:
            Two arrays: (T, m) at the T times of a grid, (…, m) at times of the shape (…).

        Raises:
            InputError: There is no such grid, or a time is none.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
            ...     position, velocity = recording.target("sampling")
            ...     at_start, _ = recording.target(0.0)
            >>> position.shape, velocity.shape, at_start.tolist()
            ((10, 2), (10, 2), [0.0, -1.0])
        """
        if isinstance(t, str):
            return self._experiment.target_at(self.times(cast(Grid, t)))
        try:
            seconds = np.asarray(t, float)
        except (TypeError, ValueError):
            raise InputError(f"t: expected times in s, got {quoted(t)}") from None
        if not np.isfinite(seconds).all():
            raise InputError(f"t: expected times in s, got {quoted(t)}")
        return self._experiment.target_at(seconds)

    def errors(
        self,
        robots: int | Collection[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> NDArray[np.void]:
        """Return how far estimates and robots are off the target, on the output grid.

        Args:
            robots: One or several of 1 to n; all unless given.
            start: s; the first time that is asked for.
            end: s; the end is excluded.

        Returns:
            Rows of k, time_ns, t, robot and four vectors (rows, m): `position_estimate` ε_i − ε_0,
            `velocity_estimate` υ_i − υ_0, `position_tracking` q_i − ε_0, `velocity_tracking`
            q̇_i − υ_0. At t_k they are left limits.

        Raises:
            InputError: There is no such robot, a time is none, or the file is damaged or closed.

        Example:
            >>> import nrs_cosim as nrs
            >>> with nrs.run(nrs.Scenario.load("scenarios/paper_first_order.toml")) as recording:
            ...     errors = recording.errors(robots=[1, 2], start=24.0)
            >>> errors["position_estimate"].shape
            (602, 2)
            >>> round(float(abs(errors["position_estimate"]).max()), 3)
            0.151
        """
        states = self.states(robots, start, end)
        position, velocity = self.target(states["t"])
        kept = [(name, states.dtype[name]) for name in ("k", "time_ns", "t", "robot")]
        found = {
            "position_estimate": states["reference_position"] - position,
            "velocity_estimate": states["reference_velocity"] - velocity,
            "position_tracking": states["position"] - position,
            "velocity_tracking": states["velocity"] - velocity,
        }
        vectors = [(name, np.float64, (self.joints,)) for name in found]
        rows = np.empty(len(states), np.dtype([*kept, *vectors]))
        for name, _ in kept:
            rows[name] = states[name]
        for name, value in found.items():
            rows[name] = value
        return rows

    def analysis(self) -> dict[str, Any]:
        """Return what `nrs info --json` prints: the run, its errors, and the theory beside them.

        Returns:
            A dict of what JSON has. In `theory`, `quantities` has what was measured of each error
            beside its bounds, with a `status`.

        Raises:
            InputError: The file is damaged or closed.

        Example:
            >>> import nrs_cosim as nrs
            >>> with nrs.run(nrs.Scenario.load("scenarios/paper_first_order.toml")) as recording:
            ...     found = recording.analysis()
            >>> position = found["theory"]["quantities"][0]
            >>> position["name"], round(position["measured"], 4), position["status"]
            ('|eps - eps_0|inf', 0.1513, 'within')
        """
        return Result.of(self._reader, self._experiment).as_json()

    def to_pandas(
        self,
        table: Table = "states",
        robots: int | Collection[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> "pd.DataFrame":
        """Return a table, a column a number: `position_1`, …; needs the extra `analysis`.

        Args:
            table: `states`, `samples`, `agent_states`, `measurements`, `link_events` or `errors`.
            robots: As of that table, as the rest.
            start: s; the first time that is asked for.
            end: s; the end is excluded.

        Returns:
            The DataFrame, of the same rows.

        Raises:
            InputError: There is no such table, pandas is not installed, or as of the table.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
            ...     frame = recording.to_pandas("samples", robots=[1, 2])
            >>> frame.columns[4:].tolist(), len(frame)
            (['position_1', 'position_2', 'velocity_1', 'velocity_2'], 20)
        """
        _expect("table", table, TABLES)
        try:
            import pandas as pd  # noqa: PLC0415 (an extra)
        except ImportError:
            raise MissingExtraError("a DataFrame needs pandas", "analysis") from None
        rows: NDArray[np.void] = getattr(self, table)(robots, start, end)
        if not len(rows) and table in MESSAGES:
            of = layout(recorded_types(self._reader), MESSAGES[table])
            of.expect_few_columns(self.path)
        found: dict[str, Any] = {}
        for name in rows.dtype.names or ():
            found |= zip(column_names(name, rows[name].shape[1:]), flat(rows[name]).T, strict=True)
        return pd.DataFrame(found)

    def report(self, path: str | PathLike[str]) -> Path:
        """Write the run as `nrs report` does; needs the extra `report`.

        Args:
            path: Where it goes; `.html` is a page that needs no network, `.pdf`, `.png` and `.svg`
                are its figures. A report of the same kind that is there is replaced.

        Returns:
            The path.

        Raises:
            InputError: The name ends otherwise, another file is there, nothing can be written, what
                draws is not installed, or the recording holds no tick.

        Example:
            >>> import nrs_cosim as nrs
            >>> from tempfile import TemporaryDirectory
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> with TemporaryDirectory() as folder:
            ...     with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
            ...         page = recording.report(f"{folder}/run.html").read_text("utf-8")
            >>> page[:15]
            '<!doctype html>'
        """
        from nrs_cosim.orchestrator.cli.report_files import (  # noqa: PLC0415 (loads slowly)
            BEGINS,
            write_report,
        )

        output = Path(path)
        kind = output.suffix.lower().removeprefix(".")
        if kind not in BEGINS:
            endings = ", ".join(f".{form}" for form in BEGINS)
            raise InputError(f"{output}: expected a name that ends in one of {endings}")
        self._reader.expect_ticks("draw")
        write_report([story_of(self._reader, self._experiment)], output, kind)
        return output

    def __repr__(self) -> str:
        """Return what the recording is of, on a line."""
        about = f"digest {self.digest[:8]}" if self.digest else "messages are missing"
        return (
            f"Recording({self.path.name!r}: {self.status}, {count_of(self.robots, 'robot')}, "
            f"{count_of(self.ticks, 'tick')}, {about}{', closed' * self._reader.is_closed})"
        )

    def _repr_html_(self) -> str:
        """Return what a notebook shows: how the run ended, and its errors in the last fifth."""
        if self._reader.is_closed:
            return f"<code>{escape(repr(self))}</code>"
        found = lines(
            describe(self._reader, self._experiment), measure(self._reader, self._experiment)
        )
        if self.damage:
            found["damage"] = "; ".join(self.damage)
        rows = (f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in found.items())
        return f"<table>{''.join(rows)}</table>"


def _expect(name: str, given: object, known: Sequence[str]) -> None:
    if given not in known:
        raise InputError(f"{name}: expected {' or '.join(known)}, got {quoted(given)}")
