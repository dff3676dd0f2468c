"""A scenario's numbers as arrays, a row a robot: what was drawn, and who has what of its own.

A draw is keyed by (seed, what is drawn, robot): it depends neither on the order in which robots
are built nor on where they run.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.links.links import LinkFault, Links
from nrs_cosim.bus.links.outages import Outages
from nrs_cosim.bus.topologies import Topologies
from nrs_cosim.estimator_agents.algorithm import Algorithm, load_algorithm, policies_of
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.hearing import Missing
from nrs_cosim.estimator_agents.target import Harmonic, Sampled, Target
from nrs_cosim.orchestrator.scenario import networks, times
from nrs_cosim.orchestrator.scenario.chance import chance
from nrs_cosim.orchestrator.scenario.clock import Clock
from nrs_cosim.orchestrator.scenario.faults import link_faults, silences
from nrs_cosim.orchestrator.scenario.own import controller_of, disturbance_of, plant_of
from nrs_cosim.orchestrator.scenario.tables.fmus import Name, Pattern
from nrs_cosim.orchestrator.scenario.tables.scenario import Robot, Scenario
from nrs_cosim.orchestrator.scenario.tables.targets import Axis, FmuTarget, SampledTarget
from nrs_cosim.orchestrator.scenario.tables.values import Uniform
from nrs_cosim.plant_fmu.archives import naming
from nrs_cosim.plant_fmu.plants import Body, Disturbance

Array = NDArray[np.float64]


def clock_of(scenario: Scenario) -> Clock:
    """Return the sampling times and the output grid of a scenario."""
    return times.clock(scenario.run)


def topologies_of(scenario: Scenario) -> Topologies:
    """Return who hears whom, and when; it is made once."""
    return networks.topologies_of(scenario)


def target_of(scenario: Scenario) -> Target:
    """Return the target's motion."""
    given = scenario.target
    if isinstance(given, SampledTarget):
        return Sampled.of(given.times, given.positions)
    if isinstance(given, FmuTarget):
        return Sampled.through(given.times, given.positions, given.velocities)
    return Harmonic(*terms(given.axes))


def links_of(scenario: Scenario, robots: NDArray[np.integer]) -> Links | None:
    """Return the faults on the links into some robots; None if the scenario has none at all."""
    topologies = topologies_of(scenario)
    faults, quiet = link_faults(scenario, topologies.links), silences(scenario)
    if not quiet and all(fault == LinkFault() for fault in faults.values()):
        return None
    ticks, seed = clock_of(scenario), scenario.run.seed
    return Links(topologies, robots, faults, quiet, ticks=ticks, seed=seed, m=scenario.m)


def has_faults(scenario: Scenario) -> bool:
    """Return whether a link or a robot has faults."""
    return links_of(scenario, np.arange(1, scenario.n + 1)) is not None


def silent_of(scenario: Scenario) -> Callable[[int], NDArray[np.intp]]:
    """Return which robots send nothing, ascending, by the tick."""
    return Outages.of(silences(scenario), clock_of(scenario).since).at


def faulty_of(scenario: Scenario) -> list[int]:
    """Return the robots that may meet faults on the links into them, ascending."""
    links = links_of(scenario, np.arange(1, scenario.n + 1))
    return np.unique(links.sink).tolist() if links else []


def algorithm_of(scenario: Scenario) -> Algorithm:
    """Return the estimator with its gains."""
    choice = scenario.algorithm
    return load_algorithm(choice.name, choice.alpha, choice.beta)


def missing_of(scenario: Scenario) -> Missing:
    """Return what an agent does without a neighbour's sample."""
    return scenario.algorithm.missing or policies_of(scenario.algorithm.name)[0]


def initial_estimates(scenario: Scenario, robots: Sequence[int] | None = None) -> Estimate:
    """Return ε_i(t_0) and υ_i(t_0), (rows, m), of some robots or of all."""
    position, velocity = (_initial(scenario, name, robots) for name in ("position", "velocity"))
    return Estimate(position, velocity)


def bodies(scenario: Scenario, robots: Sequence[int] | None = None) -> list[Body]:
    """Return what each of some robots starts with, or of all."""
    own = {robot.id: robot for robot in scenario.robots}
    names = ("q", "qd", "position", "velocity")
    start = {name: _initial(scenario, name, robots) for name in names}
    return [
        _body(
            scenario,
            own.get(robot, Robot(id=robot)),
            {name: rows[row] for name, rows in start.items()},
        )
        for row, robot in enumerate(_those(scenario, robots))
    ]


def _body(scenario: Scenario, own: Robot, start: dict[str, Array]) -> Body:
    controller, disturbance = controller_of(scenario, own), disturbance_of(scenario, own)
    return Body(
        robot=own.id,
        parameters=plant_of(scenario, own).parameters,
        kp=gain(controller.kp, scenario.m),
        kd=gain(controller.kd, scenario.m),
        disturbance=Disturbance(*terms(disturbance.axes or (Axis(),) * scenario.m)),
        **start,
    )


def names_of(variables: Mapping[str, Name]) -> dict[str, naming.Spec]:
    """Return what a scenario gives for quantities of ours, as FMUs are searched for it."""
    return {
        ours: naming.Pattern(name.pattern, name.base) if isinstance(name, Pattern) else name
        for ours, name in variables.items()
    }


def gain(value: float | tuple[float, ...] | tuple[tuple[float, ...], ...], m: int) -> Array:
    """Return a gain given as a number, m numbers, or m × m, as a matrix (m, m)."""
    given = np.asarray(value, float)
    return given if given.ndim == 2 else np.diag(np.broadcast_to(given, m))


def terms(axes: tuple[Axis, ...]) -> tuple[Array, ...]:
    """Return offset and rate (m,); amplitude, frequency and phase (m, p).

    A cosine is a sine a quarter turn ahead.
    """
    terms = [
        [(w.amplitude, w.frequency, w.phase) for w in axis.sines]
        + [(w.amplitude, w.frequency, w.phase + np.pi / 2) for w in axis.cosines]
        for axis in axes
    ]
    waves = np.zeros((3, len(axes), max(map(len, terms))))
    for i, axis_terms in enumerate(terms):
        if axis_terms:
            waves[:, i, : len(axis_terms)] = np.transpose(axis_terms)
    return np.array([a.offset for a in axes]), np.array([a.rate for a in axes]), *waves


def _those(scenario: Scenario, robots: Sequence[int] | None) -> Sequence[int]:
    return range(1, scenario.n + 1) if robots is None else robots


def _initial(scenario: Scenario, name: str, robots: Sequence[int] | None) -> Array:
    """Return one of the four initial quantities, (rows, m), of some robots or of all."""
    those = _those(scenario, robots)
    given = getattr(scenario.initial, name)
    own = {robot.id: getattr(robot.initial, name) for robot in scenario.robots}
    rows = np.empty((len(those), scenario.m))
    for row, robot in enumerate(those):
        source = own.get(robot)
        if source is None:
            source = given[robot - 1] if _is_matrix(given) else given
        if isinstance(source, Uniform):
            source = draw(scenario.run.seed, name, robot, source, scenario.m)
        rows[row] = source
    return rows


def _is_matrix(given: Any) -> bool:
    return isinstance(given, tuple) and any(isinstance(row, tuple) for row in given)


def draw(seed: int, purpose: str, robot: int, uniform: Uniform, m: int) -> Array:
    """Draw m numbers, uniform in [low, high), for one purpose and robot."""
    low, high = uniform.uniform
    return low + (high - low) * chance(seed, purpose, robot).random(m)
