"""A run as FMUs that sample one another: each robot with its agent is one, and the target is one.

At t_k an engine hands the outputs of all, which are left limits, to the inputs of all; each agent
jumps as the step from t_k begins. So one exchange a step is enough, in whatever order FMUs are
stepped. Digraphs in turn, and one for velocities apart, are weights that the agents have by k: the
connections are those of all. A target that is no sum of sines is its samples. What is not of this
kind is refused: samples that a link alters, for what is drawn at each t_k would be a table as long
as the run; sampling times that no equal steps meet; an algorithm that does more than jump linearly;
and plants whose equations are another's.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.values import Values
from nrs_cosim.orchestrator.engine.plants import Group, group_by_archive
from nrs_cosim.orchestrator.export.law import AgentLaw, law_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.plant_fmu.bundled.declaration import Declaration, bundled_models
from nrs_cosim.plant_fmu.bundled.model_description import element_names
from nrs_cosim.plant_fmu.bundled.sampled import (
    SAMPLE,
    Built,
    build_agent,
    build_robot,
    build_sampled_target,
    build_target,
    built_equations,
    bundled_equations,
    initial_name,
    kept_name,
    received_name,
)
from nrs_cosim.plant_fmu.drives.choice import choose
from nrs_cosim.plant_fmu.drives.reference_driven import start_values
from nrs_cosim.plant_fmu.drives.within_efforts import within_efforts
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of
from nrs_cosim.plant_fmu.plants import Body

Array = NDArray[np.float64]
STATE = ("q", "qd")
MOST_DIGRAPHS = 100
"""In turn, of which an agent has the weights: two numbers for each and each in-neighbour."""
STARTS = {name: f"{name}_start" for name in STATE}


@dataclass(frozen=True, slots=True)
class Component:
    """An FMU with its parameters: numbers by name."""

    name: str
    fmu: Path
    parameters: Mapping[str, float]
    inputs: Sequence[str]
    outputs: Sequence[str]


Connection = tuple[str, str, str, str]
"""From a component's output to a component's input."""


@dataclass(frozen=True, slots=True)
class System:
    """Components and connections, to be stepped from 0 to an end by equal steps, in s."""

    name: str
    components: Sequence[Component]
    connections: Sequence[Connection]
    step: float
    end: float
    exact: bool
    """Whether the jump by K and G is the algorithm's own to the last bit, and not for rounding."""


def system_of(experiment: Experiment, ticks: int) -> System:
    """Return so much of an experiment as a system.

    `InputError` names the fields for which it can be none.
    """
    _expect_none(_wrong(experiment), experiment.name)
    law = _law(experiment)
    clock, schedule = experiment.clock, experiment.topologies
    assert clock.period is not None
    names = node_names(experiment.n)
    groups = {row + 1: group for group in group_by_archive(experiment) for row in group.rows}
    unit = groups[1].joints(experiment.bodies([1])[0].parameters)[0].unit
    whole = len({joint.unit for g in groups.values() for joint in g.joints()}) == 1
    components = [_target(names[0], experiment, ticks, unit if whole else "", law)]
    connections: list[Connection] = []
    for body in experiment.bodies():
        starts = experiment.initial_state([body.robot])
        built, values = _robot(body, groups[body.robot], schedule, law, starts)
        sent = [kept_name(name) for name in law.fields.sent]
        inputs = [received_name(name) for name in law.fields.sent]
        outputs = (*dict.fromkeys((*SAMPLE, *sent)), *STATE)
        components.append(
            _component(names[body.robot], built, values, inputs=inputs, outputs=outputs)
        )
        for place, source in enumerate(schedule.links.in_neighbours(body.robot), 1):
            for sample, given in zip(sent if source else law.truths, inputs, strict=True):
                connections += [
                    (
                        names[source],
                        f"{sample}[{i}]",
                        names[body.robot],
                        f"{given}[{place},{i}]",
                    )
                    for i in range(1, experiment.m + 1)
                ]
    even = clock.period % clock.parts == 0
    step = clock.period // clock.parts if even else clock.period
    return System(
        experiment.name,
        components,
        connections,
        seconds(step),
        seconds(clock.t(ticks)),
        law.exact,
    )


def agent_of(experiment: Experiment, robot: int, fmi: int) -> Built:
    """Return a robot's agent alone, its parameters as starts; `InputError` as `system_of`."""
    _expect_none(_wrong_network(experiment), experiment.name)
    law, schedule = _law(experiment), experiment.topologies
    values = _agent(robot, schedule, law, experiment.initial_state([robot]))
    return build_agent(experiment.m, *_sizes(robot, schedule), fmi, values, law.fields)


def node_names(n: int) -> list[str]:
    """Return the components' names, of which none begins with another, as engines compare these."""
    return ["target", *(f"robot_{robot:0{len(str(n))}}" for robot in range(1, n + 1))]


def _robot(
    body: Body, group: Group, schedule: TopologySchedule, law: AgentLaw, initial_state: Values
) -> tuple[Built, dict[str, Any]]:
    archive = group.archive
    sizes = sizes_of(assignments(archive, body.parameters))
    structural = {
        v.name: sizes.get(v.valueReference, int(v.start))
        for v in archive.description.modelVariables
        if v.causality == "structuralParameter"
    }
    if archive.label in bundled_models():
        equations = bundled_equations(archive.name)
    else:
        units = {joint.unit for joint in group.joints(body.parameters)}
        unit = units.pop() if len(units) == 1 else ""
        equations = built_equations(archive.name, archive.path, len(body.q), unit)
    built = build_robot(equations, *_sizes(body.robot, schedule), structural, law.fields)
    (limited,) = within_efforts(archive, [body])
    given = start_values(limited, archive, group.names)
    inputs = {v.name for v in built.declaration.of_kind("input")}
    starts = {STARTS.get(name, name): value for name, value in given.items() if name not in inputs}
    own = {name: value for name, value in body.parameters.items() if name not in structural}
    return built, {
        **own,
        **starts,
        **_agent(body.robot, schedule, law, initial_state),
    }


def _sizes(robot: int, schedule: TopologySchedule) -> tuple[int, int]:
    """Return from how many a robot ever receives, at least 1, and how many digraphs there are."""
    return max(len(schedule.links.in_neighbours(robot)), 1), len(schedule.exchanges)


def _agent(
    robot: int, schedule: TopologySchedule, law: AgentLaw, initial_state: Values
) -> dict[str, Any]:
    in_neighbours, digraphs = _sizes(robot, schedule)
    weights = np.zeros((len(SAMPLE), digraphs, in_neighbours))
    for at, exchange in enumerate(schedule.exchanges):
        for of, digraph in enumerate((exchange.position, exchange.velocity)):
            places = np.searchsorted(
                schedule.links.in_neighbours(robot), digraph.in_neighbours(robot)
            )
            weights[of, at, places] = digraph.normalised[digraph.sink == robot]
    return {
        "position_weight": weights[0],
        "velocity_weight": weights[1],
        "since": np.array(schedule.since),
        "repeat": schedule.repeat or 0,
        "keep": law.keep,
        "gain": law.gain,
        "sampling_period": law.h,
        **{initial_name(name): initial_state[name][0] for name in law.fields.kept},
    }


def _target(name: str, experiment: Experiment, ticks: int, unit: str, law: AgentLaw) -> Component:
    target, clock = experiment.target, experiment.clock
    truths = tuple(dict.fromkeys((*SAMPLE, *law.truths)))
    if not isinstance(target, Harmonic):
        times = [seconds(clock.t(k)) for k in range(ticks + 1)]
        at = target.at(times)
        samples = [at.position, at.velocity]
        if "acceleration" in truths:
            samples.append(target.acceleration(times))
        built = build_sampled_target(np.hstack(samples), times[1], unit, truths)
        return _component(name, built, {}, inputs=(), outputs=truths)
    m, terms = target.amplitude.shape
    values = {key: getattr(target, key) for key in ("offset", "rate")}
    if terms:
        values |= {key: getattr(target, key) for key in ("amplitude", "frequency", "phase")}
    built = build_target(m, terms, unit, truths)
    return _component(name, built, values, inputs=(), outputs=truths)


def _component(
    name: str,
    built: Built,
    values: Mapping[str, Any],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
) -> Component:
    declared = built.declaration
    parameters = {
        element: float(number)
        for key, value in values.items()
        for element, number in zip(_elements(declared, key), np.ravel(value), strict=True)
    }
    taken, given = (
        [e for key in keys for e in _elements(declared, key)] for keys in (inputs, outputs)
    )
    return Component(name, built.path, parameters, taken, given)


def _elements(declared: Declaration, name: str) -> Sequence[str]:
    return element_names(declared.variable(name))


def _law_of(experiment: Experiment) -> AgentLaw | str:
    """Return the algorithm's law, whose sampling times are periodic, or why it has none."""
    clock, exchanges = experiment.clock, experiment.topologies.exchanges
    assert clock.period is not None
    apart = any(exchange.has_two_digraphs for exchange in exchanges)
    return law_of(experiment.algorithm, experiment.sizes, seconds(clock.period), apart)


def _law(experiment: Experiment) -> AgentLaw:
    law = _law_of(experiment)
    assert isinstance(law, AgentLaw)  # else it is refused
    return law


def _wrong(experiment: Experiment) -> Iterator[str]:
    yield from _wrong_network(experiment)
    for group in group_by_archive(experiment):
        if group.archive.label not in bundled_models() and not group.archive.ours:
            yield (
                f"{group.field}.fmu: {group.archive.label} is neither a bundled model nor built "
                "here from a URDF: an agent is compiled together with equations in C"
            )
        elif group.plant.variables:
            yield f"{group.field}.variables: a robot with its agent has names of its own"
        else:
            try:
                way = choose(group.archive, group.names, group.driving).way
            except FmuError as error:
                yield f"{group.field}: {error}"
            else:
                if way != "reference":
                    yield f"{group.field}: is driven by {quoted(way)}, not by its own PD law"


def _wrong_network(experiment: Experiment) -> Iterator[str]:
    """Yield for which fields agents and their links are no FMUs and connections."""
    schedule = experiment.topologies
    name = experiment.scenario.algorithm.name
    if experiment.clock.period is None:
        yield "run: sampling times are aperiodic; engines step by equal steps, and would miss them"
    elif isinstance(why := _law_of(experiment), str):
        yield f"algorithm.name: {name} {why}"
    if len(schedule.exchanges) > MOST_DIGRAPHS:
        many = f"{len(schedule.exchanges)} digraphs come in turn"
        yield f"network: {many}; an agent has parameters for {MOST_DIGRAPHS} at most"
    if experiment.links is not None or experiment.byzantine:
        yield (
            "faults: links and robots alter, lose or delay samples; a connection does not; "
            "--set 'faults={}' leaves them out"
        )


def _expect_none(faults: Iterator[str], name: str) -> None:
    if found := list(faults):
        raise InputError(
            "\n".join(f"{name}: cannot be taken elsewhere: {fault}" for fault in found)
        )
