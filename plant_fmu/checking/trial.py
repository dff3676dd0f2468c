"""Names that an FMU's description lets one propose are tried, and none is proposed that is refuted.

Right names move: a torque on each joint moves it; q goes as far as q̇ adds up to; and M is symmetric
and positive definite at all postures that a check looks at, as it is not of joints in another order
or of a torque of the other sign. A reference moves its own joint most.
"""

from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from enum import IntEnum
from itertools import takewhile

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.proposals import Guess, Proposal, as_line, entries_of, proposals
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.checking.budget import Budget
from nrs_cosim.plant_fmu.checking.findings import CheckTask, Finding
from nrs_cosim.plant_fmu.checking.mechanics import TORQUE, MechanicsProbe, open_probe
from nrs_cosim.plant_fmu.checking.physics import physics
from nrs_cosim.plant_fmu.checking.rates import ASIDE, judged, path_followed
from nrs_cosim.plant_fmu.checking.running import at_start
from nrs_cosim.plant_fmu.checking.starting import starting
from nrs_cosim.plant_fmu.drives.choice import choose, offers
from nrs_cosim.plant_fmu.drives.reference_driven import REFERENCE
from nrs_cosim.plant_fmu.errors import FmuError, StillError
from nrs_cosim.plant_fmu.plants import Body

MOST = 12
"""Proposals that are tried."""
_SIZED = ("qd", "tau", *REFERENCE)
OF_NAMES = ("rate", "M symmetric", "M positive definite")
"""What a check holds of mechanics that wrong names spoil; what else is amiss is the FMU's."""


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
    """Yield the best of the names that may be right for an FMU, after what of the first is not so.

    Where all are refuted, or none is found, that is said.
    """
    budget.begin("trying what its variables may be")
    task = replace(task, names=dict(_there(task)))
    best, found, tried, joints = TrialResult.REFUTED, list[tuple[str, Proposal]](), 0, 0
    first: tuple[Guess, TrialResult, str] | None = None
    for group in proposals(task.archive, task.names):
        if best is TrialResult.MOVES or tried >= MOST:
            break
        # Fewer joints than may be right are a part of a robot, which moves as well.
        if group[0].size < joints:
            continue
        tried += len(group)
        trials = [(guess, *_tried(replace(task, names=guess.names), budget)) for guess in group]
        first = first or trials[0]
        likely = [t for t in trials if t[1] is TrialResult.MOVES or t[0].of_same_joints]
        outcome = max((outcome for _, outcome, _ in likely), default=TrialResult.REFUTED)
        if outcome > best:
            best = outcome
            found = [(why, guess.names) for guess, outcome, why in likely if outcome is best]
            joints = group[0].size
    if first and first[0].size > joints:
        guess, _, why = first
        of = f"none of {guess.size} joints" if found else "none"
        why = why or "names tell that they are of different joints"
        text = f"{of}: with {entries_of(guess.names)}, {why}"
        yield Finding("variables", "proposal", "note", text)
    elif not found:
        what = "q, qd and tau, nor as q, qd and two references"
        text = f"none: by names, units and derivatives no variables go together as {what}"
        yield Finding("variables", "proposal", "note", text)
    for why, names in found:
        text = f"{_SAID[best].format(why)}, for the scenario's [plant]: {as_line(names)}"
        yield Finding("variables", "proposal", "note", text)


def _there(task: CheckTask) -> Iterator[tuple[str, Spec]]:
    """Yield the names that were given and that the FMU has, as many as q has joints."""
    m = None
    with suppress(FmuError):
        m = find_quantity(task.archive, "q", task.names).size
    for ours, spec in task.names.items():
        with suppress(FmuError):
            find_quantity(task.archive, ours, task.names, size=m if ours in _SIZED else None)
            yield ours, spec


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
    for finding in takewhile(lambda finding: finding.name in OF_NAMES, physics(mechanics, "")):
        if finding.status == "fails":
            return TrialResult.REFUTED, f"{finding.name} does not hold: {finding.text}"
    return TrialResult.MOVES, ""


def _by_references(task: CheckTask, body: Body, budget: Budget) -> tuple[TrialResult, str]:
    m = len(body.q)
    paths = [path_followed(task, body, aside, budget) for aside in ASIDE * np.eye(m + 1, m, -1)]
    if (rate := judged(paths)).status == "fails":
        return TrialResult.REFUTED, f"{rate.name} does not hold: {rate.text}"
    moved = np.array([path.went for path in paths[1:]]) - paths[0].went
    if not moved.any(axis=1).all():
        return TrialResult.STILL, "nothing moves by a reference"
    most = np.abs(moved).argmax(axis=1)
    if (other := np.flatnonzero(most != np.arange(m))).size:
        joint = int(other[0])
        text = f"the reference of joint {joint + 1} moves joint {most[joint] + 1} most"
        return TrialResult.REFUTED, text
    return TrialResult.MOVES, ""
