"""A sweep from Python: a scenario is run over axes and seeds, and what comes of it is a study."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from os import PathLike
from pathlib import Path
from shutil import rmtree
from signal import SIGINT
from tempfile import mkdtemp
from typing import Any
from weakref import finalize

from nrs_cosim.api.scenario import Scenario, experiment_of, plain
from nrs_cosim.api.study import Study
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.cli.output_paths import locked
from nrs_cosim.orchestrator.engine.interrupts import interrupts
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.study.axes import (
    Draw,
    DrawnRange,
    StudyAxis,
    axis_of,
    keys_of,
    seeds_of,
    with_draw,
    zipped,
)
from nrs_cosim.orchestrator.study.engines import lent_engine, local_engine
from nrs_cosim.orchestrator.study.plan import Refinement, StudyPlan
from nrs_cosim.orchestrator.study.points import SCENARIO_AXIS
from nrs_cosim.orchestrator.study.rows import (
    FAILURES,
    kept_recordings,
)
from nrs_cosim.orchestrator.study.store import StudyStore
from nrs_cosim.orchestrator.study.study import StudyProgress, sweep_into
from nrs_cosim.orchestrator.study.where import where_of

Axes = Mapping[Any, Any]
"""Values by key, or by a tuple of keys that go together."""


def sweep(
    scenario: Scenario | Sequence[Scenario],
    axes: Axes,
    *,
    seeds: int | Iterable[int] | None = None,
    out: str | PathLike[str] | None = None,
    draw: str | None = None,
    where: Callable[[Mapping[str, Any]], bool] | str | None = None,
    jobs: int | None = None,
    executor: Executor | None = None,
    keep: str = "failed",
    timeout: float | None = None,
    retry: bool = False,
    refine: str | None = None,
    width: float | None = None,
    progress: Callable[[StudyProgress], None] | None = None,
) -> Study:
    """Run a scenario over axes and seeds, and return the study.

    What is in the folder already is not run again, so the same call goes on where a crash, or
    Ctrl-C, has ended it, and one with more values runs what is new. A script needs no main guard.

    Args:
        scenario: What is run; several stand on an axis `scenario`, by their names.
        axes: Values by key, such as `{"algorithm.alpha": [0.5, 0.9]}`; a text as `nrs sweep --over`
            has it, such as `"0.1:1.3:25"`; a tuple of keys has tuples of values that go together.
        seeds: How many, from 1 on, or which; by default the scenario's.
        out: The study's folder; by default a temporary one, gone with the study.
        draw: `lhs:N` or `sobol:N`: how many points are drawn from the ranges `"a:b"`.
        where: Says of a point's values by key whether it is in the study; or a text as `nrs sweep
            --where` has it, such as `"algorithm.alpha <= algorithm.beta"`.
        jobs: How many processes run points; all processors by default, 0 is this one.
        executor: Any of `concurrent.futures` in their place, such as a Dask client's.
        keep: Which recordings: `none`, `failed`, `all`, or `every:N`, of N points one.
        timeout: s of wall time that a point may take.
        retry: Run points again that failed, crashed or took too long.
        refine: `boundary`, for all axes of numbers, or a key, for its own: values are run between
            two of which one converges.
        width: How close these come; by default a hundredth of the axis.
        progress: Is called with how far the study is, when a point is done.

    Returns:
        The study; its runs that failed are rows as all others.

    Raises:
        InputError: An axis or a point is wrong, or the folder has another study.
        RunError: The executor is gone; the rows there are stay.
        KeyboardInterrupt: The user stopped it, and the points under way have come to their end.

    Example:
        >>> import nrs_cosim as nrs
        >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
        >>> short = scenario.replace({"run.duration": 3.0})
        >>> nrs.sweep(short, {"algorithm.alpha": "0.9:1.4:3"}, seeds=2, jobs=0)
        Study(6 runs: 4 converged, 2 diverged)
    """
    bases, filled = _resolved(scenario, axes, seeds, draw)
    plan = StudyPlan(
        bases,
        filled,
        keep=kept_recordings("keep", keep),
        limit=timeout,
        where=where if callable(where) else where_of("where", where, keys_of(filled)),
        sent=type(executor).__module__.startswith("distributed"),
    )
    folder = Path(mkdtemp(prefix="nrs-study-") if out is None else out)
    folder.mkdir(parents=True, exist_ok=True)
    store = StudyStore(folder)
    engine = lent_engine(executor, jobs) if executor else local_engine(jobs)
    refinement = Refinement(refine, width) if refine else None
    with locked(store.journal), store, interrupts([SIGINT]) as stopped:
        sweep_into(
            store,
            plan,
            engine,
            (lambda now, _row: progress(now)) if progress else (lambda _now, _row: None),
            stopped,
            FAILURES if retry else (),
            refinement,
        )
        if stopped():
            raise KeyboardInterrupt
    study = Study(folder)
    if out is None:
        finalize(study, rmtree, folder, ignore_errors=True)
    return study


def _resolved(
    scenario: Scenario | Sequence[Scenario],
    axes: Axes,
    seeds: int | Iterable[int] | None,
    draw: str | None,
) -> tuple[dict[str, Experiment], tuple[StudyAxis, ...]]:
    several = [scenario] if isinstance(scenario, Scenario) else [*scenario]
    bases = {one.name: experiment_of(one) for one in several}
    if len(bases) < len(several):
        raise InputError("scenario: several have one name; give them others with replace(name=…)")
    found = [_axis(key, values) for key, values in axes.items()]
    if len(bases) > 1:
        found.insert(0, StudyAxis((SCENARIO_AXIS,), tuple((name,) for name in bases)))
    if seeds is not None:
        text = str(seeds) if isinstance(seeds, int) else ",".join(map(str, seeds)) + ","
        found.append(seeds_of("seeds", text.removesuffix(",") if isinstance(seeds, int) else text))
    return bases, with_draw(found, Draw.of("draw", draw) if draw else None)


def _axis(key: Any, values: Any) -> StudyAxis | DrawnRange:
    if isinstance(values, str):
        return axis_of("axes", f"{key}={values}")
    keys = key if isinstance(key, tuple) else (key,)
    try:
        rows = [plain(value) for value in values]
    except TypeError:
        raise InputError(f"axes: {quoted(key)}: expected values, got {quoted(values)}") from None
    columns = [[row[at] for row in rows] for at in range(len(keys))] if len(keys) > 1 else [rows]
    return zipped("axes", keys, columns)
