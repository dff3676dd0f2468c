"""A recording as arrays, for a notebook or a script of one's own.

    with Recording("first.mcap") as recording:
        states = recording.states(robots=[1, 2], start=10.0)
        states["position"]    (rows, m), in the order of states["t"], then states["robot"]

Opening reads no message of an intact file; an array is read when it is asked for, from those parts
of the file that overlap with its time range. Times are in s of simulated time, ranges half-open.
"""

from collections.abc import Collection, Iterator, Sequence
from math import inf, isfinite
from numbers import Integral, Real
from os import PathLike
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError, MissingExtraError
from nrs_cosim.bus.text import quoted
from nrs_cosim.recordings.export.tables import (
    AGENT_STATES,
    LINK_EVENTS,
    MEASUREMENTS,
    SAMPLES,
    STATES,
    MessageTable,
    joints,
    layout,
    robots,
    rows,
)
from nrs_cosim.recordings.mcap.container import Status
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.schemas import about, recorded_types

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
        """Return what travelled at the sampling times: left limits at t_k.

        Args:
            robots: One or several of 1 to n, and of 0, the target; all unless given.
            start: s; the first time that is asked for.
            end: s; the end is excluded.

        Returns:
            Rows of k, time_ns, t, robot, and what was sent, sorted by time, then robot. Most
            algorithms send `position` and `velocity`, (rows, m): a robot's estimates of the
            target, or the target's own; another's fields have the shapes that it declares.

        Raises:
            InputError: There is no such robot, a time is none, or the file is damaged or closed.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
            ...     samples = recording.samples(robots=[0, 3], start=0.5, end=0.8)
            >>> samples["t"].tolist(), samples["robot"].tolist(), samples["position"].shape
            ([0.5, 0.5, 0.6, 0.6, 0.7, 0.7], [0, 3, 0, 3, 0, 3], (6, 2))
        """
        return self._array(SAMPLES, robots, start, end)

    def states(
        self,
        robots: int | Collection[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> NDArray[np.void]:
        """Return the robots on the output grid; at t_k they are left limits.

        Args:
            robots: One or several of 1 to n; all unless given.
            start: s; the first time that is asked for.
            end: s; the end is excluded.

        Returns:
            Rows of k, the tick that closes t, time_ns, t, robot, and five vectors (rows, m):
            `position`, `velocity`, `effort` of the joints, `reference_position` and
            `reference_velocity` of what they follow; sorted by time, then robot.

        Raises:
            InputError: As of `samples`; the target has no states.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
            ...     states = recording.states(robots=3, end=0.1)
            >>> states["t"].tolist(), states["effort"].shape
            ([0.0, 0.02, 0.04, 0.06, 0.08], (5, 2))
        """
        return self._array(STATES, robots, start, end)

    def agent_states(
        self,
        robots: int | Collection[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> NDArray[np.void]:
        """Return what agents keep beside their estimates, right after t_k.

        Args:
            robots: One or several of 1 to n; all unless given.
            start: s; the first time that is asked for.
            end: s; the end is excluded.

        Returns:
            Rows of k, time_ns, t, robot, and the fields that the algorithm declares, of its shapes,
            sorted by time, then robot. There are none where agents keep no more than estimates.

        Raises:
            InputError: As of `states`.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
            ...     len(recording.agent_states())  # dcea1 keeps its estimate alone
            0
        """
        return self._array(AGENT_STATES, robots, start, end)

    def measurements(
        self,
        robots: int | Collection[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> NDArray[np.void]:
        """Return what pinned robots measured of the target at t_k, before their links did anything.

        Args:
            robots: One or several of 1 to n; all unless given.
            start: s; the first time that is asked for.
            end: s; the end is excluded.

        Returns:
            Rows of k, time_ns, t, robot, and the fields of samples, sorted by time, then robot.
            There are none where the algorithm has no measurement of its own.

        Raises:
            InputError: As of `states`.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/compare_kalman_consensus.toml")
            >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
            ...     measured = recording.measurements(end=0.2)
            >>> measured["robot"].tolist(), measured["position"].shape
            ([3], (1, 2))
        """
        return self._array(MEASUREMENTS, robots, start, end)

    def link_events(
        self,
        robots: int | Collection[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> NDArray[np.void]:
        """Return what links with faults did to samples on their way.

        Args:
            robots: One or several of 1 to n, at which links end; all unless given.
            start: s; the first time that is asked for.
            end: s; the end is excluded.

        Returns:
            Rows of k, time_ns, t, robot, source, lost, outage, delay, and what arrived, by the
            fields of samples. A row is what the link from `source` to `robot` did to the sample of
            t_k; it may be lost: then what arrived is 0. A robot that is its own source was in an
            outage.

        Raises:
            InputError: As of `states`.

        Example:
            >>> import nrs_cosim as nrs
            >>> lossy = nrs.Scenario.load("scenarios/paper_lossy_links.toml")
            >>> with nrs.run(lossy.replace({"run.duration": 2.0})) as recording:
            ...     events = recording.link_events()
            >>> events.dtype.names[:8]
            ('k', 'time_ns', 't', 'robot', 'source', 'lost', 'outage', 'delay')
            >>> len(events) > 0
            True
        """
        return self._array(LINK_EVENTS, robots, start, end)

    def chunks(
        self,
        tables: Sequence[MessageTable],
        robots: int | Collection[int] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> Iterator[tuple[MessageTable, NDArray[np.void]]]:
        """Return the same rows, of one or more tables in one pass, a chunk of whole ticks each.

        So a recording of any size is read in little memory.

        Args:
            tables: Some of `SAMPLES`, `STATES` and `LINK_EVENTS` of `nrs_cosim.recordings`.
            robots: As of `states`; the target too where samples are among the tables.
            start: s; the first time that is asked for.
            end: s; the end is excluded.

        Returns:
            An iterator of a table and rows of it.

        Raises:
            InputError: As of `samples`.

        Example:
            >>> import nrs_cosim as nrs
            >>> from nrs_cosim.recordings import SAMPLES, STATES
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
            ...     for table, rows in recording.chunks([SAMPLES, STATES], robots=3):
            ...         print(table.name, len(rows))
            samples 10
            states 51
        """
        first = min((table.first for table in tables), default=0)
        of = self._expected(robots, first)
        return rows(self._reader, tables, of, _ns("start", start), _ns("end", end))

    def dataset(self) -> "xarray.Dataset":
        """Return samples and states as an xarray Dataset; needs the extra `analysis`.

        Returns:
            The Dataset. Its dimensions are `time` (the output grid, s), `sampling_time` (t_k, s),
            `robot` and `joint`, from 1. What was not recorded is NaN.

        Raises:
            InputError: The file is damaged or closed, or xarray is not installed.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
            ...     data = recording.dataset()
            >>> dict(data.sizes)
            {'time': 51, 'robot': 6, 'joint': 2, 'sampling_time': 10}
            >>> data.effort.sel(robot=3, joint=1).dims
            ('time',)
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

    def __exit__(self, *_: object) -> None:
        self.close()

    def _array(
        self,
        table: MessageTable,
        robots: int | Collection[int] | None,
        start: float | None,
        end: float | None,
    ) -> NDArray[np.void]:
        found = [part for _, part in self.chunks([table], robots, start, end)]
        none = np.empty(0, layout(recorded_types(self._reader), table).dtype)
        return np.concatenate([none, *found])

    def _expected(self, robots: int | Collection[int] | None, first: int) -> frozenset[int] | None:
        """Return robots that are asked for; `InputError` for one that there is not."""
        if robots is None:
            return None
        found: set[int] = set()
        for robot in robots if np.iterable(robots) else [robots]:
            if not isinstance(robot, Integral) or int(robot) not in range(first, self.robots + 1):
                of = f"{first}{', the target,' * (not first)} to {self.robots}"
                raise InputError(f"robots: expected {of}, got {quoted(robot)}")
            found.add(int(robot))
        return frozenset(found)

    def __repr__(self) -> str:
        return (
            f"<Recording {str(self._reader.path)!r}: {self.status}, {self.robots} robots with "
            f"{self.joints} joints, {self.ticks} ticks{', damaged' * bool(self.damage)}>"
        )


def _ns(name: str, seconds: float | None) -> int | None:
    """Return a time in ns; infinity, where there is nothing beyond, is no limit."""
    if seconds is None or seconds == (-inf if name == "start" else inf):
        return None
    if not (isinstance(seconds, Real) and isfinite(seconds)):
        raise InputError(f"{name}: expected a time in s, got {quoted(seconds)}")
    return round(seconds * 1e9)
