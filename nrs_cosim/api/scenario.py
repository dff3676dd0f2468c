"""A scenario is what the user wrote: TOML, read from a file or made in code; it never changes.

A change gives another scenario. What a scenario names, such as a list of edges, is looked for
relative to its folder, when it is made.
"""

from collections.abc import Collection, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.plurals import count_of
from nrs_cosim.bus.text import quoted, storable
from nrs_cosim.orchestrator.scenario.assets import Assets
from nrs_cosim.orchestrator.scenario.changes import Change, unchanged_assets, with_changes
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import (
    parse_scenario,
    read_text,
    resolve_scenario,
    tables_of,
)
from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema

_LOAD = "nrs.Scenario.load reads a file"


class Scenario:
    """What is to be run: times, algorithm, network, target, plants, and how all begins.

    Args:
        tables: The tables of a scenario file, by name; or None, and the tables as keywords.
        name: What its runs are called.
        folder: What paths in it are relative to.
        **more: Further tables, such as `run={"duration": 30.0, "sampling_period": 0.1}`.

    Raises:
        InputError: A key is unknown or missing, or a value is wrong; all of them are named.

    Example:
        >>> import nrs_cosim as nrs
        >>> scenario = nrs.Scenario(
        ...     run={"duration": 10.0, "sampling_period": 0.1},
        ...     algorithm={"name": "dcea1", "alpha": 0.9, "beta": 0.9},
        ...     controller={"kp": 200.0, "kd": 300.0},
        ...     network={"edge_list": [[0, 1], [1, 2]]},
        ...     target={"axes": [{"rate": 1.0}, {"sines": [{"amplitude": 1.0, "frequency": 1.0}]}]},
        ...     plant={"fmu": "two_link_arm"},
        ...     initial={
        ...         "position": {"uniform": [-1.0, 1.0]}, "velocity": {"uniform": [0.0, 0.0]},
        ...         "q": {"uniform": [-1.0, 1.0]}, "qd": {"uniform": [0.0, 0.0]},
        ...     },
        ... )
        >>> scenario
        Scenario('scenario': 2 robots, dcea1, 100 ticks)
        >>> scenario.replace({"algorithm.alpha": 0.5})["algorithm.alpha"]
        0.5
    """

    __slots__ = ("_experiment", "_is_recorded")

    def __init__(
        self,
        tables: Mapping[str, Any] | None = None,
        /,
        *,
        name: str = "scenario",
        folder: str | PathLike[str] = ".",
        **more: Any,
    ) -> None:
        if not isinstance(tables, Mapping | None):
            raise InputError(f"scenario: expected tables by name, got {quoted(tables)}; {_LOAD}")
        text = tomlkit.dumps(plain({**(tables or {}), **more}))
        self._experiment = resolve_scenario(text, name, Path(folder).absolute(), name)
        self._is_recorded = False

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Scenario":
        """Return the scenario of a TOML file.

        Raises:
            InputError: The file cannot be read, or something in it is wrong; all is named.
        """
        path = Path(path)
        text = read_text(path)
        return cls._of(
            resolve_scenario(text, storable(path.stem), path.absolute().parent, str(path))
        )

    @classmethod
    def parse(
        cls, text: str, *, name: str = "scenario", folder: str | PathLike[str] = "."
    ) -> "Scenario":
        """Return the scenario of a text in TOML; paths in it are relative to the folder.

        Raises:
            InputError: Something in it is wrong; all is named.
        """
        return cls._of(resolve_scenario(text, name, Path(folder).absolute(), name))

    @classmethod
    def _of(cls, experiment: Experiment, *, is_recorded: bool = False) -> "Scenario":
        scenario = object.__new__(cls)
        scenario._experiment, scenario._is_recorded = experiment, is_recorded
        return scenario

    def replace(
        self,
        changes: Mapping[str, Any],
        *,
        robots: Collection[int] | None = None,
        name: str | None = None,
    ) -> "Scenario":
        """Return this scenario with other values, as `nrs run --set` has them.

        What a value excludes goes: another FMU is another plant, of whose table nothing is kept,
        and so it is with another kind of target and another form of network.

        Args:
            changes: Values by key, such as `{"algorithm.alpha": 0.8}`; arrays of NumPy are taken
                as lists. A value of None takes the key out.
            robots: Whose plants, controllers, disturbances or initial states are changed; all
                unless given.
            name: What its runs are called; by default as before.

        Raises:
            InputError: A key is unknown, or a value is wrong; all of them are named.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> stiff = scenario.replace({"controller.kp": 250.0}, robots=[2, 3])
            >>> stiff["robots"]
            [{'id': 2, 'controller': {'kp': 250.0}}, {'id': 3, 'controller': {'kp': 250.0}}]
        """
        change, own, one = change_of(changes, robots), name or self.name, self._experiment
        text = with_changes(self.to_toml(), [change])
        kept = unchanged_assets(one.assets, change, keep_motion=self._is_recorded)
        experiment = resolve_scenario(text, own, one.folder, own, kept)
        return self._of(experiment, is_recorded=self._is_recorded)

    def to_toml(self) -> str:
        """Return the scenario's text, to the byte; `parse` takes it back, with its files there."""
        return self._experiment.text

    @staticmethod
    def schema() -> dict[str, Any]:
        """Return the JSON schema of scenarios."""
        return json_schema()

    @property
    def name(self) -> str:
        """What its runs are called."""
        return self._experiment.name

    @property
    def robots(self) -> int:
        """n; they are numbered from 1, and the target is 0."""
        return self._experiment.n

    @property
    def joints(self) -> int:
        """m, the axes of the target and of each robot."""
        return self._experiment.m

    def __getitem__(self, key: str) -> Any:
        """Return what the text has at a key such as `algorithm.alpha`; `KeyError` if nothing."""
        value: Any = tables_of(self._experiment.text)
        for part in key.split("."):
            value = value[part]
        return value

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to other processes as text and assets; the algorithm must be installed there."""
        one = self._experiment
        return _unpickled, (one.text, one.name, one.folder, one.assets, one.fmus, self._is_recorded)

    def __eq__(self, other: object) -> bool:
        """Say whether two scenarios have the same tables, and look for files in one place."""
        if not isinstance(other, Scenario):
            return NotImplemented
        mine, theirs = self._experiment, other._experiment
        return (mine.scenario, mine.files_at) == (theirs.scenario, theirs.files_at)

    def __hash__(self) -> int:
        """Agree with `==`."""
        return hash((self.robots, self.joints, self._experiment.files_at))

    def __repr__(self) -> str:
        """Return what the scenario is, on a line."""
        n, ticks = self.robots, self._experiment.clock.ticks
        algorithm = self._experiment.scenario.algorithm.name
        return f"Scenario({self.name!r}: {count_of(n, 'robot')}, {algorithm}, {ticks} ticks)"


def _unpickled(
    text: str,
    name: str,
    folder: Path,
    assets: Assets,
    fmus: Mapping[str, Path],
    is_recorded: bool,
) -> Scenario:
    """Return a scenario as it was in another process; no file that it names is read again."""
    experiment = parse_scenario(
        text, name, folder, name, assets, recorded={} if is_recorded else None
    )
    return Scenario._of(experiment.but(fmus=fmus), is_recorded=is_recorded)


def experiment_of(scenario: Scenario) -> Experiment:
    """Return what a scenario is resolved into; `InputError` for what is none, such as a path."""
    if not isinstance(scenario, Scenario):
        raise InputError(f"scenario: expected a Scenario, got {quoted(scenario)}; {_LOAD}")
    return scenario._experiment


def plain(value: Any) -> Any:
    """Return a value as TOML knows it: arrays are lists, and what is None is not there."""
    match value:
        case Mapping():
            return {str(key): plain(item) for key, item in value.items() if item is not None}
        case np.ndarray() | np.generic():
            return value.tolist()
        case list() | tuple() | range():
            return [plain(item) for item in value]
        case PathLike():
            return str(value)
    return value


def change_of(changes: Mapping[str, Any], robots: Collection[int] | None = None) -> Change:
    """Return values by key, such as `algorithm.alpha`, as a change of all robots or of some."""
    values = {tuple(key.split(".")): plain(value) for key, value in changes.items()}
    text = ",".join(f"{'.'.join(key)}={value!r}" for key, value in values.items())
    return Change("changes", text, None if robots is None else tuple(sorted({*robots})), values)
