"""A recording with what follows from its scenario: errors against the target, theory, report."""

from functools import cached_property
from html import escape
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.api.scenario import Scenario
from nrs_cosim.bus.errors import MissingExtraError
from nrs_cosim.orchestrator.analysis.results import Result
from nrs_cosim.orchestrator.engine.summary import describe, experiment_of, lines, measure
from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings import Recording as Tables

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]


class Recording(Tables):
    """The recording at a path, opened for reading; a context manager.

    Times are s of simulated time; ranges have their start and not their end. Robots are numbered
    from 1, and the target is 0.

    Args:
        path: The file (MCAP).

    Raises:
        InputError: There is no such file, or it is no recording of a run; and later, when a message
            cannot be what it should be.
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
        """Return the scenario that was run, to be changed and run again."""
        return Scenario._of(self._experiment.text, self._experiment)

    def target(self, t: Any) -> tuple[Array, Array]:
        """Return the target's position and velocity, each (..., m), at times t, s."""
        return self._experiment.target_at(np.asarray(t, float))

    def errors(
        self,
        robots: int | list[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> NDArray[np.void]:
        """Return how far estimates and robots are off the target, on the output grid.

        Rows of k, time_ns, t, robot and four vectors (rows, m): `position_estimate` ε_i − ε_0,
        `velocity_estimate` υ_i − υ_0, `position_tracking` q_i − ε_0, `velocity_tracking` q̇_i − υ_0.
        At t_k they are left limits.
        """
        states = self.states([robots] if isinstance(robots, int) else robots, start, end)
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
        """Return what `nrs info --json` prints: the run, its errors, and the theory beside them."""
        return Result.of(self._reader, self._experiment).as_json()

    def to_pandas(self, table: Literal["samples", "states"] = "states") -> "pd.DataFrame":
        """Return a table, a column a number: `position_1`, …; needs the extra `analysis`."""
        try:
            import pandas as pd  # noqa: PLC0415 (an extra)
        except ImportError:
            raise MissingExtraError("a DataFrame needs pandas", "analysis") from None
        rows = self.samples() if table == "samples" else self.states()
        columns: dict[str, Any] = {}
        for name in rows.dtype.names or ():
            if rows[name].ndim == 1:
                columns[name] = rows[name]
            else:
                columns |= {f"{name}_{j + 1}": rows[name][:, j] for j in range(self.joints)}
        return pd.DataFrame(columns)

    def report(self, path: str | PathLike[str]) -> Path:
        """Write the run as one page that needs no network; needs the extra `report`."""
        from nrs_cosim.recordings.report.page import page  # noqa: PLC0415 (an extra)

        target = Path(path)
        target.write_text(page([story_of(self._reader, self._experiment)]), "utf-8")
        return target

    def __repr__(self) -> str:
        """Return what the recording is of, on a line."""
        of = f"digest {self.digest[:8]}" if self.digest else "messages are missing"
        return (
            f"Recording({self.path.name!r}: {self.status}, {self.robots} robots, "
            f"{self.ticks} ticks, {of})"
        )

    def _repr_html_(self) -> str:
        """Return what a notebook shows: how the run ended, and its errors in the last fifth."""
        summary = lines(
            describe(self._reader, self._experiment), measure(self._reader, self._experiment)
        )
        rows = (f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in summary.items())
        return f"<table>{''.join(rows)}</table>"
