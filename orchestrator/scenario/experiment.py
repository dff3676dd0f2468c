"""An experiment is a scenario resolved once: everything that a run, and what is said of it, needs.

A scenario is what its user wrote. What follows from it (sampling times, who receives from whom, how
the target moves, what links do to samples, which estimator the agents have, what robots start with)
is here, made when it is first asked for and then kept, and nothing else derives it. It never
changes, and its parts are shared by whoever asks: arrays among them are not to be written.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import Clock, Jitter, nanoseconds
from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.lies import Lies
from nrs_cosim.bus.links.links import LinkFault, Links
from nrs_cosim.bus.links.outages import Outages
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.estimator_agents.algorithm import Algorithm, Missing, class_of, overrides
from nrs_cosim.estimator_agents.edges import field_sizes
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.target import Target
from nrs_cosim.estimator_agents.values import Values
from nrs_cosim.orchestrator.scenario.assets import Assets
from nrs_cosim.orchestrator.scenario.byzantine import (
    OwnLie,
    byzantine_robots,
    lies_of,
    needed_algorithms,
)
from nrs_cosim.orchestrator.scenario.conversion import (
    Array,
    control,
    gains,
    motion_of,
    terms,
)
from nrs_cosim.orchestrator.scenario.faults import link_faults, silences
from nrs_cosim.orchestrator.scenario.initial import initial_rows
from nrs_cosim.orchestrator.scenario.networks import topologies_of
from nrs_cosim.orchestrator.scenario.own import Own, own_of
from nrs_cosim.orchestrator.scenario.robot_ids import with_parameters
from nrs_cosim.orchestrator.scenario.tables.fmus import Plant
from nrs_cosim.orchestrator.scenario.tables.scenario import Run, Scenario
from nrs_cosim.orchestrator.scenario.tables.targets import Axis, FmuMotion
from nrs_cosim.plant_fmu.bundled.declaration import bundled_models
from nrs_cosim.plant_fmu.plants import Body, Disturbance


@dataclass(frozen=True)  # with no slots: what is derived is kept beside the fields
class Experiment:
    """A scenario with all that follows from it; n robots of m joints.

    One that `orchestrator.scenario.file` did not return may be wrong, and what is asked of it then
    fails in any way.
    """

    scenario: Scenario
    """The tables, with the edges and samples that they name."""
    text: str
    """What was written, to the byte."""
    name: str
    folder: Path
    """What paths in it are relative to."""
    assets: Assets = field(default_factory=dict)
    """What it names, by content."""
    fmus: Mapping[str, Path] = field(default_factory=dict)
    """Where FMUs are that are not where the scenario says, by what it calls them."""

    def but(self, **fields: Any) -> "Experiment":
        """Return it with other fields, from which nothing follows that was asked for before."""
        other = replace(self, **fields)
        derived = vars(self).keys() - vars(other).keys()
        vars(other).update({name: vars(self)[name] for name in derived})
        return other

    def with_algorithm(self, algorithm: Algorithm) -> "Experiment":
        """Return it with an estimator of the same fields, for theory to look at; it cannot run."""
        other = self.but()
        vars(other)["algorithm"] = algorithm
        return other

    @property
    def n(self) -> int:
        """The number of robots."""
        return self.scenario.n

    @property
    def m(self) -> int:
        """The number of joints of each robot, which is that of the target's axes."""
        return self.scenario.m

    @property
    def seed(self) -> int:
        """The key of all that is drawn."""
        return self.scenario.run.seed

    @cached_property
    def clock(self) -> Clock:
        """The sampling times and the output grid."""
        return _clock_of(self.scenario.run)

    @cached_property
    def topologies(self) -> TopologySchedule:
        """Who receives from whom, and when; its arrays cannot be written."""
        return topologies_of(self.scenario.network, self.seed)

    @cached_property
    def target(self) -> Target:
        """The target's motion."""
        return motion_of(self.scenario.target)

    def target_at(self, seconds: Array) -> tuple[Array, Array]:
        """Return the target's position and velocity, (…, m) each, at times (…), s."""
        motion = self.target.at(seconds)
        return motion.position, motion.velocity

    @cached_property
    def algorithm(self) -> Algorithm:
        """The estimator with its parameters; `InputError` where it does not take them."""
        return self.scenario.algorithm.loaded()

    @property
    def missing(self) -> Missing:
        """What an agent does without a neighbour's sample."""
        return self.scenario.algorithm.policy

    @cached_property
    def sizes(self) -> Sizes:
        """What the symbols of declared shapes stand for."""
        return field_sizes(self.topologies, self.m)

    @cached_property
    def codecs(self) -> Codecs:
        """What codes the run's messages: of what the algorithm sends and keeps."""
        kind = class_of(self.algorithm)
        duplicates = any(fault.duplicate for fault in self.link_faults.values())
        return Codecs.of(
            self.sizes,
            kind.__name__,
            kind.SENT,
            kind.STATE,
            measured=overrides(kind, "measure"),
            duplicates=duplicates,
        )

    @cached_property
    def link_faults(self) -> Mapping[tuple[int, int], LinkFault]:
        """What is wrong with each link that the scenario names."""
        return link_faults(self.scenario, self.topologies.links, self.algorithm.SENT)

    @cached_property
    def byzantine(self) -> list[int]:
        """The robots that lie, ascending; what is measured and proven is of the others."""
        return byzantine_robots(self.scenario)

    @property
    def lying_by(self) -> Sequence[tuple[int, str]]:
        """The robots that lie by another algorithm, and by which."""
        return [
            (entry.robot, with_parameters(entry.algorithm.name, entry.algorithm.parameters))
            for entry in self.scenario.faults.byzantine
            if entry.algorithm
        ]

    @cached_property
    def _lies(self) -> Sequence[OwnLie]:
        return lies_of(self.scenario, self.algorithm.SENT, self._initial_sample)

    def lies_to_all(self, robots: Sequence[int]) -> Lies | None:
        """Return what some robots send in place of their samples; None where none of them does."""
        lies = [[own.lie for own in self._lies if own.robot == r and not own.to] for r in robots]
        return Lies(self.seed, lies, np.array(robots)) if any(lies) else None

    def algorithm_lies(self, robots: Sequence[int]) -> Sequence[OwnLie]:
        """Return the lies by other algorithms that some robots tell all, or are told."""
        return needed_algorithms(self._lies, robots)

    @property
    def impaired(self) -> bool:
        """Whether links have faults; what robots say is none of these."""
        sound = LinkFault()
        faults = self.link_faults.values()
        return bool(silences(self.scenario)) or any(fault != sound for fault in faults)

    @cached_property
    def links(self) -> Links | None:
        """The links that have faults; None if the scenario has no faults at all."""
        return self._links_into(range(1, self.n + 1))

    def links_into(self, robots: Sequence[int], algorithm: Algorithm | None = None) -> Links | None:
        """Return the links into some robots over which a receive buffer keeps the last sample.

        They are those that have faults, and all where robots decide when they send, or receive
        every sample, as they do by their own algorithm or by another one; else None.
        """
        if self.algorithm.TRIGGERED or (algorithm or self.algorithm).ARRIVALS == "every":
            return self._links_into(robots, every=True)
        return self.links if len(robots) == self.n else self._links_into(robots)

    @cached_property
    def faulty(self) -> list[int]:
        """The robots that may meet faults on the links into them, ascending."""
        return np.unique(self.links.sink).tolist() if self.links else []

    @cached_property
    def outages(self) -> Outages:
        """When which robots send nothing."""
        return Outages.of(silences(self.scenario), self.clock.since)

    @cached_property
    def _shared(self) -> Own:
        return Own(
            "plant", self.scenario.plant, self.scenario.controller, self.scenario.disturbance
        )

    @cached_property
    def _own(self) -> Mapping[int, Own]:
        """Of those robots that have a table of their own."""
        return own_of(self.scenario)

    def of_robot(self, robot: int) -> Own:
        """Return a robot's plant, gains and disturbance, its own or those that all share."""
        return self._own.get(robot, self._shared)

    @cached_property
    def plants(self) -> Sequence[Plant]:
        """All robots' plants, from robot 1 on."""
        return [self.of_robot(robot).plant for robot in range(1, self.n + 1)]

    @property
    def files_at(self) -> Path | None:
        """Where the FMUs and certificates are that the scenario names; None where it names none."""
        named = {plant.fmu for plant in self.plants} - {*bundled_models()}
        target, tls = self.scenario.target, self.scenario.bus.tls
        return self.folder.resolve() if named or tls or isinstance(target, FmuMotion) else None

    def initial_estimates(self, robots: Sequence[int] | None = None) -> Estimate:
        """Return ε_i(t_0) and υ_i(t_0), (rows, m), of some robots or of all."""
        return Estimate(self._initial("position", robots), self._initial("velocity", robots))

    def initial_state(self, robots: Sequence[int] | None = None) -> Values:
        """Return what agents keep at t_0, (rows, *shape) each, of some robots or of all."""
        return self.initial_of(self.algorithm, self._those(robots))

    def initial_of(self, algorithm: Algorithm, robots: Sequence[int]) -> Values:
        """Return what some robots' agents keep at t_0 that run an algorithm, their own or not.

        What a scenario gives is of fields of their own; others begin as they are declared.
        """
        found = {}
        for name, kept in algorithm.STATE.items():
            shape, own = kept.size(self.sizes), self.algorithm.STATE.get(name)
            if own and own.size(self.sizes) == shape:
                rows = initial_rows(self.scenario, name, robots, shape, kept.initial)
            else:
                rows = np.full((len(robots), *shape), kept.initial, float)
            found[name] = rows
        return Values(found)

    def bodies(self, robots: Sequence[int] | None = None) -> list[Body]:
        """Return what each of some robots starts with, or of all."""
        names = ("q", "qd", "position", "velocity")
        start = {name: self._initial(name, robots) for name in names}
        laws: dict[int, dict[str, Any]] = {}
        """Made once of the tables that robots have in common."""
        found = []
        for row, robot in enumerate(self._those(robots)):
            own = self.of_robot(robot)
            law = laws.get(id(own)) or laws.setdefault(id(own), self._law(own))
            parameters = own.plant.parameters
            own_start = {name: rows[row] for name, rows in start.items()}
            found.append(Body(robot=robot, parameters=parameters, **law, **own_start))
        return found

    def _law(self, own: Own) -> dict[str, Any]:
        kp, kd = gains(own.controller, self.m)
        disturbance = Disturbance(*terms(own.disturbance.axes or (Axis(),) * self.m))
        control_of_it = control(own.controller, self.m)
        return {"kp": kp, "kd": kd, "disturbance": disturbance, "control": control_of_it}

    def _initial_sample(self, robot: int) -> dict[str, Array]:
        """Return what a robot's sample would have at t_0: what it keeps, or fields' own start."""
        kept = self.initial_state([robot])
        return {
            name: kept[name][0] if name in kept else np.full(field.size(self.sizes), field.initial)
            for name, field in self.algorithm.SENT.items()
        }

    def _initial(self, name: str, robots: Sequence[int] | None) -> Array:
        return initial_rows(self.scenario, name, self._those(robots), (self.m,))

    def _those(self, robots: Sequence[int] | None) -> Sequence[int]:
        return range(1, self.n + 1) if robots is None else robots

    def _links_into(self, robots: Sequence[int], *, every: bool = False) -> Links | None:
        topologies = self.topologies
        faults, quiet = {**self.link_faults}, silences(self.scenario)
        for own in self._lies:
            for link in ((own.robot, receiver) for receiver in own.to):
                fault = faults.get(link, LinkFault())
                faults[link] = replace(fault, lies=(*fault.lies, own.lie))
        if not every and not quiet and all(fault == LinkFault() for fault in faults.values()):
            return None
        into: NDArray[np.integer] = np.array(robots)
        return Links(
            topologies,
            into,
            faults,
            quiet,
            ticks=self.clock,
            seed=self.seed,
            codecs=self.codecs,
            every=every,
        )


def _clock_of(run: Run) -> Clock:
    times = tuple(nanoseconds(t) for t in run.sampling_times or (run.sampling_period or 0,))
    end, turn = nanoseconds(run.end or 0), times[-1]
    step = nanoseconds(run.output_step) if run.output_step else None
    longest = max(after - before for before, after in pairwise((0, *times)))
    early = int(Decimal(repr(run.sampling_jitter)) * turn)
    return Clock(
        times,
        -(-longest // step) if step else 1,
        end // turn * len(times),
        Jitter(run.seed, early) if early else None,
    )
