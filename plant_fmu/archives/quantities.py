"""A quantity of ours is some numbers of an FMU's variables: ours = factor · theirs[index].

Values are always passed flat, in row-major order, so that scalars (FMI 2) and arrays (FMI 3) look
alike. An array can only be passed whole, with those of its numbers that are not ours.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

MOTION = ("position", "velocity")
"""What is looked for in a target; all else is a robot's."""
TYPES = frozenset({"Real", "Float64"})
"""Of the variables that a quantity may be. FMI 2.0 counts references anew for each type."""
UNITS = {
    **dict.fromkeys(("q", "q_start", "position_ref", "position"), ("rad", "m")),
    **dict.fromkeys(("qd", "qd_start", "velocity_ref", "velocity"), ("rad/s", "m/s")),
    "acceleration_ref": ("rad/s2", "m/s2"),
    "reference_time": ("s",),
    **dict.fromkeys(("tau", "tau_applied"), ("N.m", "N")),
    **dict.fromkeys(("disturbance_offset", "disturbance_amplitude"), ("N.m", "N")),
    "disturbance_rate": ("N.m/s", "N/s"),
    "disturbance_frequency": ("rad/s",),
    "disturbance_phase": ("rad",),
    "kp": ("N.m/rad", "N/m"),
    "kd": ("N.m.s/rad", "N.s/m"),
}
"""What our quantities are in, of revolute and of prismatic joints."""
INTEGRALS = {"qd": "q", "velocity": "position"}
STARTS = {"q": "q_start", "qd": "qd_start"}
"""What is told to an FMU whose q or qd starts where other variables say, if they are named."""


@dataclass(frozen=True, slots=True)
class Part:
    """Some successive numbers of a variable; times the factor they are in SI."""

    reference: int
    length: int
    """Of the whole variable."""
    first: int
    size: int
    factor: float
    start: tuple[float, ...]
    """Of the whole variable, for the numbers that are not ours; empty when all are."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """The FMU's numbers that stand for one quantity of ours."""

    name: str
    parts: tuple[Part, ...]

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return sum(part.size for part in self.parts)


@dataclass(frozen=True, slots=True, eq=False)
class NumberLayout:
    """Where the numbers of quantities stand among those of their variables, each taken once.

    ours = factor * theirs[index], with `theirs` flat over the variables.
    """

    references: tuple[int, ...]
    start: NDArray[np.float64]
    """(length,) of theirs: the start values of what is not ours, else 0."""
    index: NDArray[np.intp]
    """(size,)"""
    factor: NDArray[np.float64]
    """(size,)"""

    @classmethod
    def of(cls, quantities: Iterable[Quantity]) -> Self:
        """Lay out quantities one after another."""
        parts = [part for quantity in quantities for part in quantity.parts]
        offsets: dict[int, int] = {}
        start: list[float] = []
        for part in parts:
            if part.reference not in offsets:
                offsets[part.reference] = len(start)
                start += part.start or [0.0] * part.length
        firsts = [offsets[part.reference] + part.first for part in parts]
        return cls(
            tuple(offsets),
            np.array(start, float),
            np.concatenate(
                [np.arange(first, first + p.size) for first, p in zip(firsts, parts, strict=True)]
            ),
            np.repeat([part.factor for part in parts], [part.size for part in parts]),
        )

    @property
    def is_direct(self) -> bool:
        """Whether ours are theirs, number by number."""
        return np.array_equal(self.index, np.arange(len(self.start))) and bool(
            (self.factor == 1.0).all()
        )

    @property
    def is_complete(self) -> bool:
        """Whether all of theirs are among ours."""
        return bool(np.bincount(self.index, minlength=len(self.start)).all())


class View:
    """Rows of ours (robots, numbers), and the FMUs' own numbers that they stand for."""

    def __init__(self, quantities: Iterable[Quantity], ours: NDArray[np.float64]) -> None:
        # C has the address of `theirs`: it is filled, and never replaced.
        layout = NumberLayout.of(quantities)
        self._ours, self._layout = ours, layout
        self.is_direct, self.is_complete = layout.is_direct, layout.is_complete
        self.references = layout.references
        self.theirs = ours if self.is_direct else np.tile(layout.start, (len(ours), 1))
        """(robots, numbers): what is passed; ours themselves where the FMUs have just these."""

    def in_units(self, ours: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ours (numbers,) in the units of theirs, number by number."""
        return ours / self._layout.factor

    def give(self) -> None:
        """Bring ours into theirs."""
        if not self.is_direct:
            self.theirs[:, self._layout.index] = self._ours / self._layout.factor

    def take(self) -> None:
        """Bring theirs into ours."""
        if not self.is_direct:
            np.multiply(self.theirs[:, self._layout.index], self._layout.factor, out=self._ours)
