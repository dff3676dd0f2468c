"""An FMU's saved state is all of its state: a process that has only that goes on to the same bits.

What an FMU keeps elsewhere, or behind a pointer that it saves, is not there in another process.
"""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.checking.budget import Budget
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.isolation.isolated import IsolatedPlants
from nrs_cosim.plant_fmu.plants import Array, Body, Plants

STEP, INTERVALS, STEPS = 0.02, 5, 5
"""s; an interval has some steps, and as many intervals come before the checkpoint as after it."""
ASIDE = 0.1
"""rad, rad/s: how far the references lie from the robot's, to one side and to the other."""
DEADLINE = 10.0
"""s: of one call of the FMU in the other process."""


@dataclass(frozen=True, slots=True)
class Resumed:
    """How a plant went on in another process."""

    moved: float
    """By how much q and qd had changed from the start, rad or rad/s."""
    apart: float
    """max |difference| of q, qd and tau from there on; 0 where all bits are the same."""
    size: int
    """Of the checkpoint, bytes."""


def resumed(
    archive: Archive, body: Body, names: Mapping[str, Spec], driving: Driving, budget: Budget
) -> Resumed | None:
    """Save a plant, and let this and another process go on; None where the FMU cannot be saved."""
    with ExitStack() as stack:
        here = open_plants(stack, archive, [body], names, driving)
        if not here.checkpointable:
            return None
        start = _now(here)
        list(_run(here, body, 0, budget))
        saved, there = here.save(), _now(here)
        other = IsolatedPlants(stack, archive, [body], names, driving, DEADLINE)
        other.restore(saved)
        ours = np.array([there, *_run(here, body, INTERVALS, budget)])
        theirs = np.array([_now(other), *_run(other, body, INTERVALS, budget)])
        moved = np.abs(there - start)[:2].max()
        return Resumed(float(moved), float(np.abs(theirs - ours).max()), len(saved[0]))


def _run(plants: Plants, body: Body, first: int, budget: Budget) -> Iterator[Array]:
    """Yield q, qd and tau after each step of some intervals."""
    for k in range(first, first + INTERVALS):
        aside = ASIDE * (-1) ** k
        plants.hold((body.position + aside)[None], (body.velocity + aside)[None])
        for j in range(k * STEPS, (k + 1) * STEPS):
            plants.advance(j * STEP, STEP)
            budget.spend()
            yield _now(plants)


def _now(plants: Plants) -> Array:
    return np.stack([plants.q[0], plants.qd[0], plants.tau[0]])
