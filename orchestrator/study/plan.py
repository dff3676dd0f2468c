"""What a study is to run: scenarios, axes, conditions, refinement, and what a point's run is."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.study.axes import SEED, StudyAxis, evenly, grid_points
from nrs_cosim.orchestrator.study.point_run import PointTask
from nrs_cosim.orchestrator.study.points import PointReader, StudyPoint
from nrs_cosim.orchestrator.study.rows import written_point
from nrs_cosim.orchestrator.study.store import StudyStore
from nrs_cosim.orchestrator.study.table import cell_value
from nrs_cosim.orchestrator.study.where import Where

Values = Mapping[str, Any]
"""Of a point, by key of the axes."""
BOUNDARY = "boundary"
"""In place of a key that is refined."""
TRIED = 64
"""Values of an axis of which a point is read before any is run, the ends among them."""


@dataclass(frozen=True, slots=True)
class StudyPlan:
    """What is to be run, and how each point is."""

    scenarios: Mapping[str, Experiment]
    """By name; the first is that of points that name none."""
    axes: Sequence[StudyAxis]
    keep: str = "failed"
    """Which recordings: `none`, `failed`, `all`, or `every:N`, of N points one."""
    limit: float | None = None
    """s of wall time for a point."""
    where: Where = lambda _values: True
    sent: bool = False
    """Whether points are run by who has neither the study's folder nor its FMUs."""
    shard: tuple[int, int] = (1, 1)
    """Of so many parts of the study the one that is run here, from 1."""

    def chosen(self) -> Iterator[Values]:
        """Yield the values of the points in the order of the axes."""
        return filter(self.where, grid_points(self.axes))

    def expect_readable(self) -> None:
        """Read a point of each value of each axis; `InputError` says what is wrong with one."""
        reader, read = PointReader(self.scenarios), 0
        for at, axis in enumerate(self.axes):
            for value in evenly(axis.values, TRIED):
                axes = [*self.axes[:at], replace(axis, values=(value,)), *self.axes[at + 1 :]]
                for values in islice(filter(self.where, grid_points(axes)), 1):
                    reader.at(values)
                    read += 1
        if read:
            return
        first = next(self.chosen(), None)
        if first is None:
            raise InputError("where: of all points none is left")
        reader.at(first)

    def has(self, others: Sequence[tuple[str, Any]]) -> bool:
        """Return whether values of keys, as a table has them, are on the axes."""
        given = dict(others)
        return all(
            any(
                all(
                    given.get(k, v) == cell_value(v) for k, v in zip(axis.keys, values, strict=True)
                )
                for values in axis.values
            )
            for axis in self.axes
            if given.keys() & {*axis.keys}
        )

    def definition(self) -> dict[str, Any]:
        """Return what the study's folder says of it."""
        return {
            "scenarios": [
                {"name": name, "text": one.text, "folder": str(one.folder.absolute())}
                for name, one in self.scenarios.items()
            ],
            "axes": [
                {"keys": [*axis.keys], "values": [*map(list, axis.values)], "drawn": axis.drawn}
                for axis in self.axes
            ],
        }


@dataclass(frozen=True, slots=True)
class Refinement:
    """Along which key boundaries are narrowed, and to what width."""

    key: str
    """`BOUNDARY` for all axes of numbers."""
    width: float | None = None

    def keys_of(self, axes: Sequence[StudyAxis]) -> Sequence[str]:
        """Return the keys; `InputError` where one is on no axis, or goes together with others."""
        alone = [axis.keys[0] for axis in axes if len(axis.keys) == 1 and _is_refinable(axis)]
        if self.key == BOUNDARY and alone:
            return alone
        if self.key not in alone:
            raise InputError(
                f"refine: {quoted(self.key)}: expected {BOUNDARY}, or a key with an axis of its "
                "own, of two numbers at least"
            )
        return (self.key,)


def _is_refinable(axis: StudyAxis) -> bool:
    """Return whether there may be a value between two of an axis."""
    numbers = {value for (value,) in axis.values if type(value) in {int, float}}
    return axis.keys != (SEED,) and len(numbers) == len(axis.values) > 1


def task_of(point: StudyPoint, plan: StudyPlan, store: StudyStore) -> PointTask:
    """Return what a process needs to run a point."""
    keep, experiment = plan.keep, point.experiment
    if keep.startswith("every:"):
        keep = "all" if int(point.key[:8], 16) % int(keep[6:]) == 0 else "none"
    return PointTask(
        point.key,
        written_point(point.values),
        experiment.seed,
        experiment.text,
        experiment.name,
        str(experiment.folder.absolute()),
        experiment.assets,
        point.fmus,
        sent=plan.sent,
        limit=plan.limit,
        keep=keep,
        recordings=str(store.recordings.absolute()),
    )
