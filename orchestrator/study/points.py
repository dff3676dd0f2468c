"""A point of a study is a scenario's text with other values at the keys of the axes, and its key.

The key of a point is the SHA-256 of its scenario, resolved, of its FMUs, and of the versions of
what computes a row. The axes are not in it, so a finer grid, more axes or more seeds find again the
rows that are there. Of bundled models, which each machine builds, the version of this package
stands.

Times must fit: where h is on an axis, and the duration is not, the run lasts the whole number of
sampling periods that is nearest to the scenario's duration; where the output step is not, it is the
longest part of h, in whole nanoseconds, that is no longer than the scenario's.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import lru_cache
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import Any

from nrs_cosim.bus.clock import nanoseconds
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import shortened
from nrs_cosim.estimator_agents.algorithm import class_of
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.changes import Change, tables_with, unchanged_assets
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import resolve_scenario, tables_of
from nrs_cosim.orchestrator.scenario.times import longest_part
from nrs_cosim.orchestrator.scenario.toml_text import toml_text
from nrs_cosim.orchestrator.study.axes import SEED
from nrs_cosim.orchestrator.study.rows import StudyRow, written_point
from nrs_cosim.plant_fmu.bundled.declaration import bundled_models

SCHEMA = 1
"""Of rows: another one computes another thing of the same run."""
SCENARIO_AXIS = "scenario"
"""The axis of studies of several scenarios: their names."""
PERIOD, DURATION, STEP = "run.sampling_period", "run.duration", "run.output_step"
FOLLOWED = (
    f"{DURATION}: the whole number of sampling periods that is nearest to the scenario's",
    f"{STEP}: the longest part of the sampling period that is no longer than the scenario's",
)
"""What follows h, as it is said to the user."""
_BY_VERSION = ("nrs-cosim", "numpy", "scipy")


@dataclass(frozen=True, slots=True)
class StudyPoint:
    """One run of a study."""

    key: str
    values: Mapping[str, Any]
    """By key of the axes, but for the seed."""
    experiment: Experiment
    fmus: Mapping[str, str]
    """SHA-256 of those that are not bundled, by what the scenario calls them."""


@dataclass(frozen=True, slots=True)
class _Read:
    """A point that was read, for those that differ by the seed alone."""

    cell: str | None
    """What of the values is not the seed; None where the point as a whole depends on it."""
    tables: Mapping[str, Any]
    experiment: Experiment
    fmus: Mapping[str, str]


class PointReader:
    """Reads points of scenarios: each scenario's text once, and what depends on no seed once."""

    def __init__(self, bases: Mapping[str, Experiment]) -> None:
        self._bases = bases
        self._tables = {name: tables_of(base.text) for name, base in bases.items()}
        self._last: _Read | None = None

    def at(self, values: Mapping[str, Any]) -> StudyPoint:
        """Return the point of values by key; `InputError` says at which values what is wrong."""
        others = _but_seed(values)
        cell, seed, last = written_point(others), values.get(SEED), self._last
        if last and cell == last.cell and type(seed) is int and seed >= 0:
            read = _with_seed(last, seed)
        else:
            read = self._read(cell, values)
        self._last = read
        return StudyPoint(row_key(read.experiment, read.fmus), others, read.experiment, read.fmus)

    def read(self, values: Mapping[str, Any]) -> StudyPoint | StudyRow:
        """Return the point of values by key, or the row of values that are no scenario."""
        try:
            return self.at(values)
        except InputError as error:
            base, point = self._bases[self._name(values)], written_point(_but_seed(values))
            seed = values.get(SEED, base.seed)
            decided = [SCHEMA, base.text, point, seed, _versions()]
            return StudyRow(
                key=_sha256_of(decided),
                point=point,
                scenario=base.name,
                seed=seed,
                status="failed",
                cause_kind="input",
                reason=str(error),
            )

    def _name(self, values: Mapping[str, Any]) -> str:
        return values.get(SCENARIO_AXIS) or next(iter(self._bases))

    def _read(self, cell: str, values: Mapping[str, Any]) -> _Read:
        name = self._name(values)
        base, tables = self._bases[name], self._tables[name]
        given = {key: value for key, value in values.items() if key != SCENARIO_AXIS}
        changes = {
            tuple(key.split(".")): value for key, value in (given | followed(tables, given)).items()
        }
        kept = unchanged_assets(base.assets, Change("point", "", None, changes))
        where = ", ".join(f"{key} = {shortened(str(value))}" for key, value in given.items())
        try:
            made = tables_with(tables, changes)
            experiment = resolve_scenario(
                toml_text(made), base.name, base.folder, where or base.name, kept, made
            )
        except ScenarioError:
            raise
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        shared = None if is_drawn(experiment) else cell
        return _Read(shared, made, experiment, third_party_fmus(experiment))


def _but_seed(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key != SEED}


def _with_seed(read: _Read, seed: int) -> _Read:
    """Return a point that was read, with another seed."""
    tables = {**read.tables, "run": {**read.tables["run"], "seed": seed}}
    scenario = read.experiment.scenario
    run = scenario.run.model_copy(update={"seed": seed})
    experiment = replace(
        read.experiment,
        scenario=scenario.model_copy(update={"run": run}),
        text=toml_text(tables),
    )
    return _Read(read.cell, tables, experiment, read.fmus)


def is_drawn(experiment: Experiment) -> bool:
    """Return whether an experiment's network or sampling times are drawn from the seed."""
    return (
        '"generator":{' in experiment.scenario.model_dump_json()
        or experiment.clock.jitter is not None
    )


def followed(tables: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of the times follows a sampling period that is given, by key."""
    run = tables.get("run")
    period = given.get(PERIOD)
    if not isinstance(run, Mapping) or not isinstance(period, int | float) or not period > 0:
        return {}
    try:
        nanoseconds(float(period))
    except ValueError:  # of which the scenario's own check tells
        return {}
    h, found = Decimal(repr(period)), dict[str, Any]()
    duration, step = given.get(DURATION, run.get("duration")), run.get("output_step")
    if DURATION not in given and isinstance(duration, int | float):
        found[DURATION] = float(h * max(round(Decimal(repr(duration)) / h), 1))
    if STEP not in given and isinstance(step, int | float) and step > 0:
        found[STEP] = longest_part(float(period), float(step))
    return found


def third_party_fmus(experiment: Experiment) -> dict[str, str]:
    """Return the SHA-256 of an experiment's FMUs that are not bundled; of those that are there."""
    names = {plant.fmu for plant in experiment.plants} - {*bundled_models()}
    found = {}
    for name in sorted(names):
        path = experiment.folder / name
        try:
            status = path.stat()
        except (OSError, ValueError):
            raise InputError(f"plant.fmu: {name}: no such FMU in {experiment.folder}") from None
        found[name] = _sha256(path, status.st_mtime_ns, status.st_size)
    return found


@lru_cache(maxsize=64)
def _sha256(path: Path, _changed: int, _size: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def row_key(experiment: Experiment, fmus: Mapping[str, str]) -> str:
    """Return the key of an experiment's row."""
    decided = [
        SCHEMA,
        experiment.scenario.model_dump_json(exclude={"bus"}),
        dict(fmus),
        _versions(),
        _plugin(class_of(experiment.algorithm).__module__.partition(".")[0]),
    ]
    return _sha256_of(decided)


def _sha256_of(decided: Sequence[Any]) -> str:
    return hashlib.sha256(json.dumps(decided, sort_keys=True).encode()).hexdigest()


@lru_cache(maxsize=1)
def _versions() -> dict[str, str]:
    return {name: version(name) for name in _BY_VERSION}


@lru_cache(maxsize=16)
def _plugin(package: str) -> Sequence[str]:
    """Return the distributions, with versions, that an algorithm's package is of."""
    found = () if package == "nrs_cosim" else packages_distributions().get(package, ())
    return [f"{name} {version(name)}" for name in sorted({*found})]
