"""Some robots of a scenario as a worker has them: their plants opened, their agents ready."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from nrs_cosim.bus.fields import ESTIMATE
from nrs_cosim.bus.keys import TARGET
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.transport import Bus, Inbox
from nrs_cosim.bus.validation import Nodes, Wire
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.estimator_agents.lying_agents import LyingAgents, OtherAlgorithm
from nrs_cosim.orchestrator.engine.native.tick import (
    NativeDisagreements,
    NativeStates,
    load_tick,
)
from nrs_cosim.orchestrator.engine.native.whole_tick import WholeTick
from nrs_cosim.orchestrator.engine.plants import group_by_archive, open_fleet
from nrs_cosim.orchestrator.engine.worker import Worker, WorkerPlants
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.drives.choice import CVODE


@dataclass(frozen=True, slots=True, eq=False)
class Robots:
    """Robots, ascending, with what they are made of."""

    numbers: Sequence[int]
    experiment: Experiment
    agents: Agents
    plants: WorkerPlants
    plant_descriptions: Sequence[Mapping[str, Any]]
    """What the user is told of the plants, by group."""

    @classmethod
    def opened(
        cls,
        stack: ExitStack,
        experiment: Experiment,
        numbers: Sequence[int],
        find: Callable[[str], Archive] | None = None,
        threads: int = 1,
    ) -> "Robots":
        """Open some robots' plants at t_0; the stack ends them. `FmuError` as `open_fleet`.

        `find` finds an FMU by what the scenario calls it; by default relative to its file. So many
        `threads` step those of which several may.
        """
        groups = group_by_archive(experiment, numbers, find)
        representatives = [experiment.bodies(group.representatives) for group in groups]
        of = experiment.bodies(numbers)
        fleet = open_fleet(stack, groups, of, representatives, threads)
        plant_descriptions = [
            {
                "fmu": group.plant.fmu,
                "name": group.archive.name,
                "fmi_version": group.archive.fmi_version,
                "kind": plants.kind,
                "drive": plants.drive,
                "why": plants.why,
                "any_machine": group.archive.ours and not plants.drive.startswith(CVODE),
                "sha256": group.archive.sha256,
                "robots": [numbers[row] for row in group.rows],
                "joints": [
                    {"name": joint.name, "unit": joint.unit}
                    for joint in group.joints(of[group.rows[0]].parameters)
                ],
                "urdf": group.archive.urdf,
            }
            for group, plants in zip(groups, fleet.plants, strict=True)
        ]
        return cls(numbers, experiment, agents_of(experiment, numbers), fleet, plant_descriptions)

    @classmethod
    def driven_by(
        cls,
        experiment: Experiment,
        numbers: Sequence[int],
        plants: WorkerPlants,
        plant_descriptions: Sequence[Mapping[str, Any]],
    ) -> "Robots":
        """Return some robots whose plants are there already."""
        return cls(numbers, experiment, agents_of(experiment, numbers), plants, plant_descriptions)

    def worker(self, name: str, bus: Bus, inbox: Inbox, wire: Wire) -> Worker:
        """Return the worker that runs them."""
        run, states = self.experiment.scenario.run, None
        if native := load_tick():
            self.agents.disagree_by(partial(NativeDisagreements, native))
            limit = run.divergence_limit
            states = NativeStates(native, wire.states, self.agents, self.plants, limit)
        return Worker(
            name,
            bus,
            inbox,
            wire,
            self.experiment.clock,
            self.agents,
            self.plants,
            run.divergence_limit,
            run.checkpoint_every,
            states,
        )

    def whole_tick(self, wire: Wire, most: int) -> WholeTick | str:
        """Return what does whole ticks of them by native code, of `most` outputs; or why not."""
        native, agents = load_tick(), self.agents
        if not native:
            return "nothing can be compiled"
        found = agents.disagree_by(partial(NativeDisagreements, native))
        if isinstance(found, str):
            return found
        if agents.lies or type(agents) is not Agents:
            return "robots lie"
        if wire.of_agents or agents.algorithm.SENT != ESTIMATE:
            return "the algorithm sends or keeps more than its estimate"
        limit = self.experiment.scenario.run.divergence_limit
        return WholeTick(native, wire, agents, self.plants, found, limit, most)


def agents_of(experiment: Experiment, numbers: Sequence[int]) -> Agents:
    """Return some robots' agents at t_0."""
    agents = (
        np.array(numbers),
        experiment.topologies,
        experiment.algorithm,
        experiment.initial_state(numbers),
        experiment.clock,
        experiment.links_into(numbers),
        experiment.missing,
        experiment.seed,
        experiment.lies_to_all(numbers),
    )
    others = _other_algorithms(experiment, numbers)
    return LyingAgents(others, *agents) if others else Agents(*agents)


def _other_algorithms(experiment: Experiment, numbers: Sequence[int]) -> list[OtherAlgorithm]:
    """Return the algorithms at t_0 by which robots lie to some robots, or these to all."""
    found = []
    for own in experiment.algorithm_lies(numbers):
        assert own.algorithm
        algorithm = own.loaded()
        agent = Agents(
            np.array([own.robot]),
            experiment.topologies,
            algorithm,
            experiment.initial_of(algorithm, [own.robot]),
            experiment.clock,
            experiment.links_into([own.robot], algorithm),
            own.algorithm.policy,
            experiment.seed,
        )
        needed_by = {robot for robot in numbers if own in experiment.algorithm_lies([robot])}
        found.append(OtherAlgorithm(own.lie, agent, not own.to, frozenset(needed_by)))
    return found


def wire_of(
    experiment: Experiment,
    assignment: Mapping[str, Sequence[int]],
    signer: Signer,
    *,
    in_process: bool = False,
) -> Wire:
    """Return the wire of a run whose robots are assigned to workers; `in_process` as `Wire`."""
    nodes: dict[str, Nodes] = {worker: np.array(robots) for worker, robots in assignment.items()}
    nodes[TARGET] = np.array([0])
    return Wire(
        experiment.codecs,
        experiment.clock,
        nodes,
        signer,
        experiment.outages.at,
        measuring=experiment.topologies.pinned,
        triggered=experiment.algorithm.TRIGGERED,
        in_process=in_process,
    )
