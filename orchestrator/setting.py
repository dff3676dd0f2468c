"""A scenario's numbers as arrays, a row a robot: what was drawn, and who has what of its own.

A draw is keyed by (seed, what is drawn, robot): it depends neither on the order in which robots
are built nor on where they run.
"""

from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from bus.topology import Topology
from estimator_agents.estimate import Estimate
from estimator_agents.target import Harmonic
from orchestrator.clock import Clock, nanoseconds
from orchestrator.scenario import Axis, Controller, Plant, Robot, Scenario, Uniform

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One robot's plant, its PD gains, its disturbance, and its state at t_0."""

    plant: Plant
    kp: Array
    """(m, m) N m/rad"""
    kd: Array
    """(m, m) N m s/rad"""
    disturbance: Harmonic
    """tau_d, N m"""
    q: Array
    """(m,) rad"""
    qd: Array
    """(m,) rad/s"""


def clock_of(scenario: Scenario) -> Clock:
    """Return the sampling times and the output grid of a scenario."""
    run = scenario.run
    period = nanoseconds(run.sampling_period)
    output = nanoseconds(run.output_step) if run.output_step else period
    return Clock(period, output, nanoseconds(run.duration) // period)


def topology_of(scenario: Scenario) -> Topology:
    """Return who hears whom."""
    return Topology.of(scenario.network.adjacency, scenario.network.pinning)


def target_of(scenario: Scenario) -> Harmonic:
    """Return the target's motion."""
    return harmonic(scenario.target.axes)


def initial_estimates(scenario: Scenario) -> Estimate:
    """Return ε_i(t_0) and υ_i(t_0), (n, m)."""
    return Estimate(_initial(scenario, "position"), _initial(scenario, "velocity"))


def bodies(scenario: Scenario) -> list[Body]:
    """Return each robot's plant and what it starts with, robot 1 first."""
    own = {robot.id: robot for robot in scenario.robots}
    q, qd = _initial(scenario, "q"), _initial(scenario, "qd")
    return [
        _body(scenario, own.get(robot, Robot(id=robot)), q[robot - 1], qd[robot - 1])
        for robot in range(1, scenario.n + 1)
    ]


def _body(scenario: Scenario, own: Robot, q: Array, qd: Array) -> Body:
    controller: Controller = own.controller or scenario.controller
    disturbance = own.disturbance or scenario.disturbance
    axes = disturbance.axes or (Axis(),) * scenario.m
    return Body(
        own.plant or scenario.plant,
        gain(controller.kp, scenario.m),
        gain(controller.kd, scenario.m),
        harmonic(axes),
        q,
        qd,
    )


def gain(value: float | tuple[float, ...] | tuple[tuple[float, ...], ...], m: int) -> Array:
    """Return a gain given as a number, m numbers, or m × m, as a matrix (m, m)."""
    given = np.asarray(value, float)
    return given if given.ndim == 2 else np.diag(np.broadcast_to(given, m))


def harmonic(axes: tuple[Axis, ...]) -> Harmonic:
    """Return a motion on m axes; a cosine is a sine a quarter turn ahead."""
    terms = [
        [(w.amplitude, w.frequency, w.phase) for w in axis.sines]
        + [(w.amplitude, w.frequency, w.phase + np.pi / 2) for w in axis.cosines]
        for axis in axes
    ]
    waves = np.zeros((3, len(axes), max(map(len, terms))))
    for i, axis_terms in enumerate(terms):
        if axis_terms:
            waves[:, i, : len(axis_terms)] = np.transpose(axis_terms)
    return Harmonic(np.array([a.offset for a in axes]), np.array([a.rate for a in axes]), *waves)


def _initial(scenario: Scenario, name: str) -> Array:
    """Return one of the four initial quantities of all robots, (n, m)."""
    given = getattr(scenario.initial, name)
    own = {robot.id: getattr(robot.initial, name) for robot in scenario.robots}
    rows = np.empty((scenario.n, scenario.m))
    for row, robot in enumerate(range(1, scenario.n + 1)):
        source = own.get(robot)
        if source is None:
            source = given if isinstance(given, Uniform) else given[row]
        if isinstance(source, Uniform):
            source = draw(scenario.run.seed, name, robot, source, scenario.m)
        rows[row] = source
    return rows


def draw(seed: int, purpose: str, robot: int, uniform: Uniform, m: int) -> Array:
    """Draw m numbers, uniform in [low, high), for one purpose and robot."""
    key = np.random.SeedSequence([seed, crc32(purpose.encode()), robot])
    low, high = uniform.uniform
    return low + (high - low) * np.random.Generator(np.random.Philox(key)).random(m)
