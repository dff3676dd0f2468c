"""A run: a scenario in, a closed recording out, whatever happens in between."""

import json
import platform
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from uuid import uuid4

import numpy as np

from bus.errors import RunError
from bus.zenoh_bus import ZenohBus
from estimator_agents.agents import Agents
from estimator_agents.algorithm import load_algorithm
from orchestrator.clock import Clock, seconds
from orchestrator.errors import Interrupted
from orchestrator.host import Host, Watch
from orchestrator.lockstep import TargetNode, run_ticks
from orchestrator.plants import Group, group_by_archive, open_fleet
from orchestrator.scenario_file import ScenarioFile
from orchestrator.setting import (
    bodies,
    clock_of,
    initial_estimates,
    links_of,
    missing_of,
    target_of,
    topology_of,
)
from plant_fmu.fleet import Fleet
from recordings.container import Closing, Compression
from recordings.recorder import Recorder, channels, schemas
from recordings.tables import RUN
from recordings.writing import Writer

SCENARIO = "scenario.toml"
"""The attachment that holds the scenario's text."""

_PARTS = ("nrs-cosim", "eclipse-zenoh", "fmpy", "mcap", "numpy", "scipy")


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended, and where its recording is."""

    status: Closing
    reason: str
    path: Path
    ticks: int
    messages: int
    wall_seconds: float
    """From the states at t_0 to the last tick; set-up and closing are apart."""


def run(
    file: ScenarioFile,
    output: Path,
    *,
    compression: Compression = "zstd",
    watch: Watch = lambda _time_ns: None,
) -> Outcome:
    """Run a scenario into a recording.

    `watch` is told each output time, ns, that was reached, and ends the run by `Interrupted`. A
    failure before the states at t_0 is raised and leaves no file; a later one is the outcome's.
    """
    scenario = file.scenario
    clock, topology, target = clock_of(scenario), topology_of(scenario), target_of(scenario)
    algorithm = load_algorithm(
        scenario.algorithm.name, scenario.algorithm.alpha, scenario.algorithm.beta
    )
    groups = group_by_archive(scenario, file.folder)
    with ExitStack() as stack, np.errstate(all="ignore"):
        fleet = open_fleet(stack, groups, bodies(scenario))
        bus = ZenohBus(uuid4().hex)
        stack.callback(bus.close)
        initial = initial_estimates(scenario)
        robots = np.arange(1, scenario.n + 1)
        links = links_of(scenario, robots)
        missing = missing_of(scenario) if links else "hold"
        agents = Agents(robots, topology, algorithm, initial, links, missing)
        host = Host(bus, clock, agents, fleet, scenario.run.divergence_limit)
        node = TargetNode(bus, clock, target, scenario.m)
        writer = stack.enter_context(
            Writer(
                output,
                version=version("nrs-cosim"),
                channels=channels(scenario.n, agents.faulty),
                schemas=schemas(agents.faulty),
                metadata={
                    RUN: _about_run(file, clock, groups, fleet),
                    "nrs.versions": _versions(),
                },
                attachments={SCENARIO: ("application/toml", file.text.encode())},
                compression=compression,
            )
        )
        recorder = Recorder(bus, writer, scenario.n, agents.faulty)
        status: Closing = "completed"
        reason, done = "", 0
        started = perf_counter()
        try:
            for done in run_ticks(clock, node, host, recorder, watch):  # noqa: B007
                pass
        except Interrupted:
            at = seconds(clock.t(done))
            status, reason = "interrupted", f"stopped by the user after t = {at:g} s"
        except RunError as error:
            status, reason = "failed", str(error)
        wall_seconds = perf_counter() - started
        writer.finish(status, reason)
    return Outcome(status, reason, output, done, recorder.messages, wall_seconds)


def _about_run(
    file: ScenarioFile, clock: Clock, groups: list[Group], fleet: Fleet
) -> dict[str, str]:
    """Return the run's metadata record; its numbers are decimal, its times in ns."""
    about_plants = [
        {
            "fmu": group.archive.label,
            "name": group.archive.name,
            "fmi_version": group.archive.fmi_version,
            "kind": plants.kind,
            "drive": plants.drive,
            "why": plants.why,
            "sha256": group.archive.sha256,
            "robots": [row + 1 for row in group.rows],
        }
        for group, plants in zip(groups, fleet.plants, strict=True)
    ]
    return {
        "name": file.name,
        "seed": str(file.scenario.run.seed),
        "robots": str(file.scenario.n),
        "joints": str(file.scenario.m),
        "ticks": str(clock.ticks),
        "sampling_period_ns": str(clock.period_ns),
        "output_step_ns": str(clock.output_ns),
        "plants": json.dumps(about_plants),
    }


def _versions() -> dict[str, str]:
    return {
        **{part: version(part) for part in _PARTS},
        "python": platform.python_version(),
        "platform": platform.platform(),
    }
