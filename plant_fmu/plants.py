"""Plants of one archive advance together, a row a robot: a reference in, states out.

Between two calls of `hold` each reference moves on as ε + (t − t_hold) υ, so nothing has to be
said in between, however often the states are asked for.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Start:
    """One robot's values before its run: parameters, states and reference, by variable name."""

    robot: int
    values: Mapping[str, Array]


class Plants(Protocol):
    """Some robots' plants, at one time.

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
