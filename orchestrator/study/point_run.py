"""One point of a study is run: a task in, a row out, both plain values that any process can read.

What goes wrong in a run is in its row; only what ends the process, or the user's interrupt, is not.
Theory is computed once for points that differ by what it does not ask for, which are the seed and
what robots start with, unless a network or a clock is drawn from the seed.
"""

import faulthandler
import json
import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import lru_cache
from math import isfinite
from pathlib import Path
from time import monotonic, process_time
from typing import Any

import numpy as np

from nrs_cosim.bus.errors import Cause, CosimError, InputError, RunError
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.orchestrator.analysis.bounds import UltimateBounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.comparison import TheoryComparison, compare_to_theory
from nrs_cosim.orchestrator.analysis.conditions import Check
from nrs_cosim.orchestrator.analysis.conditions import check as check_experiment
from nrs_cosim.orchestrator.engine.growth import growth_before, growth_of
from nrs_cosim.orchestrator.engine.run import Outcome
from nrs_cosim.orchestrator.engine.run import run as run_experiment
from nrs_cosim.orchestrator.engine.summary import measure
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.orchestrator.scenario.assets import Assets
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import parse_scenario
from nrs_cosim.orchestrator.study.points import is_drawn
from nrs_cosim.orchestrator.study.rows import QUANTITIES, RESULTS, RowStatus, StudyRow
from nrs_cosim.plant_fmu.cache import keep_fmu, stored_fmu
from nrs_cosim.plant_fmu.folders import own_folder
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.schemas import about as about_run

ALLOW = "NRS_ALLOW_FMUS"
"""1 where FMUs that others send may be run: native code."""


def last_moment(limit: float) -> float:
    """Return when a run that does not end by itself is ended with its process, s."""
    return 2 * limit + 1.0


@dataclass(frozen=True, slots=True)
class PointTask:
    """What a process needs to run a point."""

    key: str
    point: str
    seed: int
    text: str
    name: str
    folder: str
    assets: Assets
    fmus: Mapping[str, str]
    """SHA-256 of those that are not bundled, by name."""
    sent: bool = False
    """Whether it came from elsewhere, so that FMUs are known by their content alone."""
    content: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    """FMUs by SHA-256."""
    limit: float | None = None
    """s of wall time that it may take."""
    keep: str = "none"
    """`none`, `failed` or `all`: whether the recording is kept."""
    recordings: str = ""
    """The folder where."""


@dataclass(frozen=True, slots=True)
class NeedsFmus:
    """A task that lacks FMUs, which its process would take."""

    sha256: tuple[str, ...]


def run_point(task: PointTask) -> dict[str, Any] | NeedsFmus:
    """Run a point, and return its row for JSON; or what of it is missing here."""
    begun, spent, started = monotonic(), process_time(), datetime.now(UTC)
    row: dict[str, Any] = {
        "key": task.key,
        "point": task.point,
        "scenario": task.name,
        "seed": task.seed,
    }
    try:
        experiment = parse_scenario(task.text, task.name, Path(task.folder), task.name, task.assets)
        row["ticks_planned"] = experiment.clock.ticks
        if task.sent and task.fmus:
            experiment = _with_sent(experiment, task)
        with _limited(task.limit):
            row |= _row_of(task, experiment, begun)
    except _FmusMissingError as error:
        return NeedsFmus(error.sha256)
    except CosimError as error:
        kind = _cause(error).kind if isinstance(error, RunError) else "input"
        row |= {"status": "failed", "cause_kind": kind, "reason": str(error)}
    except Exception as error:  # whatever a third-party algorithm raises is of its row
        reason = f"{type(error).__name__}: {error}"
        row |= {"status": "failed", "cause_kind": "other", "reason": reason}
    row |= {
        "cpu_seconds": process_time() - spent,
        "wall_seconds": monotonic() - begun,
        "host": socket.gethostname(),
        "pid": os.getpid(),
        "started": started.isoformat(timespec="seconds"),
    }
    return StudyRow.of(row).as_json()


def _row_of(task: PointTask, experiment: Experiment, begun: float) -> dict[str, Any]:
    checked, ultimate = theory_of(experiment)

    def watch(_time_ns: int) -> None:
        if task.limit is not None and monotonic() - begun > task.limit:
            raise Interrupted

    with own_folder() as folder, np.errstate(all="ignore"):
        path = folder / f"{task.key}.mcap"
        outcome = run_experiment(
            experiment,
            path,
            compression="none" if task.keep == "none" else "zstd",  # it is read once, and goes
            watch=watch,
        )
        with Reader(path) as reader:
            measured = measure(reader, experiment)
            compared = compare_to_theory(reader, experiment, measured, ultimate)
            status, rate = _status(outcome, reader, experiment, compared, checked)
            about, ending = about_run(reader), reader.ending
            found = _theory(checked, ultimate, compared) | {
                "status": status,
                "digest": reader.digest,
                "ticks": outcome.ticks,
                "messages": outcome.messages,
                "samples": ending.samples if ending else None,
                "measured_rate": rate,
                "reason": outcome.reason,
                "versions": json.dumps(dict(about.versions)),
                "fmus": json.dumps({plant["fmu"]: plant["sha256"] for plant in about.plants}),
            }
            found |= {name: _finite(getattr(measured, name)) for name in QUANTITIES}
            if ending and ending.cause:
                cause = ending.cause
                kind = "deadline" if status == "timeout" else cause.kind
                if status == "diverged" != kind:
                    kind, found["reason"] = status, f"{_divergence(checked)}: {outcome.reason}"
                found |= {
                    "cause_kind": kind,
                    "cause_tick": cause.tick,
                    "cause_time_ns": cause.time_ns,
                    "cause_robot": cause.robot,
                    "cause_quantity": cause.quantity,
                }
        if status == "timeout":
            found["reason"] = f"took longer than {task.limit:g} s"
        if task.keep == "all" or (task.keep == "failed" and status not in RESULTS):
            found["recording"] = _kept(path, task)
    return found


def _status(
    outcome: Outcome,
    reader: Reader,
    experiment: Experiment,
    compared: TheoryComparison,
    checked: Check,
) -> tuple[RowStatus, float | None]:
    """Return what a run came to, and by what its errors were multiplied at a sampling time.

    Where a plant gave up as errors grew, which nothing proves to fall, it is they that diverged.
    """
    if outcome.status == "interrupted":
        return "timeout", None
    cause = reader.ending.cause if reader.ending else None
    if outcome.status == "failed" and (cause is None or cause.kind != "diverged"):
        plant = cause is not None and cause.kind == "plant"
        grown = growth_before(reader, experiment) if plant else None
        if grown and checked.convergence != "converges":
            return "diverged", grown.rate
        return "failed", None
    rate = compared.measured_radius
    if rate is not None and outcome.status == "completed":
        return ("converged" if rate < 1 else "not_converged"), rate
    growth = growth_of(reader, experiment)
    rate = growth.rate if growth else None
    if outcome.status == "failed":
        return "diverged", rate
    return ("not_converged" if growth and growth.has_grown else "converged"), rate


def _divergence(checked: Check) -> str:
    """Say that the estimates diverge, by theory where it is known that they do."""
    if checked.convergence != "diverges":
        return "the estimates diverge"
    rho = (checked.links.radius or checked.rho).lower
    return f"the estimates diverge (spectral radius {rho:.4g} over the links)"


def _theory(checked: Check, ultimate: UltimateBounds, compared: TheoryComparison) -> dict[str, Any]:
    """Return what theory says of a point, and how its run was beside the bounds."""
    rows = {
        name: {
            **{law: _finite(value) for law, value in row.bounds.items()},
            "status": row.status,
        }
        for name, row in zip(QUANTITIES, compared.quantities, strict=False)
    }
    loss = checked.links.loss
    return {
        "convergence": checked.convergence,
        "spectral_radius": _finite(checked.links.radius.upper),
        "spectral_radius_lower": _finite(checked.links.radius.lower),
        "almost_sure": _finite(checked.links.almost_sure.upper),
        "almost_sure_lower": _finite(checked.links.almost_sure.lower),
        "margin": smallest_margin(checked.conditions),
        "critical_loss": loss.critical if loss else None,
        "violated": ", ".join(c.name for c in checked.conditions if not c.holds),
        "why_no_bounds": ultimate.why_not,
        "bounds": json.dumps(rows),
    }


def smallest_margin(conditions: Sequence[Condition]) -> float | None:
    """Return the margin of the condition that is nearest to its bound, as a part of that."""
    parts = [c.margin / abs(c.bound) if c.bound else c.margin for c in conditions]
    return min((part for part in parts if isfinite(part)), default=None)


def theory_of(experiment: Experiment) -> tuple[Check, UltimateBounds]:
    """Return conditions and bounds, computed once for points that differ by the seed."""
    drawn = is_drawn(experiment)
    run = experiment.scenario.run.model_copy(update={} if drawn else {"seed": 0})
    same = experiment.scenario.model_copy(update={"run": run})
    key = same.model_dump_json(exclude={"bus"} if drawn else {"bus", "initial"})
    return _remembered(_Same(key, experiment))


class _Same:
    """An experiment, equal to those of the same key."""

    def __init__(self, key: str, experiment: Experiment) -> None:
        self._key, self.experiment = (key, str(experiment.folder)), experiment

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@lru_cache(maxsize=32)
def _remembered(same: _Same) -> tuple[Check, UltimateBounds]:
    checked = check_experiment(same.experiment)
    return checked, ultimate_bounds(same.experiment, checked.links.radius)


class _FmusMissingError(Exception):
    def __init__(self, sha256: tuple[str, ...]) -> None:
        super().__init__(*sha256)
        self.sha256 = sha256


def _with_sent(experiment: Experiment, task: PointTask) -> Experiment:
    """Return an experiment whose FMUs are found by content; they run where that is allowed."""
    if os.environ.get(ALLOW) != "1":
        raise InputError(
            f"{min(task.fmus)}: this worker runs no FMU that is sent to it; start it with "
            f"{ALLOW}=1 to let it run native code of the study"
        )
    for sha256, content in task.content.items():
        keep_fmu(content, sha256)
    paths = {name: stored_fmu(sha256) for name, sha256 in task.fmus.items()}
    missing = tuple(sorted({task.fmus[name] for name, path in paths.items() if path is None}))
    if missing:
        raise _FmusMissingError(missing)
    return experiment.but(fmus={name: path for name, path in paths.items() if path})


@contextmanager
def _limited(limit: float | None) -> Iterator[None]:
    """End this process where a call into an FMU does not return in time; nothing else could."""
    if limit is None:
        yield
        return
    with open(os.devnull, "wb") as nowhere:  # noqa: PTH123, a descriptor is what is needed
        faulthandler.dump_traceback_later(last_moment(limit), exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


def _kept(path: Path, task: PointTask) -> str | None:
    """Move a recording to where the study keeps them; None where its folder is not here."""
    folder = Path(task.recordings)
    if not folder.is_dir():
        return None
    part = folder / f"{task.key}.{os.getpid()}.part"
    part.write_bytes(path.read_bytes())
    part.replace(folder / path.name)
    return f"{folder.name}/{path.name}"


def _cause(error: CosimError) -> Cause:
    cause = getattr(error, "cause", None)
    return cause if isinstance(cause, Cause) else Cause("other")


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and isfinite(value) else None
