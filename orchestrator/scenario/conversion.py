"""What tables of a scenario are to the other packages: arrays, motions, names of quantities."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.target import Harmonic, Sampled, Target
from nrs_cosim.orchestrator.scenario.tables.fmus import Name, Pattern
from nrs_cosim.orchestrator.scenario.tables.scenario import Controller
from nrs_cosim.orchestrator.scenario.tables.targets import (
    Axis,
    FmuMotion,
    HarmonicTarget,
    SampledTarget,
    TargetMotion,
)
from nrs_cosim.plant_fmu.archives import families
from nrs_cosim.plant_fmu.plants import Control

Array = NDArray[np.float64]
EFFORT = "effort"
"""The torque limits that a URDF has."""


def motion_of(target: TargetMotion) -> Target:
    """Return a target's motion; `ValueError` where no curve leads through its samples."""
    if isinstance(target, SampledTarget):
        return Sampled.of(target.times, target.positions)
    if isinstance(target, FmuMotion):
        return Sampled.through(target.times, target.positions, target.velocities)
    assert isinstance(target, HarmonicTarget)  # a scenario's FMU was run when it was resolved
    return Harmonic(*terms(target.axes))


def names_of(variables: Mapping[str, Name]) -> dict[str, families.Spec]:
    """Return what a scenario gives for quantities of ours, as FMUs are searched for it."""
    return {
        ours: families.NamePattern(name.pattern, name.base) if isinstance(name, Pattern) else name
        for ours, name in variables.items()
    }


def gain(value: float | tuple[float, ...] | tuple[tuple[float, ...], ...], m: int) -> Array:
    """Return a gain given as a number, m numbers, or m × m, as a matrix (m, m)."""
    given = np.asarray(value, float)
    return given if given.ndim == 2 else np.diag(np.broadcast_to(given, m))


def gains(controller: Controller, m: int) -> tuple[Array, Array]:
    """Return kp and kd, (m, m): of a frequency those of a unit inertia."""
    if controller.frequency is None:
        return gain(controller.kp or 0.0, m), gain(controller.kd or 0.0, m)
    w = np.broadcast_to(controller.frequency, m)
    damping = 1.0 if controller.damping is None else controller.damping
    return np.diag(w**2), np.diag(2 * np.asarray(damping, float) * w)


def control(controller: Controller, m: int) -> Control:
    """Return what a controller has beside kp and kd."""
    limit = controller.torque_limit
    return Control(
        ki=None if controller.ki is None else gain(controller.ki, m),
        torque_limit=(
            None if limit is None or limit == EFFORT else np.broadcast_to(limit, m).astype(float)
        ),
        limited_by_effort=limit == EFFORT,
        gravity_compensation=controller.gravity_compensation,
        acceleration_feedforward=controller.acceleration_feedforward,
        inertia_scaling=controller.frequency is not None,
        computed_torque=controller.computed_torque,
    )


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
