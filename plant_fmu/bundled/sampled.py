"""FMUs of what a network samples: a robot of ours with its agent, an agent alone, and a target.

Each is for Co-Simulation alone, of FMI 2 unless it is asked for otherwise. An agent's in-degree,
the number of joints and the fields that it keeps are compiled; its algorithm, by K and G, and all
else are parameters.
"""

import tomllib
from collections.abc import Mapping, Sequence
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


@dataclass(frozen=True, slots=True)
class AgentFields:
    """What an agent keeps, position and velocity first, and what of it it sends, by name.

    Of these one may be a constant acceleration, by which position and velocity flow.
    """

    kept: tuple[str, ...] = SAMPLE
    sent: tuple[str, ...] = SAMPLE
    acceleration: str | None = None

    def header(self) -> bytes:
        """law.h: where the fields are among an agent's variables, in the order of K's rows."""
        defined = {
            "KEPT_FIELDS(v)": [f"(v)->{kept_name(name)}" for name in self.kept],
            "INITIAL_FIELDS(v)": [f"(v)->{initial_name(name)}" for name in self.kept],
            "RECEIVED_FIELDS(v)": [f"(v)->{received_name(name)}" for name in self.sent],
            "WEIGHTS(v, at)": [f"(v)->{weights_name(name)}[at]" for name in self.sent],
            "SENT_FIELDS": [str(self.kept.index(name)) for name in self.sent],
        }
        if self.acceleration:
            defined["ACCELERATION"] = [kept_name(self.acceleration)]
        lines = (f"#define {name} {', '.join(items)}\n" for name, items in defined.items())
        return "".join(("/* Generated: the fields of an agent. */\n\n", *lines)).encode()

    def variables(self) -> dict[str, Any]:
        """Tables of those that are not position and velocity, as in agent.toml."""
        found: dict[str, Any] = {}
        for name in self.kept:
            if name not in SAMPLE:
                about = f"{name} that the agent keeps"
                found[initial_name(name)] = _table("parameter", ["m"], f"{about}, at the start")
                now = f"{about}; at a sampling time the sample, before the jump"
                found[kept_name(name)] = {**_table("output", ["m"], now), "stepped": True}
        for name in self.sent:
            if name not in SAMPLE:
                about = f"{name} in the samples of the in-neighbours"
                found[received_name(name)] = _table("input", ["received", "m"], about)
        if self.acceleration:
            about = "velocity of the estimate right after the last sampling time"
            found["left_velocity"] = {**_table("local", ["m"], about), "stepped": True}
        return found


def kept_name(field: str) -> str:
    """Return by what name an agent's FMU shows a field."""
    return field if field in SAMPLE else f"kept_{field}"


def initial_name(field: str) -> str:
    """Return what an agent's FMU calls the start of a field."""
    return f"{field}_start" if field in SAMPLE else f"initial_{field}"


def received_name(field: str) -> str:
    """Return what an agent's FMU calls a field of the in-neighbours' samples."""
    return f"received_{field}"


def weights_name(field: str) -> str:
    """Return what an agent's FMU calls the weights of a field's digraph."""
    return "velocity_weight" if field == "velocity" else "position_weight"


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


def build_robot(
    robot: Equations,
    in_neighbours: int,
    digraphs: int,
    sizes: Mapping[str, int],
    fields: AgentFields,
) -> Built:
    """The FMU of a robot whose agent has so many in-neighbours, by digraphs; `FmuError` as `build`.

    `sizes` are the values of the model's structural parameters, which FMI 2 has not.
    """
    own = robot.tables
    for name, size in sizes.items():
        own["variables"][name]["start"] = size
    agent = _agent_tables(in_neighbours, digraphs, fields)
    starts = _tables(AGENT / "robot.toml")
    dimensions = {**own["dimensions"], **agent["dimensions"]}
    variables = {**own["variables"], **agent["variables"], **starts["variables"]}
    about = f"{own['description']}; with an estimator agent that receives from {in_neighbours}"
    extended = {**own, "description": about, "dimensions": dimensions, "variables": variables}
    name = f"{robot.name}_with_agent"
    declared = declare_tables(name, [_tables(MODELS / "robot.toml"), extended], 2)
    states = (replace(v, start=None) if v.kind == "state" else v for v in declared.variables)
    declared = replace(declared, variables=tuple(states))
    files = _agent_files(fields, "robot_plant.c")
    return _build(declared, {**files, **robot.files}, 2)


def build_agent(
    m: int,
    in_neighbours: int,
    digraphs: int,
    fmi: int,
    values: Mapping[str, Any],
    fields: AgentFields,
) -> Built:
    """The FMU of an agent alone, whose parameters start at values; `FmuError` as `build`."""
    agent = _agent_tables(in_neighbours, digraphs, fields)
    dimensions = {**agent["dimensions"], "m": m}
    about = f"Estimator agent of {m} axes that receives from {in_neighbours}"
    own = {**agent, "description": about, "dimensions": dimensions, "units": {}}
    files = _agent_files(fields, "no_plant.c", "still.c")
    declared = declare_tables("agent", [_shared(), own], fmi)
    given = {name: tuple(np.ravel(value).tolist()) for name, value in values.items()}
    started = (replace(v, start=given.get(v.name, v.start)) for v in declared.variables)
    return _build(replace(declared, variables=tuple(started)), files, fmi, INTEGRATING)


def build_target(m: int, terms: int, unit: str, truths: Sequence[str] = SAMPLE) -> Built:
    """The FMU of a target of m axes, with so many sines on each; `FmuError` as `build`.

    It has position and velocity, and its acceleration where that is among the truths.
    """
    target = _target_tables(truths)
    dimensions = {"m": m, "terms": max(terms, 1)}
    about = f"Target of {m} axes that moves by sums of sines"
    own = {**target, "description": about, "dimensions": dimensions, "units": UNITS[unit]}
    files = {**_target_files(truths, "target.c"), **_files(AGENT, "summation.h")}
    return _build(declare_tables("target", [_shared(), own], 2), files, 2, INTEGRATING)


def build_sampled_target(
    samples: Array, period: float, unit: str, truths: Sequence[str] = SAMPLE
) -> Built:
    """The FMU of a target whose samples (K + 1, p m) of p truths are in it, a period apart.

    `FmuError` as `build`.
    """
    rows = ",\n".join(f"    {{{', '.join(map(float.hex, row))}}}" for row in samples.tolist())
    table = (
        f"static const double SAMPLING_PERIOD = {period.hex()};\n"
        f"enum {{ SAMPLES = {len(samples)} }};\n"
        f"static const double samples[SAMPLES][{len(truths)} * M] = {{\n{rows}}};\n"
    )
    m = samples.shape[1] // len(truths)
    variables = {name: _target_tables(truths)["variables"][name] for name in truths}
    about = f"Target of {m} axes, of which {len(samples)} samples are known"
    own = {
        "description": about,
        "dimensions": {"m": m},
        "units": UNITS[unit],
        "variables": variables,
    }
    files = _target_files(truths, "samples.c")
    files["samples.h"] = table.encode()
    return _build(declare_tables("target", [_shared(), own], 2), files, 2, INTEGRATING)


def _build(
    declared: Declaration, files: Mapping[str, bytes], fmi: int, without: tuple[str, ...] = ()
) -> Built:
    only = replace(declared, interfaces=("CoSimulation",))
    return Built(build_model(only, files, fmi, without=without), only)


def _agent_tables(in_neighbours: int, digraphs: int, fields: AgentFields) -> dict[str, Any]:
    agent = _tables(AGENT / "agent.toml")
    dimensions = {"kept": len(fields.kept), "sent": len(fields.sent)}
    dimensions |= {"received": in_neighbours, "digraphs": digraphs}
    own = {"dimensions": dimensions, "variables": {**agent["variables"], **fields.variables()}}
    return {**agent, **own}


def _agent_files(fields: AgentFields, *others: str) -> dict[str, bytes]:
    files = _files(AGENT, "agent.c", "plant.h", "summation.h", *others)
    return {**files, "law.h": fields.header()}


def _target_tables(truths: Sequence[str]) -> dict[str, Any]:
    target = _tables(TARGET / "target.toml")
    if "acceleration" not in truths:
        del target["variables"]["acceleration"]
    return target


def _target_files(truths: Sequence[str], name: str) -> dict[str, bytes]:
    accelerated = "#define ACCELERATED\n" if "acceleration" in truths else ""
    text = f"/* Generated: what the target shows. */\n\n{accelerated}"
    return {**_files(TARGET, name), **_files(AGENT, "still.c"), "truths.h": text.encode()}


def _table(kind: str, shape: Sequence[str], about: str) -> dict[str, Any]:
    return {"kind": kind, "shape": list(shape), "description": about}


def _shared() -> dict[str, Any]:
    """What the core asks of any model."""
    robot = _tables(MODELS / "robot.toml")
    names = ("time", "relative_tolerance")
    return {"dimensions": {}, "variables": {name: robot["variables"][name] for name in names}}


def _tables(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def _files(folder: Path, *names: str) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in names}
