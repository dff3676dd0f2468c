"""Whether a robot runs alone, and goes on from its saved state in another process.

Without a scenario it stands at the FMU's start values, and its gains are fitted to its inertia. A
saved state is all of a state: a process that has only that goes on to the same bits. What an FMU
keeps elsewhere, or behind a pointer that it saves, is not there in another process.
"""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.quantities import TYPES, NumberLayout, Quantity
from nrs_cosim.plant_fmu.checking.budget import Budget, OverBudgetError
from nrs_cosim.plant_fmu.checking.findings import CheckTask, Finding, FindingStatus
from nrs_cosim.plant_fmu.checking.mechanics import MechanicsProbe
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.drives.probe import MOVED
from nrs_cosim.plant_fmu.errors import UnstableStepError
from nrs_cosim.plant_fmu.isolation.isolated import IsolatedPlants
from nrs_cosim.plant_fmu.plants import Array, Body, Disturbance, Plants

PACE = 5.0
"""rad/s, of the critically damped motion to which the gains of a lone run are fitted."""
RUN, STEPS = 1.0, 100
"""s, in equal steps."""
ASIDE = 0.1
"""rad, rad/s: how far references lie from a robot's start, so that it moves."""
DIVERGED = 1e6
"""rad: beyond so far from its start in a run of a second a robot has diverged."""
STIFF = 1e3
"""1/s: a rate that makes equations costly to integrate."""


def at_start(archive: Archive, q: Quantity) -> Body:
    """Return a robot at rest at the FMU's start values, with gains of 1."""
    declared = {
        v.valueReference: v.start
        for v in archive.description.modelVariables
        if v.type in TYPES and v.start
    }
    theirs: list[float] = []
    for reference in NumberLayout.of([q]).references:
        length = next(part.length for part in q.parts if part.reference == reference)
        numbers: list[float] = []
        with suppress(ValueError):
            numbers = [float(number) for number in declared.get(reference, "").split()]
        theirs += numbers if len(numbers) == length else [*(numbers[:1] or [0.0])] * length
    layout, m = NumberLayout.of([q]), q.size
    start, none, one = layout.factor * np.array(theirs)[layout.index], np.zeros(m), np.eye(m)
    still = Disturbance(none, none, *np.zeros((3, m, 0)))
    return Body(1, {}, one, one, still, q=start, qd=none, position=start, velocity=none)


def fitted(mechanics: MechanicsProbe, body: Body) -> Body | None:
    """Return a robot whose gains are critically damped at its inertia; None if it has none."""
    try:
        mobility = mechanics.mobility(body.q, mechanics.spans[0])
        mass: Array = np.asarray(np.linalg.inv((mobility + mobility.T) / 2), float)
        fits = bool(np.linalg.eigvalsh(mass)[0] > 0)
    except (CosimError, np.linalg.LinAlgError):
        return None
    return replace(body, kp=PACE**2 * mass, kd=2 * PACE * mass) if fits else None


def slowness(mechanics: MechanicsProbe) -> str:
    """Return why a plant is costly to step, as the end of a sentence; nothing where it is not."""
    try:
        rate = mechanics.damping_rate(mechanics.start, mechanics.spans[-1])
    except CosimError:
        return ""
    if not rate > STIFF:
        return ""
    return (
        f"; it is stiff: damping (kd and its own) over the least inertia is {rate:.1g} per s; "
        "give each joint a gain or damping of its size"
    )


def running(task: CheckTask, body: Body, known: bool, budget: Budget, why_slow: str) -> Finding:
    """Run one robot alone, its reference at its start unless a scenario says otherwise.

    Where nothing moves that shows nothing: it runs on as long with its reference aside. Gains that
    are not `known` to suit the robot make no failure of its.
    """
    guess = "" if known else "; its gains are a guess, for its inertia is not known"

    def finding(status: FindingStatus, text: str, value: float | None = None) -> Finding:
        return Finding("runs", "alone", status, text, value)

    moved, end, length, how = 0.0, 0.0, RUN, ""
    try:
        with ExitStack() as stack:
            plants = open_plants(stack, task.archive, [body], task.names, task.driving)
            for j in range(2 * STEPS):
                if j == STEPS:
                    if moved > MOVED:
                        break
                    length, how = 2 * RUN, f", its reference {ASIDE:g} aside from {RUN:g} s on"
                    plants.hold((body.position + ASIDE)[None], body.velocity[None])
                plants.advance(j * RUN / STEPS, RUN / STEPS)
                moved = max(moved, float(np.abs(plants.q[0] - body.q).max()))
                end = (j + 1) * RUN / STEPS
                if moved > DIVERGED:
                    break
                budget.spend()
    except OverBudgetError as over:
        return finding("unknown", f"{over}, at t = {end:g} s of {length:g} s{why_slow}")
    except UnstableStepError as error:
        return finding("fails" if known else "unknown", f"{error}{guess}")
    except CosimError as error:
        return finding("fails", str(error))
    if moved > DIVERGED:
        text = f"diverges by {plants.drive}: {moved:.3g} from its start at t = {end:g} s{guess}"
        return finding("fails" if known else "unknown", text, moved if isfinite(moved) else None)
    if moved <= MOVED:
        return finding("unknown", "it does not move, nor after its reference", moved)
    text = f"{length:g} s by {plants.drive}{how}: finite, up to {moved:.3g} from its start"
    return finding("holds", text, moved)


def resuming(task: CheckTask, body: Body, budget: Budget, why_slow: str) -> Finding:
    """Save the robot, and go on in another process."""

    def finding(status: FindingStatus, text: str, value: float | None = None) -> Finding:
        return Finding("runs", "resumed", status, text, value)

    try:
        found = resumed(task.archive, body, task.names, task.driving, budget)
    except OverBudgetError as over:
        return finding("unknown", f"{over}{why_slow}")
    except CosimError as error:
        return finding("fails", f"it claims that its state can be saved: {error}")
    if found is None:
        return finding("note", "it does not claim that its state can be saved")
    if not found.moved:
        return finding("unknown", "it does not move, whatever its reference")
    if found.apart:
        return finding(
            "fails",
            f"another process goes on from its saved state otherwise, by up to {found.apart:.2g}: "
            "it has more state than it saves",
            found.apart if isfinite(found.apart) else None,
        )
    text = f"another process goes on from its {found.size} bytes to the same bits"
    return finding("holds", text, 0.0)


INTERVALS, PARTS, PART = 5, 5, 0.02
"""As many come before a checkpoint as after it; the steps of each; s, of a step."""
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
        for j in range(k * PARTS, (k + 1) * PARTS):
            plants.advance(j * PART, PART)
            budget.spend()
            yield _now(plants)


def _now(plants: Plants) -> Array:
    return np.stack([plants.q[0], plants.qd[0], plants.tau[0]])
