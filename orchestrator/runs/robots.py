"""Some robots of a scenario as a worker has them: their plants opened, their agents ready."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from nrs_cosim.bus.keys import TARGET
from nrs_cosim.bus.seal import Seal
from nrs_cosim.bus.transport import Bus, Inbox
from nrs_cosim.bus.wire import Nodes, Wire
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.orchestrator.runs.plants import group_by_archive, open_fleet
from nrs_cosim.orchestrator.runs.worker import Worker, WorkerPlants
from nrs_cosim.orchestrator.scenario.clock import Clock
from nrs_cosim.orchestrator.scenario.file import ScenarioFile
from nrs_cosim.orchestrator.scenario.setting import (
    algorithm_of,
    bodies,
    clock_of,
    initial_estimates,
    links_of,
    missing_of,
    silent_of,
    topologies_of,
)
from nrs_cosim.orchestrator.scenario.tables.scenario import Scenario
from nrs_cosim.plant_fmu.archives.archive import Archive


@dataclass(frozen=True, slots=True, eq=False)
class Robots:
    """Robots, ascending, with what they are made of."""

    numbers: Sequence[int]
    scenario: Scenario
    agents: Agents
    plants: WorkerPlants
    told: Sequence[Mapping[str, Any]]
    """What the user is told of the plants, by group."""

    @classmethod
    def opened(
        cls,
        stack: ExitStack,
        file: ScenarioFile,
        numbers: Sequence[int],
        find: Callable[[str], Archive] | None = None,
    ) -> "Robots":
        """Open some robots' plants at t_0; the stack ends them. `FmuError` as `open_fleet`.

        `find` finds an FMU by what the scenario calls it; by default relative to its file.
        """
        scenario = file.scenario
        groups = group_by_archive(scenario, file.folder, numbers, find)
        alike = [bodies(scenario, group.alike) for group in groups]
        of = bodies(scenario, numbers)
        fleet = open_fleet(stack, groups, of, alike)
        told = [
            {
                "fmu": group.plant.fmu,
                "name": group.archive.name,
                "fmi_version": group.archive.fmi_version,
                "kind": plants.kind,
                "drive": plants.drive,
                "why": plants.why,
                "sha256": group.archive.sha256,
                "robots": [numbers[row] for row in group.rows],
                "joints": [
                    {"name": joint.name, "unit": joint.unit}
                    for joint in group.joints(of[group.rows[0]].parameters)
                ],
            }
            for group, plants in zip(groups, fleet.plants, strict=True)
        ]
        return cls(numbers, scenario, agents_of(scenario, numbers), fleet, told)

    @classmethod
    def driven_by(
        cls,
        scenario: Scenario,
        numbers: Sequence[int],
        plants: WorkerPlants,
        told: Sequence[Mapping[str, Any]],
    ) -> "Robots":
        """Return some robots whose plants are there already."""
        return cls(numbers, scenario, agents_of(scenario, numbers), plants, told)

    def worker(self, name: str, bus: Bus, inbox: Inbox, wire: Wire, clock: Clock) -> Worker:
        """Return the worker that runs them."""
        run = self.scenario.run
        return Worker(
            name,
            bus,
            inbox,
            wire,
            clock,
            self.agents,
            self.plants,
            run.divergence_limit,
            run.checkpoint_every,
        )


def agents_of(scenario: Scenario, numbers: Sequence[int]) -> Agents:
    """Return some robots' agents at t_0."""
    robots = np.array(numbers)
    return Agents(
        robots,
        topologies_of(scenario),
        algorithm_of(scenario),
        initial_estimates(scenario, numbers),
        links_of(scenario, robots),
        missing_of(scenario),
    )


def wire_of(scenario: Scenario, assignment: Mapping[str, Sequence[int]], seal: Seal) -> Wire:
    """Return the wire of a run whose robots are assigned to workers."""
    nodes: dict[str, Nodes] = {worker: np.array(robots) for worker, robots in assignment.items()}
    nodes[TARGET] = np.array([0])
    return Wire(scenario.m, clock_of(scenario), nodes, seal, silent_of(scenario))
