"""What may be wrong with a scenario's tables in shape, or in the relation of one to another."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import Shape
from nrs_cosim.bus.network.access import expect_worker_name
from nrs_cosim.bus.text import nearest, quoted
from nrs_cosim.estimator_agents.algorithm import class_of
from nrs_cosim.estimator_agents.installed import policies_of, takes_separate_graphs
from nrs_cosim.orchestrator.scenario.byzantine import wrong_byzantine
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.faults import wrong_faults
from nrs_cosim.orchestrator.scenario.networks import hetero_at
from nrs_cosim.orchestrator.scenario.own import own_of
from nrs_cosim.orchestrator.scenario.robot_ids import parse_robots
from nrs_cosim.orchestrator.scenario.tables.algorithms import AlgorithmTable, NotInstalled
from nrs_cosim.orchestrator.scenario.tables.faults import Faults
from nrs_cosim.orchestrator.scenario.tables.fmus import Plant
from nrs_cosim.orchestrator.scenario.tables.networks import Network
from nrs_cosim.orchestrator.scenario.tables.scenario import (
    Controller,
    Disturbance,
    Scenario,
    TlsTable,
)
from nrs_cosim.orchestrator.scenario.targets import unsampled_times
from nrs_cosim.orchestrator.scenario.times import wrong_times
from nrs_cosim.orchestrator.scenario.wrong_initial import AXES, length_fault, wrong_initial
from nrs_cosim.orchestrator.scenario.wrong_networks import unused_phases, wrong_form, wrong_network
from nrs_cosim.plant_fmu.archives.quantities import MOTION, UNITS

SHORTEST = 1e-6
ELSEWHERE = {
    "kp": "controller.kp",
    "kd": "controller.kd",
    **{
        name: f"controller.{name}"
        for name in ("ki", "torque_limit", "gravity_compensation", "acceleration_feedforward")
    },
    "computed_torque": "controller.computed_torque",
    "inertia_scaling": "controller.frequency",
    "q": "initial.q",
    "qd": "initial.qd",
    "position_ref": "initial.position",
    "velocity_ref": "initial.velocity",
    **{
        f"disturbance_{part}": "disturbance.axes"
        for part in ("offset", "rate", "amplitude", "frequency", "phase")
    },
}
"""Parameters of a plant that a scenario gives in tables of their own."""


def wrong_tables(experiment: Experiment) -> Iterator[str]:
    """Yield what is wrong in shape or in the relation of one field to another."""
    scenario = experiment.scenario
    no_form = wrong_form(scenario.network)
    if no_form:
        yield no_form
        return
    n, m = scenario.n, scenario.m
    network_faults = list(wrong_network(experiment))
    yield from _algorithm_faults(scenario.network, scenario.algorithm)
    time_faults = list(wrong_times(experiment))
    yield from time_faults or unsampled_times(experiment)
    yield from _plant_faults("plant", scenario.plant)
    yield from network_faults
    if not (time_faults or network_faults):
        yield from unused_phases(experiment)
    yield from _gain_faults("controller", scenario.controller, m)
    yield from _law_faults("controller", scenario.controller)
    yield from _axes_faults("disturbance", scenario.disturbance, m)
    yield from wrong_initial(experiment, sized=not network_faults)
    if scenario.faults != Faults.model_construct():  # which builds no schema
        links = None if network_faults else experiment.topologies.links
        yield from wrong_faults(scenario, links, _sent(experiment))
        yield from wrong_byzantine(scenario, links, _sent(experiment))
        yield from _wrong_liars(experiment, sized=links is not None)
    yield from _robot_faults(scenario)
    yield from _workers_faults(scenario.bus.tls, n)


def _sent(experiment: Experiment) -> Collection[str]:
    """Return the fields of samples; none where the algorithm, which is wrong, does not say."""
    try:
        return experiment.algorithm.SENT
    except InputError:
        return ()


def _robot_faults(scenario: Scenario) -> Iterator[str]:
    n, m, own = scenario.n, scenario.m, own_of(scenario)
    seen: set[int] = set()
    for i, robot in enumerate(scenario.robots):
        here = f"robots[{i}]"
        if robot.id > n:
            yield f"{here}.id: expected 1 to {n}, got {robot.id}"
        if robot.id in seen:
            yield f"{here}.id: robot {robot.id} has been given before"
        seen.add(robot.id)
        if robot.plant:
            yield from _plant_faults(f"{here}.plant", robot.plant)
        if robot.controller:
            yield from _gain_faults(f"{here}.controller", robot.controller, m)
            yield from _law_faults(f"{here}.controller", own[robot.id].controller)
        if robot.disturbance:
            yield from _axes_faults(f"{here}.disturbance", robot.disturbance, m)


def _workers_faults(tls: TlsTable | None, n: int) -> Iterator[str]:
    """Yield what is wrong with the workers' names and robots; a robot has one worker."""
    taken: dict[int, str] = {}
    for worker, text in (tls.workers if tls else {}).items():
        here = f"bus.tls.workers.{worker}"
        try:
            expect_worker_name(worker, "bus.tls.workers")
            robots = parse_robots(text, here, n)
        except InputError as error:
            yield str(error)
            continue
        for robot in robots:
            if robot in taken:
                yield f"{here}: robot {robot} is already {quoted(taken[robot])}'s"
                break
            taken[robot] = worker


def _algorithm_faults(network: Network, choice: AlgorithmTable, liar: str = "") -> Iterator[str]:
    """Yield what is wrong with the algorithm of all, or with that by which a `liar.` lies."""
    if isinstance(choice, NotInstalled):
        return
    try:
        choice.loaded()  # it may not take these parameters together
    except InputError as error:
        yield f"{liar}{error}"
    apart = hetero_at(network)
    if apart and not takes_separate_graphs(choice.name):
        where = f"{liar}algorithm.name" if liar else f"{apart}.velocity"
        yield (
            f"{where}: {choice.name} receives positions and velocities over "
            f"one digraph; give {apart} one digraph, or take dcea1"
        )
    known = policies_of(choice.name)
    if choice.missing and choice.missing not in known:
        yield (
            f"{liar}algorithm.missing: expected one of {', '.join(known)}, which "
            f"{choice.name} knows, got {quoted(choice.missing)}"
        )


def _wrong_liars(experiment: Experiment, *, sized: bool) -> Iterator[str]:
    """Yield what is wrong with algorithms by which robots lie, and what they cannot send."""
    for i, entry in enumerate(experiment.scenario.faults.byzantine):
        if not entry.algorithm:
            continue
        here = f"faults.byzantine[{i}]"
        faults = [*_algorithm_faults(experiment.scenario.network, entry.algorithm, f"{here}.")]
        yield from faults
        if faults or not sized or not _sent(experiment):
            continue
        try:
            kind, honest = class_of(entry.algorithm.loaded()), class_of(experiment.algorithm)
        except InputError:  # not installed as it was recorded
            continue
        theirs, ours = (
            {name: field.size(experiment.sizes) for name, field in one.SENT.items()}
            for one in (kind, honest)
        )
        if theirs != ours:
            yield (
                f"{here}.algorithm.name: {entry.algorithm.name} sends {_fields(theirs)}, and the "
                f"others go by {_fields(ours)}; take one that sends the same"
            )
        elif kind.TRIGGERED and not honest.TRIGGERED:
            yield (
                f"{here}.algorithm.name: {entry.algorithm.name} decides when it sends, and the "
                f"others expect a sample at every t_k; take one that always sends"
            )


def _fields(shapes: Mapping[str, Shape]) -> str:
    return ", ".join(f"{name} {list(shape)}" for name, shape in shapes.items())


def unknown_variables(plant: Plant) -> Iterator[str]:
    """Yield which names of quantities are none of a plant's."""
    yield from (f"variables.{name}: {what}" for name in plant.variables if (what := unknown(name)))


def unknown(variable: str) -> str:
    """Say that a key of a plant's variables is no quantity of ours; nothing where it is one."""
    ours = [name for name in UNITS if name not in MOTION]
    return "" if variable in ours else f"no quantity of ours{nearest(variable, ours)}"


def _plant_faults(where: str, plant: Plant) -> Iterator[str]:
    yield from (f"{where}.{fault}" for fault in unknown_variables(plant))
    for name in ("step", "control_step"):
        given = getattr(plant, name)
        if given is not None and given < SHORTEST:
            yield f"{where}.{name}: expected at least {SHORTEST:g} s, got {given:g} s"
    for name in plant.parameters:
        if name in ELSEWHERE:
            yield f"{where}.parameters.{name}: give it as {ELSEWHERE[name]} instead"


def _gain_faults(where: str, controller: Any, m: int) -> Iterator[str]:
    for name, value in controller:
        if isinstance(value, tuple):
            yield from length_fault(
                f"{where}.{name}", value, m, "entries, one for each of the target's axes"
            )
            for i, row in enumerate(value):
                if isinstance(row, tuple):
                    yield from length_fault(f"{where}.{name}[{i}]", row, m, AXES)


def _law_faults(where: str, controller: Controller) -> Iterator[str]:
    """Yield which keys of a controller want, or exclude, others."""
    by_gains = [key for key in ("kp", "kd") if getattr(controller, key) is not None]
    if controller.frequency is None:
        for key in ("damping", "computed_torque"):
            if getattr(controller, key):
                yield f"{where}.{key}: has no use without {where}.frequency"
        if len(by_gains) < 2:
            yield f"{where}: expected kp and kd, or frequency"
        return
    if by_gains:
        yield f"{where}.{by_gains[0]}: cannot be given beside {where}.frequency"
    for key in ("gravity_compensation", "acceleration_feedforward"):
        if controller.computed_torque and getattr(controller, key):
            yield f"{where}.{key}: computed_torque has it already"


def _axes_faults(where: str, disturbance: Disturbance, m: int) -> Iterator[str]:
    if disturbance.axes:
        yield from length_fault(
            f"{where}.axes", disturbance.axes, m, "axes, one for each of the target's axes"
        )
