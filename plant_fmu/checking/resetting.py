"""A reset leaves nothing of what was: started again, an FMU is and moves as it did at first.

fmi2Reset and fmi3Reset return an instance to where it was when it was instantiated (FMI 2.0.4,
section 2.1.5; FMI 3.0.2, section 2.3.1). What equations are looked for by starting it anew at
postures is of the FMU only where that holds.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.checking.budget import Budget
from nrs_cosim.plant_fmu.checking.findings import Finding, FindingStatus
from nrs_cosim.plant_fmu.checking.mechanics import open_probe
from nrs_cosim.plant_fmu.drives.choice import Offer
from nrs_cosim.plant_fmu.drives.probe import Probe, under_torque
from nrs_cosim.plant_fmu.plants import Array, Body

STEP, STEPS = 0.02, 50
"""s"""
NEAR = 1e-9
"""Of 1 rad or rad/s and of how far it moved: what is no more apart is the same motion."""


def resetting(
    archive: Archive,
    body: Body,
    names: Mapping[str, Spec],
    offered: Sequence[Offer],
    chosen: Offer,
    budget: Budget,
) -> Finding:
    """Move a plant by a torque, reset it, and compare its start and its motion with the first."""
    call = f"fmi{archive.description.fmiVersion[0]}Reset"

    def finding(status: FindingStatus, text: str, value: float | None = None) -> Finding:
        return Finding("runs", "reset", status, text, value)

    pushed = under_torque(body, body.q, body.qd, np.ones(len(body.q)))
    try:
        with ExitStack() as stack:
            probe = open_probe(stack, archive, pushed, names, offered, chosen).probe
            first = _motion(probe, budget)
            probe.start_again([pushed])
            again = _motion(probe, budget)
    except CosimError as error:
        return finding("unknown", f"cannot be looked at: {error}")
    moved = float(np.abs(first - first[0]).max())
    apart = np.abs(again - first)
    if not apart[0].max() <= NEAR:
        return finding(
            "fails",
            f"after {call} and the same start values it is at q, qd = {_shown(again[0])}, and was "
            f"at {_shown(first[0])}: {call} does not start it anew",
            float(apart[0].max()) if np.isfinite(apart[0]).all() else None,
        )
    if not apart.max() <= NEAR * (1 + moved):
        return finding(
            "fails",
            f"after {call} it moves otherwise than from its first start, by up to "
            f"{apart.max():.2g}: {call} leaves some of its state",
            float(apart.max()) if np.isfinite(apart).all() else None,
        )
    if not moved:
        return finding("unknown", f"it starts where it did, and does not move: {call} has no work")
    text = f"after {call} it starts where it did, and moves as it did for {STEPS * STEP:g} s"
    return finding("holds", text, float(apart.max()))


def _motion(probe: Probe, budget: Budget) -> Array:
    """Return q and qd at the start and after each step, (steps + 1, 2 m)."""
    seen = [np.concatenate([probe.q[0], probe.qd[0]])]
    for j in range(STEPS):
        probe.advance(j * STEP, STEP)
        budget.spend()
        seen.append(np.concatenate([probe.q[0], probe.qd[0]]))
    return np.array(seen)


def _shown(state: Array) -> str:
    return ", ".join(f"{number:.6g}" for number in state)
