"""FMUs of what a network samples: a bundled robot with its agent, an agent alone, and a target.

Each is for Co-Simulation alone, of FMI 2 unless it is asked for otherwise. An agent's in-degree and
the number of joints are compiled; its algorithm, by K and G, and all else are parameters.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from nrs_cosim.plant_fmu.bundled.builder import build_model
from nrs_cosim.plant_fmu.bundled.declaration import MODELS, Declaration, declare_tables, own_tables

AGENT, TARGET = MODELS / "agent", MODELS / "target"
UNITS = {"rad": {"coordinate": "rad"}, "m": {"coordinate": "m"}, "": {}}
"""What a model's units are made of, by that of its axes."""
INTEGRATING = (
    *("robot.c", "robot.h", "controller.c", "controller.h", "cholesky.h"),
    *("integrator.c", "dormand_prince.c", "dop853.c", "implicit_euler.c"),
)
"""What an FMU without a plant has no use for."""


@dataclass(frozen=True, slots=True, eq=False)
class Built:
    """An FMU, with what is in it."""

    path: Path
    declaration: Declaration


def build_robot(model: str, received: int, sizes: Mapping[str, int]) -> Built:
    """The FMU of a bundled robot whose agent has so many in-neighbours; `FmuError` as `build`.

    `sizes` are the values of the model's structural parameters, which FMI 2 has not.
    """
    own = own_tables(model)
    for name, size in sizes.items():
        own["variables"][name]["start"] = size
    agent, robot = _tables(AGENT / "agent.toml"), _tables(AGENT / "robot.toml")
    dimensions = {**own["dimensions"], **agent["dimensions"], "received": received}
    variables = {**own["variables"], **agent["variables"], **robot["variables"]}
    about = f"{own['description']}; with an estimator agent that receives from {received}"
    extended = {**own, "description": about, "dimensions": dimensions, "variables": variables}
    name = f"{model}_with_agent"
    declared = declare_tables(name, [_tables(MODELS / "robot.toml"), extended], 2)
    states = (replace(v, start=None) if v.kind == "state" else v for v in declared.variables)
    declared = replace(declared, variables=tuple(states))
    files = _files(AGENT, "agent.c", "plant.h", "robot_plant.c", "summation.h")
    return _build(declared, {**files, **_files(MODELS / model, "model.c")}, 2)


def build_agent(m: int, received: int, fmi: int, values: Mapping[str, Any]) -> Built:
    """The FMU of an agent alone, whose parameters start at values; `FmuError` as `build`."""
    agent = _tables(AGENT / "agent.toml")
    dimensions = {**agent["dimensions"], "m": m, "received": received}
    about = f"Estimator agent of {m} axes that receives from {received}"
    own = {**agent, "description": about, "dimensions": dimensions, "units": {}}
    files = _files(AGENT, "agent.c", "plant.h", "no_plant.c", "still.c", "summation.h")
    declared = declare_tables("agent", [_shared(), own], fmi)
    given = {name: tuple(np.ravel(value).tolist()) for name, value in values.items()}
    started = (replace(v, start=given.get(v.name, v.start)) for v in declared.variables)
    return _build(replace(declared, variables=tuple(started)), files, fmi, INTEGRATING)


def build_target(m: int, terms: int, unit: str) -> Built:
    """The FMU of a target of m axes, with so many sines on each; `FmuError` as `build`."""
    target = _tables(TARGET / "target.toml")
    dimensions = {"m": m, "terms": max(terms, 1)}
    about = f"Target of {m} axes that moves by sums of sines"
    own = {**target, "description": about, "dimensions": dimensions, "units": UNITS[unit]}
    files = {**_files(TARGET, "target.c"), **_files(AGENT, "still.c", "summation.h")}
    return _build(declare_tables("target", [_shared(), own], 2), files, 2, INTEGRATING)


def _build(
    declared: Declaration, files: Mapping[str, bytes], fmi: int, without: tuple[str, ...] = ()
) -> Built:
    only = replace(declared, interfaces=("CoSimulation",))
    return Built(build_model(only, files, fmi, without=without), only)


def _shared() -> dict[str, Any]:
    """What the core asks of any model."""
    robot = _tables(MODELS / "robot.toml")
    names = ("time", "relative_tolerance")
    return {"dimensions": {}, "variables": {name: robot["variables"][name] for name in names}}


def _tables(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def _files(folder: Path, *names: str) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in names}
