"""A recording as arrays, for a notebook or a script of one's own.

    with Recording("first.mcap") as recording:
        states = recording.states(robots=[1, 2], start=10.0)
        states["position"]    (rows, m), in the order of states["t"], then states["robot"]

Opening reads no message of an intact file; an array is read when it is asked for, from those parts
of the file that overlap with its time range. Times are in s of simulated time, ranges half-open.
"""

from collections.abc import Collection, Iterator, Sequence
from math import inf, isfinite
from os import PathLike
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import MissingExtraError
from nrs_cosim.recordings.export.tables import (
    LINK_EVENTS,
    SAMPLES,
    STATES,
    MessageTable,
    about,
    joints,
    robots,
    rows,
)
from nrs_cosim.recordings.mcap.container import Status
from nrs_cosim.recordings.mcap.reader import Reader

if TYPE_CHECKING:
    import xarray


class Recording:
    """The recording at `path`, checked as it opens; a context manager.

    Raises `UnreadableError` when there is no such file, when it is no recording of a run, or when
    its head is cut or damaged; and later, when a message cannot be what it should be.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self._reader = Reader(path)
        try:
            self.robots = robots(self._reader)
            """n; they are numbered from 1, and the target is 0."""
            self.joints = joints(self._reader)
            """m"""
        except BaseException:
            self.close()
            raise

    @property
    def scenario(self) -> str:
        """The text of the scenario."""
        return about(self._reader).scenario

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """What was noted of the run before it began: `nrs.run`, `nrs.versions`."""
        return self._reader.metadata

    @property
    def status(self) -> Status:
        """How the run ended: completed, failed, interrupted, or unfinished, when nothing says."""
        return self._reader.status

    @property
    def reason(self) -> str:
        """Why it ended so."""
        return self._reader.reason

    @property
    def digest(self) -> str | None:
        """SHA-256 over all samples and states of the run; None where some are not here."""
        return self._reader.digest

    @property
    def ticks(self) -> int:
        """How many ticks after tick 0 are here; each is whole."""
        return self._reader.ticks

    @property
    def damage(self) -> list[str]:
        """What is missing or wrong, in words; empty when nothing is."""
        return self._reader.damage

    def samples(
        self,
        robots: int | Collection[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> NDArray[np.void]:
        """Return rows of k, time_ns, t, robot, position, velocity: left limits at t_k.

        They are of start <= t < end, and of robots, as in `states`.
        Position and velocity are (rows, m), a robot's estimates of the target, or, of robot 0, the
        target's own.
        """
        return self._array(SAMPLES, robots, start, end)

    def states(
        self,
        robots: int | Collection[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> NDArray[np.void]:
        """Return rows of k, time_ns, t, robot, and five vectors: the output grid.

        They are of start <= t < end, s: the end is excluded. `robots` is one or several, all unless
        given; `ValueError` for one that there is not, and for a time that is none.

        The vectors are (rows, m); k is the tick that closes t. At t_k they are left limits.
        """
        return self._array(STATES, robots, start, end)

    def link_events(
        self,
        robots: int | Collection[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> NDArray[np.void]:
        """Return rows of k, time_ns, t, robot, source, lost, outage, delay, position, velocity.

        They are of start <= t < end, and of robots, as in `states`.
        A row is what the link from `source` to `robot` did to the sample of t_k; it may be lost:
        then position and velocity are 0. A robot that is its own source was in an outage.
        """
        return self._array(LINK_EVENTS, robots, start, end)

    def chunks(
        self,
        tables: Sequence[MessageTable],
        robots: Collection[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> Iterator[tuple[MessageTable, NDArray[np.void]]]:
        """Yield the same rows, of one or more tables in one pass, a chunk of whole ticks each.

        So a recording of any size is read in little memory.
        """
        return rows(self._reader, tables, robots, _ns("start", start), _ns("end", end))

    def dataset(self) -> "xarray.Dataset":
        """Return samples and states as an xarray Dataset.

        Dimensions are `time` (the output grid, s), `sampling_time` (t_k, s), `robot` and `joint`,
        from 1. What was not recorded is NaN. `MissingExtraError` without the extra `analysis`.
        """
        try:
            from nrs_cosim.recordings.export.dataset import dataset  # noqa: PLC0415 (an extra)
        except ImportError:
            raise MissingExtraError("a Dataset needs xarray", "analysis") from None
        return dataset(self._reader)

    def close(self) -> None:
        """Close the file; what is known of it stays."""
        self._reader.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _array(
        self,
        table: MessageTable,
        robots: int | Collection[int] | None,
        start: float | None,
        end: float | None,
    ) -> NDArray[np.void]:
        of = self._asked(robots)
        found = [part for _, part in self.chunks([table], of, start, end)]
        return np.concatenate([np.empty(0, table.dtype(self.joints)), *found])

    def _asked(self, robots: int | Collection[int] | None) -> Collection[int] | None:
        """Return robots that are asked for; `ValueError` for one that there is not."""
        if robots is None:
            return None
        asked = [robots] if isinstance(robots, int) else [*robots]
        for robot in asked:
            if robot not in range(self.robots + 1):
                raise ValueError(f"robots: expected 0, the target, to {self.robots}, got {robot!r}")
        return asked

    def __repr__(self) -> str:
        return (
            f"<Recording {str(self._reader.path)!r}: {self.status}, {self.robots} robots with "
            f"{self.joints} joints, {self.ticks} ticks{', damaged' * bool(self.damage)}>"
        )


def _ns(name: str, seconds: float | None) -> int | None:
    """Return a time in ns; infinity, where there is nothing beyond, is no limit."""
    if seconds is None or seconds == (-inf if name == "start" else inf):
        return None
    if not isfinite(seconds):
        raise ValueError(f"{name}: expected a time in s, got {seconds}")
    return round(seconds * 1e9)
