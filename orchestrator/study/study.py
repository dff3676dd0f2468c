"""A study is defined by scenarios and axes, and is whole when each of its points has a row.

Its folder says what it is of. The same command again runs what is missing; with more axes, values
or seeds it runs what is new; another scenario is another study. Rows are known by what was run and
not by where they stand on the axes, so none is ever run twice.

A point is read when its turn comes, so that the first run waits for none but one point of each
value: what is wrong with a value is told before anything is run. Values that are no scenario
together, each of which is one with others, are a row that failed.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import resolve_scenario
from nrs_cosim.orchestrator.study.axes import SEED
from nrs_cosim.orchestrator.study.boundary import StatusChange, to_refine
from nrs_cosim.orchestrator.study.dispatch import StudyEngine, dispatch
from nrs_cosim.orchestrator.study.plan import Refinement, StudyPlan, Values, task_of
from nrs_cosim.orchestrator.study.point_run import PointTask
from nrs_cosim.orchestrator.study.points import SCENARIO_AXIS, PointReader
from nrs_cosim.orchestrator.study.rows import RESULTS, StudyRow, written_point
from nrs_cosim.orchestrator.study.store import StudyStore
from nrs_cosim.orchestrator.study.table import StudyTable


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


class _StudyRun:
    """Points on their way to rows, in one go or several; each is read when its turn comes."""

    def __init__(
        self,
        store: StudyStore,
        plan: StudyPlan,
        follow: Follow,
        stopped: Callable[[], bool],
        retry: Iterable[str],
    ) -> None:
        self._store, self._plan, self._follow, self._stopped = store, plan, follow, stopped
        self._again, self._there, self._seen = {*retry}, store.statuses(), set[bytes]()
        self.reader = PointReader(plan.scenarios)
        self._ticks: dict[str, int] = {}
        self._read_ticks = self._read = 0

    def run(self, chosen: Iterable[Values], count: int, engine: StudyEngine) -> None:
        """Run those of the points that have no row."""
        self._progress = StudyProgress(count)
        self._tell(None)
        dispatch(self._tasks(chosen), engine, self._put, self._stopped)
        if self._shown != (self._progress.points, self._progress.done):
            self._tell(None)
        self._store.roll()

    def _tell(self, row: StudyRow | None) -> None:
        self._shown = self._progress.points, self._progress.done
        self._follow(self._progress, row)

    def _tasks(self, chosen: Iterable[Values]) -> Iterator[PointTask]:
        part, parts = self._plan.shard
        for values in chosen:
            if self._stopped():
                return
            point = self.reader.read(values)
            key, now = point.key, self._progress
            mark = bytes.fromhex(key)
            if mark in self._seen or int(key[:8], 16) % parts != part - 1:
                now.points -= 1
                continue
            self._seen.add(mark)
            if self._there.get(key) not in {None, *self._again}:
                now.done += 1
                now.found += 1
            elif isinstance(point, StudyRow):
                self._put(point)
            else:
                ticks = point.experiment.clock.ticks
                self._ticks[key] = ticks
                self._read_ticks, self._read = self._read_ticks + ticks, self._read + 1
                yield task_of(point, self._plan, self._store)

    def _put(self, row: StudyRow) -> None:
        self._store.put(row)
        now = self._progress
        now.done += 1
        now.counts[row.status] = now.counts.get(row.status, 0) + 1
        now.ticks += self._ticks.pop(row.key, 0)
        each = self._read_ticks / max(self._read, 1)
        now.ticks_left = round(each * (now.points - now.done))
        self._tell(row)


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

    `InputError` says what is wrong with a value, before any point is run.
    """
    plan.expect_readable()
    keys = refine.keys_of(plan.axes) if refine else ()
    count = sum(1 for _ in plan.chosen())
    define(store, plan)
    run = _StudyRun(store, plan, follow, stopped, retry)
    run.run(plan.chosen(), count, engine)
    known = set[str]()
    while refine and not stopped():
        table = StudyTable.of(store, "status")
        more = {
            written_point(values): values
            for key in keys
            for change in to_refine(table, key, refine.width)
            if plan.has(change.others)
            for values in _between(plan, key, change)
            if not (change.is_of_whole_numbers and isinstance(run.reader.read(values), StudyRow))
        }
        new = [values for text, values in more.items() if text not in known]
        if not new:
            return
        known |= more.keys()
        run.run(new, len(new), engine)


def _between(plan: StudyPlan, key: str, change: StatusChange) -> Iterator[Values]:
    """Yield the points in the middle of a boundary, one for each seed."""
    seeds = next((axis.values for axis in plan.axes if axis.keys == (SEED,)), ((None,),))
    others = {name: json.loads(v) if _is_json(v) else v for name, v in change.others}
    for (seed,) in seeds:
        values = {**others, key: change.middle} | ({} if seed is None else {SEED: seed})
        values = {name: value for name, value in values.items() if value is not None}
        if plan.where(values):
            yield values


def _is_json(value: Any) -> bool:
    """Return whether a cell has the text of a list or a table."""
    return isinstance(value, str) and value[:1] in {"[", "{"}


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
    reader = PointReader(bases_of(store))
    return reader.at({SCENARIO_AXIS: scenario, **values, SEED: seed}).experiment


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
