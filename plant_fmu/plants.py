"""Plants of one archive advance together, a row a robot: a reference in, states out.

Between two calls of `hold` each reference moves on as ε + (t − t_hold) υ, so nothing has to be
said in between, however often the states are asked for.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Disturbance:
    """tau_d(t) = offset + rate t + Σ amplitude sin(frequency t + phase) on m axes, N m."""

    offset: Array
    """(m,)"""
    rate: Array
    """(m,) per second"""
    amplitude: Array
    """(m, p)"""
    frequency: Array
    """(m, p) rad/s"""
    phase: Array
    """(m, p) rad"""

    def __bool__(self) -> bool:
        """Whether it is anything but zero at all times."""
        return bool(self.offset.any() or self.rate.any() or self.amplitude.any())

    def at(self, seconds: float) -> Array:
        """Return tau_d, (m,)."""
        waves = self.amplitude * np.sin(self.frequency * seconds + self.phase)
        torque: Array = self.offset + self.rate * seconds + waves.sum(axis=1)
        return torque


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One robot at t_0: what its plant is told before its run."""

    robot: int
    parameters: Mapping[str, Any]
    """Of the FMU, by its own names: numbers, arrays, truths, texts."""
    kp: Array
    """(m, m) N m/rad"""
    kd: Array
    """(m, m) N m s/rad"""
    disturbance: Disturbance
    q: Array
    """(m,) rad"""
    qd: Array
    """(m,) rad/s"""
    position: Array
    """(m,) ε_i(t_0), rad"""
    velocity: Array
    """(m,) υ_i(t_0), rad/s"""


class Plants(Protocol):
    """Some robots' plants, at one time; a row a robot.

    `q`, `qd` and `tau` (rows, m) are their positions, velocities and applied torques then; they
    are views that the next `advance` overwrites.
    """

    q: Array
    qd: Array
    tau: Array

    def hold(self, position: Array, velocity: Array) -> None:
        """Take new references (rows, m) from now on: ε_i(t⁺), υ_i(t⁺)."""

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s; `StepError` names the robot, FMU, time and cause."""
