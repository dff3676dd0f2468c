"""A study, with what a person sees of it: how far it is, what failed, and how to run that again."""

import json
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from time import monotonic
from typing import Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.plurals import count_of
from nrs_cosim.orchestrator.cli.formats import expect_folder_name
from nrs_cosim.orchestrator.cli.option_groups import TlsOptions
from nrs_cosim.orchestrator.cli.output_paths import locked, make_folder
from nrs_cosim.orchestrator.cli.progress import status_lines
from nrs_cosim.orchestrator.cli.tables import grid
from nrs_cosim.orchestrator.engine.interrupts import interrupts
from nrs_cosim.orchestrator.exit_status import DONE, FAILED, INTERRUPTED
from nrs_cosim.orchestrator.scenario.changes import Change
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.orchestrator.study.axes import (
    Draw,
    StudyAxis,
    axis_of,
    evenly,
    keys_of,
    seeds_of,
    with_draw,
)
from nrs_cosim.orchestrator.study.boundary import changes_along
from nrs_cosim.orchestrator.study.cost import TimedPoint, estimated_cost, time_left
from nrs_cosim.orchestrator.study.dispatch import StudyEngine
from nrs_cosim.orchestrator.study.engines import dask_engine, local_engine
from nrs_cosim.orchestrator.study.plan import Refinement, StudyPlan, task_of
from nrs_cosim.orchestrator.study.point_run import run_point
from nrs_cosim.orchestrator.study.points import (
    FOLLOWED,
    PERIOD,
    SCENARIO_AXIS,
    PointReader,
    StudyPoint,
)
from nrs_cosim.orchestrator.study.rows import FAILURES, RESULTS, StudyRow, kept_recordings
from nrs_cosim.orchestrator.study.store import StudyStore, rerun_line
from nrs_cosim.orchestrator.study.study import StudyProgress, merge, sweep_into
from nrs_cosim.orchestrator.study.table import StudyTable
from nrs_cosim.orchestrator.study.where import where_of
from nrs_cosim.orchestrator.terminal import err, out, say

TIMED, READ = 3, 1000
"""Points that a dry run runs, to say how long the others take, and that it reads at most."""
KEPT = "all rows are kept; the same command goes on"


@dataclass(frozen=True, slots=True)
class SweepOptions:
    """What `nrs sweep` was given."""

    scenarios: Sequence[Path]
    over: Sequence[str]
    seeds: str | None
    output: Path
    draw: str | None
    where: str | None
    changes: Sequence[Change]
    jobs: int | None
    dask: str | None
    tls: TlsOptions
    keep: str
    timeout: float | None
    retry: bool
    refine: str | None
    width: float | None
    shard: tuple[int, int]
    as_json: bool

    def plan(self) -> StudyPlan:
        """Return what is to be run; `InputError` says what is wrong."""
        bases: dict[str, Experiment] = {}
        for path in self.scenarios:
            experiment = read_scenario(path, self.changes)
            if experiment.name in bases:
                raise InputError(f"{path}: another scenario is called {experiment.name} too")
            bases[experiment.name] = experiment
        axes = [axis_of("--over", text) for text in self.over]
        if len(bases) > 1:
            axes.insert(0, StudyAxis((SCENARIO_AXIS,), tuple((name,) for name in bases)))
        if self.seeds is not None:
            axes.append(seeds_of("--seeds", self.seeds))
        drawn = Draw.of("--draw", self.draw) if self.draw else None
        filled = with_draw(axes, drawn)
        return StudyPlan(
            bases,
            filled,
            kept_recordings("--keep", self.keep),
            self.timeout,
            where_of("--where", self.where, keys_of(filled)),
            sent=self.dask is not None,
            shard=self.shard,
        )

    def engine(self) -> StudyEngine:
        """Return who runs the points."""
        if self.dask is None:
            return local_engine(self.jobs)
        tls = self.tls.certificates()
        files = (
            {
                "tls_ca_file": str(tls.ca),
                "tls_client_cert": str(tls.certificate),
                "tls_client_key": str(tls.key),
            }
            if tls
            else None
        )
        return dask_engine(self.dask, files)


def perform_sweep(options: SweepOptions, *, dry_run: bool) -> None:
    """Run a study with what a person sees of it, and exit: 1 where a point failed."""
    expect_folder_name("-o", options.output, "a study is a folder; give the folder's name")
    plan = options.plan()
    _tell_followed(plan)
    if dry_run:
        _show_dry_run(plan, options)
        return
    try:
        stopped = _swept(plan, options)
        found = study_summary(options.output)
    except KeyboardInterrupt:  # before the first point, or twice
        raise KeyboardInterrupt(KEPT) from None
    if not options.as_json:
        show_study(out, found)
    if stopped:
        say("yellow", "interrupted", KEPT)
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(FAILED if found["failures"] else DONE)


def _swept(plan: StudyPlan, options: SweepOptions) -> bool:
    """Run a study into its folder; return whether the user has stopped it."""
    make_folder(options.output / "study.json")
    store = StudyStore(options.output)
    refinement = Refinement(options.refine, options.width) if options.refine else None
    with (
        locked(store.journal),
        store,
        interrupts([signal.SIGINT, signal.SIGTERM]) as stopped,
        _following(err, as_json=options.as_json) as follow,
    ):
        again = FAILURES if options.retry else ()
        sweep_into(store, plan, options.engine(), follow, stopped, again, refinement)
        return stopped()


def study_summary(folder: Path) -> dict[str, Any]:
    """Return what there is to say of a study, for JSON."""
    store = StudyStore(folder)
    table = StudyTable.of(store, "cause_kind", "reason", "recording")
    columns, statuses = table.columns, table.columns["status"]
    failures = [place for place, status in enumerate(statuses) if status not in RESULTS]
    boundaries = {}
    for key in table.keys:
        try:
            found = list(changes_along(table, key))
        except InputError:
            continue
        boundaries[key] = [
            {"of": dict(one.others), "low": one.low, "high": one.high} for one in found
        ]
    return {
        "folder": str(folder),
        "rows": len(table),
        "statuses": dict(sorted(table.counts.items())),
        "axes": {key: table.axis(key) for key in table.keys},
        "seeds": sorted({*columns["seed"]}),
        "boundaries": boundaries,
        "failures": [
            {
                "key": columns["key"][place],
                "point": {key: table.values[key][place] for key in table.keys},
                "seed": columns["seed"][place],
                "status": statuses[place],
                "cause": columns["cause_kind"][place],
                "reason": columns["reason"][place],
                "recording": columns["recording"][place],
                "command": rerun_line(store, columns["key"][place]),
            }
            for place in failures
        ],
    }


def show_study(console: Console, found: Mapping[str, Any]) -> None:
    """Show a study's summary, with its first failures."""
    counts = ", ".join(f"{count} {status}" for status, count in found["statuses"].items())
    rows = {"study": found["folder"], "rows": f"{found['rows']}: {counts or 'none'}"}
    for key, values in found["axes"].items():
        ends = " to ".join(str(value) for value in dict.fromkeys([*values[:1], *values[-1:]]))
        rows[key] = ", ".join(filter(None, (count_of(len(values), "value"), ends)))
    if len(found["seeds"]) > 1:
        rows["seeds"] = str(len(found["seeds"]))
    for key, changes in found["boundaries"].items():
        if changes:
            spans = ", ".join(f"{one['low']:g} to {one['high']:g}" for one in changes[:5])
            more = f" and {len(changes) - 5} more" if len(changes) > 5 else ""
            rows[key] += f"; convergence changes within {spans}{more}"
    grid(console, rows, max(map(len, rows)))
    for one in found["failures"][:10]:
        say("red", one["status"], f"{one['reason'] or one['cause']}; again: {one['command']}")
    if len(found["failures"]) > 10:
        say("red", "failed", f"and {len(found['failures']) - 10} more: nrs study info --json")


def merge_studies(output: Path, folders: Sequence[Path]) -> None:
    """Put the rows of folders into one, and say what it has then."""
    make_folder(output / "study.json")
    store = StudyStore(output)
    with locked(store.journal), store:
        merge(store, folders)
    show_study(out, study_summary(output))


def _tell_followed(plan: StudyPlan) -> None:
    keys = {key for axis in plan.axes for key in axis.keys}
    if PERIOD in keys:
        for line in FOLLOWED:
            if line.partition(":")[0] not in keys:
                say("blue", "follows", line)


def _show_dry_run(plan: StudyPlan, options: SweepOptions) -> None:
    """Say how much a study would be; of many points, by some of them."""
    plan.expect_readable()
    store, reader = StudyStore(options.output), PointReader(plan.scenarios)
    count = sum(1 for _ in plan.chosen())
    step = -(-count // READ)
    read = {
        point.key: point
        for values in islice(plan.chosen(), 0, None, step)
        if not isinstance(point := reader.read(values), StudyRow)
    }
    there = store.statuses() if store.exists else {}
    new = [point for key, point in read.items() if key not in there]
    every = count if step > 1 else len(read)
    share = every / max(len(read), 1)
    about = "about " if step > 1 else ""
    found = len(read) - len(new)
    ticks = share * sum(point.experiment.clock.ticks for point in new)
    seconds, size = estimated_cost(_timed(new, plan, store), ticks)
    grid(
        out,
        {
            "points": f"{every}, of which {about}{round(share * found)} have a row",
            "ticks": f"{about}{round(ticks)}",
            "time": f"about {seconds:.3g} s of one processor",
            "size": f"about {size / 1e6:.3g} MB of recordings if all were kept",
        },
    )


def _timed(points: Sequence[StudyPoint], plan: StudyPlan, store: StudyStore) -> list[TimedPoint]:
    """Run a few of some points, and return what each took."""
    rows = [(point, run_point(task_of(point, plan, store))) for point in evenly(points, TIMED)]
    return [
        TimedPoint(row["cpu_seconds"], point.experiment.clock.ticks, row["messages"] or 0)
        for point, row in rows
        if isinstance(row, dict)
    ]


@contextmanager
def _following(
    console: Console, *, as_json: bool
) -> Iterator[Callable[[StudyProgress, StudyRow | None], None]]:
    """Show how far a study is: a bar on a terminal, lines in a pipe, JSON where it is asked for."""
    latest, reached = StudyProgress(0), [(monotonic(), 0)]
    updated = monotonic()

    def take(now: StudyProgress) -> None:
        nonlocal latest, updated
        latest, updated = now, monotonic()
        if len(reached) == 1 and now.ticks:
            reached.append((updated, now.ticks))

    def left() -> str:
        if not latest.ticks:
            return ""
        seconds = time_left(reached, updated, latest.ticks, latest.ticks_left)
        seconds -= monotonic() - updated
        return f", about {seconds:.0f} s left" if seconds >= 0.5 else ""

    def status() -> str:
        if not latest.points:
            return "reading the points"
        failed = sum(latest.counts.get(status, 0) for status in FAILURES)
        lost = f", {failed} failed" if failed else ""
        return f"{latest.done} of {count_of(latest.points, 'point')}{lost}{left()}"

    if as_json:
        yield _print_line
        return
    if not console.is_terminal:

        def follow(now: StudyProgress, _row: StudyRow | None) -> None:
            take(now)

        with status_lines(console, status):
            yield follow
        return
    columns = (BarColumn(), TextColumn("{task.description}"), TimeRemainingColumn(compact=True))
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)

        def draw(now: StudyProgress, _row: StudyRow | None) -> None:
            take(now)
            total = now.ticks + now.ticks_left
            bar.update(task, completed=now.ticks, total=total or 1, description=status())

        yield draw


def _print_line(now: StudyProgress, row: StudyRow | None) -> None:
    done = {
        "points": now.points,
        "done": now.done,
        "failed": sum(now.counts.get(status, 0) for status in FAILURES),
    }
    found = {**done, "row": row.as_json()} if row else done
    out.print(json.dumps(found), markup=False, soft_wrap=True)
    out.file.flush()
