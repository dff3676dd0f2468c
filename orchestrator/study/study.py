"""A study is defined by scenarios and axes, and is whole when each of its points has a row.

Its folder says what it is of. The same command again runs what is missing; with more axes, values
or seeds it runs what is new; another scenario is another study. Rows are known by what was run and
not by where they stand on the axes, so none is ever run twice.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import parse_scenario, resolve_scenario
from nrs_cosim.orchestrator.study.axes import SEED, StudyAxis, grid_points
from nrs_cosim.orchestrator.study.boundary import StatusChange, to_refine
from nrs_cosim.orchestrator.study.dispatch import StudyEngine, dispatch
from nrs_cosim.orchestrator.study.point_run import PointTask
from nrs_cosim.orchestrator.study.points import SCENARIO_AXIS, StudyPoint, study_point
from nrs_cosim.orchestrator.study.rows import RESULTS, StudyRow, written_point
from nrs_cosim.orchestrator.study.store import StudyStore
from nrs_cosim.orchestrator.study.table import StudyTable

Where = Callable[[Mapping[str, Any]], bool]
"""Says of a point's values whether it is in the study."""


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

    def points(self) -> Iterator[StudyPoint]:
        """Yield the points, each once, in the order of the axes."""
        seen = set()
        for values in grid_points(self.axes):
            if self.where(values):
                point = study_point(self.scenarios, values)
                if point.key not in seen:
                    seen.add(point.key)
                    yield point

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
    width: float | None = None

    def expect_axis(self, axes: Sequence[StudyAxis]) -> None:
        """Raise `InputError` where the key is on no axis, or goes together with others."""
        if not any(axis.keys == (self.key,) for axis in axes):
            raise InputError(
                f"refine: {quoted(self.key)}: expected a key with an axis of its own in the study"
            )


@dataclass(slots=True)
class StudyProgress:
    """How far a study is."""

    points: int
    done: int = 0
    """With those whose rows were there."""
    found: int = 0
    """Those whose rows were there."""
    counts: dict[str, int] = field(default_factory=dict)
    """Of rows, by status."""
    ticks: int = 0
    """Of points that were run."""
    ticks_left: int = 0


Follow = Callable[[StudyProgress, StudyRow | None], None]


def define(store: StudyStore, plan: StudyPlan) -> None:
    """Say in a study's folder what it is of; `InputError` where it is of other scenarios."""
    wanted = plan.definition()
    if store.exists:
        there = store.definition()
        texts = {one["name"]: one["text"] for one in there["scenarios"]}
        for one in wanted["scenarios"]:
            if texts.get(one["name"], one["text"]) != one["text"]:
                raise InputError(
                    f"{store.folder}: is a study of another scenario {quoted(one['name'])}; give "
                    "another folder, or put the change on an axis with one value"
                )
    store.recordings.mkdir(parents=True, exist_ok=True)
    store.define(wanted)


def run_study(
    store: StudyStore,
    points: Sequence[StudyPoint],
    plan: StudyPlan,
    engine: StudyEngine,
    follow: Follow = lambda _progress, _row: None,
    stopped: Callable[[], bool] = lambda: False,
    retry: Iterable[str] = (),
) -> None:
    """Run the points that have no row; with `retry`, also those whose row has such a status."""
    part, parts = plan.shard
    mine = [point for point in points if int(point.key[:8], 16) % parts == part - 1]
    there, again = store.statuses(), {*retry}
    new = [point for point in mine if there.get(point.key) in {None, *again}]
    progress = StudyProgress(len(mine), len(mine) - len(new), len(mine) - len(new))
    progress.ticks_left = sum(point.ticks for point in new)
    ticks = {point.key: point.ticks for point in new}
    follow(progress, None)

    def put(row: StudyRow) -> None:
        store.put(row)
        progress.done += 1
        progress.counts[row.status] = progress.counts.get(row.status, 0) + 1
        progress.ticks += ticks[row.key]
        progress.ticks_left -= ticks[row.key]
        follow(progress, row)

    dispatch((task_of(point, plan, store) for point in new), engine, put, stopped)
    store.roll()


def sweep_into(
    store: StudyStore,
    plan: StudyPlan,
    engine: StudyEngine,
    follow: Follow = lambda _progress, _row: None,
    stopped: Callable[[], bool] = lambda: False,
    retry: Iterable[str] = (),
    refine: Refinement | None = None,
) -> None:
    """Run a study whole, and then between values where runs stop converging, if that is asked.

    Every point is read before the first is run: `InputError` says what is wrong with one.
    """
    points = list(plan.points())
    if refine:
        refine.expect_axis(plan.axes)
    define(store, plan)
    run_study(store, points, plan, engine, follow, stopped, retry)
    known = {point.key for point in points}
    while refine and not stopped():
        table = StudyTable.of(store, "status")
        more = [
            point
            for change in to_refine(table, refine.key, refine.width)
            for point in _between(plan, refine.key, change)
            if point.key not in known
        ]
        if not more:
            return
        known |= {point.key for point in more}
        run_study(store, more, plan, engine, follow, stopped, retry)


def _between(plan: StudyPlan, key: str, change: StatusChange) -> Iterator[StudyPoint]:
    """Yield the points in the middle of a boundary, one for each seed."""
    seeds = next((axis.values for axis in plan.axes if axis.keys == (SEED,)), ((None,),))
    others = {name: json.loads(v) if _is_json(v) else v for name, v in change.others}
    for (seed,) in seeds:
        values = {**others, key: change.middle} | ({} if seed is None else {SEED: seed})
        yield study_point(plan.scenarios, {name: v for name, v in values.items() if v is not None})


def _is_json(value: Any) -> bool:
    """Return whether a cell has the text of a list or a table."""
    return isinstance(value, str) and value[:1] in {"[", "{"}


def task_of(point: StudyPoint, plan: StudyPlan, store: StudyStore) -> PointTask:
    """Return what a process needs to run a point."""
    keep = plan.keep
    if keep.startswith("every:"):
        keep = "all" if int(point.key[:8], 16) % int(keep[6:]) == 0 else "none"
    return PointTask(
        point.key,
        written_point(point.values),
        point.seed,
        point.text,
        point.name,
        point.folder,
        point.assets,
        point.fmus,
        sent=plan.sent,
        limit=plan.limit,
        keep=keep,
        recordings=str(store.recordings.absolute()),
    )


def bases_of(store: StudyStore) -> dict[str, Experiment]:
    """Return a study's scenarios, by name, with what they name."""
    return {
        one["name"]: resolve_scenario(one["text"], one["name"], Path(one["folder"]), one["name"])
        for one in store.definition()["scenarios"]
    }


def experiment_at(store: StudyStore, key: str) -> Experiment:
    """Return the experiment of the row whose key begins so; `InputError` unless there is one."""
    table = StudyTable.of(store, "key")
    places = [at for at, one in enumerate(table.columns["key"]) if one.startswith(key)]
    if len(places) != 1:
        raise InputError(f"key: {quoted(key)}: {len(places)} rows have a key that begins so")
    (place,) = places
    values = json.loads(table.columns["point"][place])
    seed, scenario = table.columns["seed"][place], table.columns["scenario"][place]
    point = study_point(bases_of(store), {SCENARIO_AXIS: scenario, **values, SEED: seed})
    return parse_scenario(point.text, point.name, Path(point.folder), point.name, point.assets)


def merge(store: StudyStore, others: Sequence[Path]) -> int:
    """Put the rows and recordings of other folders of a study into one; return how many are new."""
    wanted: dict[str, Any] | None = store.definition() if store.exists else None
    for folder in others:
        other = StudyStore(folder).definition()
        if wanted is None:
            wanted = {key: other[key] for key in ("scenarios", "axes")}
        texts = {one["name"]: one["text"] for one in wanted["scenarios"]}
        for one in other["scenarios"]:
            if texts.get(one["name"]) != one["text"]:
                raise InputError(f"{folder}: is a study of another scenario {quoted(one['name'])}")
        wanted["axes"] = joined_axes(wanted["axes"], other["axes"])
    if not store.exists:
        store.recordings.mkdir(parents=True, exist_ok=True)
    store.define(wanted or {})
    there, new = store.statuses(), 0
    for folder in others:
        other_store = StudyStore(folder)
        for row in other_store.rows():
            if there.get(row.key) in RESULTS or (row.key in there and row.status not in RESULTS):
                continue
            if row.recording and (folder / row.recording).is_file():
                kept = store.folder / row.recording
                kept.write_bytes((folder / row.recording).read_bytes())
            store.put(row)
            new += row.key not in there
            there[row.key] = row.status
    store.roll()
    return new


def joined_axes(
    mine: Sequence[Mapping[str, Any]], others: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """Return axes with the values of both, those of one first."""
    found = [{**axis, "values": [*axis["values"]]} for axis in mine]
    for axis in others:
        same = next((one for one in found if one["keys"] == axis["keys"]), None)
        if same is None:
            found.append({**axis, "values": [*axis["values"]]})
        else:
            same["values"] += [value for value in axis["values"] if value not in same["values"]]
    return found
