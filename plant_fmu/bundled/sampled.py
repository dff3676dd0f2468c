"""FMUs of what a network samples: a robot of ours with its agent, an agent alone, and a target.

Each is for Co-Simulation alone, of FMI 2 unless it is asked for otherwise. An agent's in-degree and
the number of joints are compiled; its algorithm, by K and G, and all else are parameters.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.plant_fmu.bundled.builder import build_model, fmi_headers
from nrs_cosim.plant_fmu.bundled.declaration import MODELS, Declaration, declare_tables, own_tables
from nrs_cosim.plant_fmu.errors import FmuError

AGENT, TARGET = MODELS / "agent", MODELS / "target"
SAMPLE = ("position", "velocity")
UNITS = {
    "rad": {"coordinate": "rad", "effort": "N.m"},
    "m": {"coordinate": "m", "effort": "N"},
    "": {},
}
"""What a model's units are made of, by that of its axes."""
INTEGRATING = (
    *("robot.c", "robot.h", "controller.c", "controller.h", "cholesky.h"),
    *("integrator.c", "dormand_prince.c", "dop853.c", "implicit_euler.c"),
)
"""What an FMU without a plant has no use for."""


Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Built:
    """An FMU, with what is in it."""

    path: Path
    declaration: Declaration


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """What one robot has that others have not: its tables, as in model.toml, and its C files."""

    name: str
    tables: dict[str, Any]
    files: Mapping[str, bytes]


def bundled_equations(name: str) -> Equations:
    """Those of a bundled model."""
    return Equations(name, own_tables(name), _files(MODELS / name, "model.c"))


def built_equations(name: str, path: Path, m: int, unit: str) -> Equations:
    """Those of an FMU that was built here from a URDF, of m joints in rad or m, or in both.

    `FmuError` where an earlier version built it.
    """
    with ZipFile(path) as archive:
        sources = {
            file.removeprefix("sources/"): archive.read(file)
            for file in archive.namelist()
            if file.startswith("sources/")
        }
    shared = {file.name: file.read_bytes() for file in MODELS.glob("*.[ch]")}
    if any(shared.get(file, text) != text for file, text in sources.items()):
        raise FmuError(f"{name}: was built by another version; build it again from its URDF")
    known = {*shared, *fmi_headers(2), *fmi_headers(3), "variables.c", "variables.h"}
    files = {file: text for file, text in sources.items() if file not in known}
    files = {file: text for file, text in files.items() if file.endswith((".c", ".h"))}
    about = {"description": name, "dimensions": {"m": m}, "units": UNITS[unit], "variables": {}}
    return Equations(name, about, files)


def build_robot(robot: Equations, received: int, digraphs: int, sizes: Mapping[str, int]) -> Built:
    """The FMU of a robot whose agent has so many in-neighbours, by digraphs; `FmuError` as `build`.

    `sizes` are the values of the model's structural parameters, which FMI 2 has not.
    """
    own = robot.tables
    for name, size in sizes.items():
        own["variables"][name]["start"] = size
    agent, starts = _tables(AGENT / "agent.toml"), _tables(AGENT / "robot.toml")
    dimensions = {**own["dimensions"], **agent["dimensions"]}
    dimensions |= {"received": received, "digraphs": digraphs}
    variables = {**own["variables"], **agent["variables"], **starts["variables"]}
    about = f"{own['description']}; with an estimator agent that receives from {received}"
    extended = {**own, "description": about, "dimensions": dimensions, "variables": variables}
    name = f"{robot.name}_with_agent"
    declared = declare_tables(name, [_tables(MODELS / "robot.toml"), extended], 2)
    states = (replace(v, start=None) if v.kind == "state" else v for v in declared.variables)
    declared = replace(declared, variables=tuple(states))
    files = _files(AGENT, "agent.c", "plant.h", "robot_plant.c", "summation.h")
    return _build(declared, {**files, **robot.files}, 2)


def build_agent(m: int, received: int, digraphs: int, fmi: int, values: Mapping[str, Any]) -> Built:
    """The FMU of an agent alone, whose parameters start at values; `FmuError` as `build`."""
    agent = _tables(AGENT / "agent.toml")
    dimensions = {**agent["dimensions"], "m": m, "received": received, "digraphs": digraphs}
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


def build_sampled_target(samples: Array, period: float, unit: str) -> Built:
    """The FMU of a target whose samples (K + 1, 2 m), positions first, are in it, a period apart.

    `FmuError` as `build`.
    """
    rows = ",\n".join(f"    {{{', '.join(map(float.hex, row))}}}" for row in samples.tolist())
    table = (
        f"static const double SAMPLING_PERIOD = {period.hex()};\n"
        f"enum {{ SAMPLES = {len(samples)} }};\n"
        f"static const double samples[SAMPLES][2 * M] = {{\n{rows}}};\n"
    )
    m = samples.shape[1] // 2
    variables = {name: _tables(TARGET / "target.toml")["variables"][name] for name in SAMPLE}
    about = f"Target of {m} axes, of which {len(samples)} samples are known"
    own = {
        "description": about,
        "dimensions": {"m": m},
        "units": UNITS[unit],
        "variables": variables,
    }
    files = {**_files(TARGET, "samples.c"), **_files(AGENT, "still.c")}
    files["samples.h"] = table.encode()
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
