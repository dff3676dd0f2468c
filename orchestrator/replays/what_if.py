"""What if a plant, a controller or a gain had been another? A recording's run, changed a little.

A change is a list of `key=value`, the keys those of a scenario, the values TOML. `robots=1-3,7`
confines a change of plants to some robots. Estimates do not depend on plants: when plants alone are
changed, the traffic stays as recorded, and only the robots that were changed are run again, the
others are as they were. When the algorithm is changed, the agents start again from the recorded
estimates, hear the recorded target, and all else follows.
"""

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from bus.errors import InputError
from bus.transport import Bus
from orchestrator.replays.verifying import RecordedPlants, states_of
from orchestrator.runs.alone import on_a_session
from orchestrator.runs.host import Watch
from orchestrator.runs.lockstep import Hosts, Manning
from orchestrator.runs.robots import Robots
from orchestrator.runs.summary import PARENT
from orchestrator.scenario.clock import Clock
from orchestrator.scenario.file import ScenarioFile, parse_scenario
from orchestrator.scenario.numbers import parse_robots
from plant_fmu.fleet import Fleet
from recordings.reading import Reader
from recordings.tables import RUN

_NEXT = re.compile(r",(?=[A-Za-z_][\w.]*=)")
_ROBOTS_OWN = ("plant", "controller", "disturbance", "initial")


@dataclass(frozen=True, slots=True)
class Change:
    """Some keys of a scenario that get other values."""

    option: str
    """Where it was given."""
    text: str
    robots: tuple[int, ...] | None
    """Whose they are; None for all."""
    values: Mapping[str, Any]

    @classmethod
    def of(cls, option: str, text: str) -> "Change":
        """Read `key=value,key=value`; `InputError` names the option and the part that is wrong."""
        robots, values = None, {}
        for part in _NEXT.split(text):
            key, equals, value = part.partition("=")
            if not equals or not key.strip():
                raise InputError(f"{option}: expected key=value, got {part!r} in {text!r}")
            if key == "robots":
                robots = parse_robots(value, f"{option} robots")
            else:
                values[key.strip()] = _value(value.strip())
        if not values:
            raise InputError(f"{option}: changes nothing: {text!r}")
        return cls(option, text, robots, values)


def changed(
    file: ScenarioFile, plant: Sequence[Change], algorithm: Sequence[Change]
) -> ScenarioFile:
    """Return a scenario with changes; `InputError` and `ScenarioError` name what is wrong."""
    document = tomlkit.parse(file.text)
    for change in plant:
        for key, value in change.values.items():
            top = key.partition(".")[0]
            if top not in _ROBOTS_OWN[:3]:
                raise InputError(
                    f"{change.option}: {key}: expected a key of plant, controller or disturbance"
                )
            if change.robots is None:
                _set(document, key, value)
            for robot in change.robots or ():
                _set(_own(document, robot, top), key, value)
    for change in algorithm:
        for key, value in change.values.items():
            _set(document, f"algorithm.{key}", value)
    return parse_scenario(tomlkit.dumps(document), file.name, file.folder, "the changed scenario")


def run_again(reader: Reader, file: ScenarioFile, robots: Sequence[int]) -> Manning:
    """Return how a run gets the plants of some robots, and those of all others as recorded."""
    scenario = file.scenario
    every = range(1, scenario.n + 1)
    others = [robot for robot in every if robot not in set(robots)]

    def man(stack: ExitStack, clock: Clock, watch: Watch) -> tuple[Bus, Hosts]:
        real = Robots.opened(stack, file, robots)
        parts: list[Any] = [(np.array(robots) - 1, real.plants)]
        if others:
            rest = RecordedPlants(others, scenario.m, states_of(reader, scenario.m))
            parts.append((np.array(others) - 1, rest))
        told = [*real.told, *_told_of(reader, others)]
        fleet = Fleet(parts, scenario.m)
        return on_a_session(stack, clock, Robots.driven_by(scenario, every, fleet, told), watch)

    return man


def parent(reader: Reader, changes: Sequence[Change]) -> dict[str, dict[str, str]]:
    """Return the metadata that names the recording from which another came."""
    text = "; ".join(f"{change.option} {change.text}" for change in changes)
    return {PARENT: {"digest": reader.digest, "change": text}}


def _told_of(reader: Reader, robots: Sequence[int]) -> list[dict[str, Any]]:
    """Return what a recording tells of some robots' plants, by group."""
    told = []
    for group in json.loads(reader.metadata[RUN]["plants"]):
        mine = [robot for robot in group["robots"] if robot in set(robots)]
        if mine:
            told.append({**group, "robots": mine})
    return told


def _value(text: str) -> Any:
    """Return a TOML value, or the text itself; a file of here is one wherever the scenario lies."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        path = Path(text)
        return str(path.absolute()) if path.suffix == ".fmu" and path.exists() else text


def _own(document: tomlkit.TOMLDocument, robot: int, top: str) -> Any:
    """Return the table of what a robot has of its own, with a copy of what all have in it."""
    entries = document.setdefault("robots", tomlkit.aot())
    own = next((entry for entry in entries if entry["id"] == robot), None)
    if own is None:
        own = tomlkit.table()
        own["id"] = robot
        entries.append(own)
        own = entries[-1]
    if top not in own:
        own[top] = tomlkit.item(document.get(top, {})).unwrap()
    return own


def _set(table: Any, key: str, value: Any) -> None:
    *tables, name = key.split(".")
    for part in tables:
        table = table.setdefault(part, tomlkit.table())
    table[name] = value
