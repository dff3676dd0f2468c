"""Names that an FMU's description lets one propose are tried, and none is proposed that is refuted.

Right names move: a torque on each joint moves it, by an M that is symmetric, for of joints in
another order it is not; q changes by what q̇ adds up to; and a reference moves its own joint most.
"""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from enum import IntEnum

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.plant_fmu.archives.proposals import Proposal, as_line, proposals
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.checking.budget import Budget
from nrs_cosim.plant_fmu.checking.findings import CheckTask, Finding
from nrs_cosim.plant_fmu.checking.mechanics import TORQUE, MechanicsProbe, open_probe
from nrs_cosim.plant_fmu.checking.physics import TOLERANCE, asymmetry_of
from nrs_cosim.plant_fmu.checking.running import at_start
from nrs_cosim.plant_fmu.checking.starting import starting
from nrs_cosim.plant_fmu.drives.choice import choose, offers
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import StillError
from nrs_cosim.plant_fmu.plants import Array, Body

MOST = 12
"""Proposals that are tried."""
APART = 0.1
"""Of what q changes by, relative: how far it may be from what q̇ adds up to."""
ASIDE, RUN, STEPS = 0.1, 1.0, 100
"""rad: how far a reference is moved; s, in equal steps."""


class TrialResult(IntEnum):
    """What came of trying names."""

    REFUTED = 0
    STILL = 1
    UNTRIED = 2
    MOVES = 3


_SAID = {
    TrialResult.MOVES: "is right as far as it moves",
    TrialResult.UNTRIED: "may be right, but could not be tried ({})",
    TrialResult.STILL: "may be right, but as it starts {}",
}


def tried_proposals(task: CheckTask, budget: Budget) -> Iterator[Finding]:
    """Yield the best of the names that may be right for an FMU; nothing where all are refuted."""
    budget.begin("trying what its variables may be")
    best, found, tried, joints = TrialResult.REFUTED, list[tuple[str, Proposal]](), 0, 0
    for group in proposals(task.archive, task.names):
        if best is TrialResult.MOVES or tried >= MOST:
            break
        # Fewer joints than may be right are a part of a robot, which moves as well.
        if group[0].size < joints:
            continue
        tried += len(group)
        trials = [(guess, *_tried(replace(task, names=guess.names), budget)) for guess in group]
        likely = [t for t in trials if t[1] is TrialResult.MOVES or t[0].of_same_joints]
        outcome = max((outcome for _, outcome, _ in likely), default=TrialResult.REFUTED)
        if outcome > best:
            best = outcome
            found = [(why, guess.names) for guess, outcome, why in likely if outcome is best]
            joints = group[0].size
    for why, names in found:
        text = f"{_SAID[best].format(why)}, for the scenario's [plant]: {as_line(names)}"
        yield Finding("variables", "proposal", "note", text)


def _tried(task: CheckTask, budget: Budget) -> tuple[TrialResult, str]:
    """Return what comes of names, and why it is no more."""
    archive = task.archive
    try:
        offered = offers(archive, task.names)
        chosen = choose(archive, task.names, task.driving)
        body = task.body or at_start(archive, find_quantity(archive, "q", task.names))
        if started := starting(task, body, offered, chosen):
            task = replace(task, names={**task.names, **started.names})
        with ExitStack() as stack:
            if any(offer.way in TORQUE for offer in offered):
                probe = open_probe(stack, archive, body, task.names, offered, chosen)
                return _by_torques(MechanicsProbe(probe, body, budget))
        return _by_references(task, body, budget)
    except StillError as still:
        return TrialResult.STILL, str(still)
    except CosimError as error:
        return TrialResult.UNTRIED, str(error)


def _by_torques(mechanics: MechanicsProbe) -> tuple[TrialResult, str]:
    span = mechanics.spans[-1]
    if not asymmetry_of(mechanics.mobility(mechanics.start, span)) <= TOLERANCE:
        return TrialResult.REFUTED, "M is not symmetric"
    # No two joints are alike, so that those in another order are told.
    velocity = 1 + np.arange(len(mechanics.start)) / 4
    return _adding_up(*mechanics.motion(velocity, span))


def _by_references(task: CheckTask, body: Body, budget: Budget) -> tuple[TrialResult, str]:
    m = len(body.q)
    went = []
    for aside in ASIDE * np.eye(m + 1, m, -1):
        q, summed = _followed(task, body, aside, budget)
        outcome = _adding_up(q, summed)
        if outcome[0] is TrialResult.REFUTED:
            return outcome
        went.append(q)
    moved = np.array(went[1:]) - went[0]
    if not moved.any(axis=1).all():
        return TrialResult.STILL, "nothing moves by a reference"
    if (np.abs(moved).argmax(axis=1) != np.arange(m)).any():
        return TrialResult.REFUTED, "a reference moves another joint"
    return TrialResult.MOVES, ""


def _followed(task: CheckTask, body: Body, aside: Array, budget: Budget) -> tuple[Array, Array]:
    """Return how far q goes, (m,), where references are so far aside, and what q̇ adds up to."""
    with ExitStack() as stack:
        plants = open_plants(stack, task.archive, [body], task.names, task.driving)
        plants.hold((body.q + aside)[None], np.zeros((1, len(body.q))))
        velocities = [plants.qd[0].copy()]
        for k in range(STEPS):
            plants.advance(k * RUN / STEPS, RUN / STEPS)
            budget.spend()
            velocities.append(plants.qd[0].copy())
        return plants.q[0] - body.q, np.trapezoid(np.array(velocities), dx=RUN / STEPS, axis=0)


def _adding_up(went: Array, summed: Array) -> tuple[TrialResult, str]:
    """Judge how far q went, (m,), by what q̇ adds up to."""
    size = np.maximum(np.abs(went), np.abs(summed))
    if not (np.abs(went - summed) <= APART * size).all():
        return TrialResult.REFUTED, "qd is not the rate of q"
    return TrialResult.MOVES, ""
