"""Plants of one archive advance together, a row a robot: a reference in, states out.

Between two calls of `hold` each reference moves on as ε + s υ + s²/2 a, s = t − t_hold, so nothing
has to be said in between, however often the states are asked for.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Disturbance:
    """tau_d(t) = offset + rate t + Σ amplitude sin(frequency t + phase) on m axes, N m.

    Those of several robots are one with a first axis of rows before the shapes below.
    """

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

    @classmethod
    def stack(cls, rows: Sequence[Self]) -> Self:
        """Join robots' disturbances as rows; a row with fewer terms has zeros at its end."""
        terms = max(row.amplitude.shape[1] for row in rows)

        def padded(name: str) -> Array:
            waves = np.zeros((len(rows), len(rows[0].offset), terms))
            for row, into in zip(rows, waves, strict=True):
                own = getattr(row, name)
                into[:, : own.shape[1]] = own
            return waves

        return cls(
            np.array([row.offset for row in rows]),
            np.array([row.rate for row in rows]),
            *map(padded, ("amplitude", "frequency", "phase")),
        )

    def __bool__(self) -> bool:
        """Whether it is anything but zero at all times."""
        return bool(self.offset.any() or self.rate.any() or self.amplitude.any())


@dataclass(frozen=True, slots=True, eq=False)
class Control:
    """What the law has beside kp and kd, as the opening comment of controller.c writes it."""

    ki: Array | None = None
    """(m, m)"""
    torque_limit: Array | None = None
    """(m,) N m"""
    limited_by_effort: bool = False
    """Whether the limits are those in the FMU's URDF, which are not known here."""
    gravity_compensation: bool = False
    acceleration_feedforward: bool = False
    inertia_scaling: bool = False
    computed_torque: bool = False

    def values(self) -> dict[str, Array]:
        """Return what is on by the FMU's names: gains (m, m), limits (m,), and 1 of what is not."""
        arrays = {"ki": self.ki, "torque_limit": self.torque_limit}
        truths = ("gravity_compensation", "acceleration_feedforward", "inertia_scaling")
        return {
            **{name: value for name, value in arrays.items() if value is not None},
            **{name: np.ones(1) for name in (*truths, "computed_torque") if getattr(self, name)},
        }

    def wanted(self) -> set[str]:
        """Return the names of what is on and not zero: a law without it would be another."""
        return {name for name, value in self.values().items() if value.any()}


PD_ALONE = Control()


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
    control: Control = PD_ALONE


def called(robot: int) -> str:
    """Return what a node is called: a robot, or the target, which is node 0."""
    return f"robot {robot}" if robot else "target"


NOTHING: Mapping[str, Array] = MappingProxyType({})
"""What starts beside q and qd, by our names, where nothing does."""


class Plants(Protocol):
    """Some robots' plants, at one time; a row a robot.

    `q`, `qd` and `tau` (rows, m) are their positions, rad or m, velocities, rad/s or m/s, and
    torques then, N m or N: those of the PD law alone. They are views that the next `advance`
    overwrites.
    """

    q: Array
    qd: Array
    tau: Array

    def hold(self, *reference: Array) -> None:
        """Take new references (rows, m) from now on: ε_i(t⁺), υ_i(t⁺), in the units of q and qd.

        With a third, their acceleration, they are no lines.
        """

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s; `StepError` names the robot, FMU, time and cause."""


class Checkpointed(Protocol):
    """What can be put back to where it was, in this or in another process, a row a robot.

    A checkpoint is taken after an `advance` and before the next `hold`, and what follows it is the
    same to the last bit. A robot's is its own: robots that were saved together may go on apart, and
    the other way round. What is not `checkpointable` has none, and must not be asked for one.
    """

    checkpointable: bool
    """Whether all FMUs claim that their states can be saved, which `nrs fmu check` tries."""

    def save(self) -> list[bytes]:
        """Return each robot's checkpoint; `StepError` names the robot whose FMU refuses."""

    def restore(self, data: Sequence[bytes]) -> None:
        """Put each robot back to a checkpoint of one of the same FMU, driven likewise.

        `FmuError` where that was of another FMU, and where they are not all of one time.
        """


class DrivenPlants(Plants, Checkpointed, Protocol):
    """Plants of one archive, with what is told to the user of how they are driven."""

    kind: str
    """The FMI interface: CoSimulation or ModelExchange."""
    drive: str
    why: str
