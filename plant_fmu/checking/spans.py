"""Over what spans a plant's accelerations are found, as its own steps and rates let them be.

An FMU may integrate by steps of its own, d: then q̇ is a staircase, of which five numbers tell q̈
only where a span is a multiple of d. An importer may ask for steps of d alone where the FMU
declares them; elsewhere the jumps of q̇ are found, and it is looked at midway between two of them,
where rounding moves none over. Without steps of its own a plant may be fast, as
light links with damping are: a span is short enough once one of a quarter finds the same.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.errors import FmuError, StillError
from nrs_cosim.plant_fmu.fmi.library import Kind
from nrs_cosim.plant_fmu.plants import Array

LONGEST, SHORTEST = 4e-3, 1e-3
"""s, between two of the velocities of which an acceleration is found, where nothing asks for less.
What is wrong with an FMU is wrong at each; an error of the probing itself is not."""
FINER, TRIALS = 8, 5
"""How much shorter the next spans are that are tried, and how often."""
AGREEMENT = 3e-3
"""Of the accelerations by two spans, relative to the largest."""
WATCHED, FINEST, PATIENCE = 64, 1e-6, 2.0
"""Steps for which q̇ is watched; s, of the first; s, after which nothing is taken to move."""
FEWEST, HALVINGS = 4, 32
"""Jumps of q̇ from which its step is told, and how often the time of one is halved."""


@dataclass(frozen=True, slots=True)
class Staircase:
    """The steps in which an FMU moves; all 0 for one that moves smoothly."""

    internal: float = 0.0
    """s, of its own"""
    lead: float = 0.0
    """s, after which q̇ is first looked at"""

    def spans(self) -> Iterator[tuple[float, float]]:
        """Yield pairs of spans to try, in s."""
        if self.internal:
            yield 2 * self.internal, self.internal
            return
        for j in range(TRIALS):
            yield LONGEST / FINER**j, SHORTEST / FINER**j


SMOOTH = Staircase()

Velocities = Callable[[float, int], Array]
"""(step in s, steps) → q̇, (steps + 1, m or more)"""


def staircase(archive: Archive, kind: Kind, velocities: Velocities) -> Staircase:
    """Return in what steps an FMU moves; `FmuError` where it does not.

    `velocities` returns q̇ from rest under torques, at 0 and after each of so many steps in s.
    """
    if kind == "ModelExchange":
        return SMOOTH
    declared = _declared(archive)
    step = declared or FINEST
    while step * WATCHED <= max(PATIENCE, declared * WATCHED):
        moving = velocities(step, WATCHED)
        changed = np.flatnonzero((np.diff(moving, axis=0) != 0).any(axis=1))
        if len(changed) and declared:
            return Staircase(declared)
        # q̇ changes in each of the steps: if it has steps of its own, they are shorter still.
        if len(changed) > 1 and np.diff(changed).max() == 1:
            return SMOOTH
        if len(changed) >= FEWEST:
            first, last = (_jump(velocities, step * at, step * (at + 1)) for at in changed[[0, -1]])
            internal = (last - first) / (len(changed) - 1)
            # Midway between two jumps: whatever the times are rounded to, none is moved over.
            return Staircase(internal, (first + internal / 2) % internal)
        step *= 2
    raise StillError(
        f"nothing moves within {WATCHED * step / 2:.2g} s under a torque of 1 or -1 on every "
        "joint; has it a longer internal step?"
    )


def _jump(velocities: Velocities, low: float, high: float) -> float:
    """Return when q̇ jumps between two times in s, by halving."""
    before = velocities(low, 1)[1] if low else velocities(high, 1)[0]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        if (velocities(middle, 1)[1] == before).all():
            low = middle
        else:
            high = middle
    return high


def _declared(archive: Archive) -> float:
    """Return the step that an FMU declares to take, or without which it cannot; else 0."""
    description = archive.description
    if description.coSimulation and description.coSimulation.fixedInternalStepSize:
        return float(description.coSimulation.fixedInternalStepSize)
    usual = description.defaultExperiment.stepSize if description.defaultExperiment else None
    return float(usual) if usual and not archive.takes_uneven_steps else 0.0


def agreeing(
    stairs: Staircase, measure: Callable[[float], Array]
) -> tuple[tuple[float, float], Array]:
    """Return the first pair of spans, s, that find the same array (…), and that.

    `FmuError` where none do.
    """
    apart = np.inf
    for spans in stairs.spans():
        longer, shorter = map(measure, spans)
        size = np.abs(shorter).max()
        if not size > 0:
            raise StillError(
                "nothing moves, whatever the torque; if it takes one, see the finding on its reset"
            )
        apart = np.abs(longer - shorter).max() / size
        if apart <= AGREEMENT:
            return spans, shorter
    why = (
        f"its internal step of {stairs.internal:.3g} s is too long"
        if stairs.internal
        else "it has steps of its own, or moves too fast"
    )
    raise FmuError(
        f"its accelerations over {spans[0]:.3g} s and over {spans[1]:.3g} s differ by "
        f"{apart:.2g} of the largest: {why} for them to be found"
    )
