"""Whether q̇ is the rate of q is looked at before all else, which is of q̇ and tau alone.

An FMU of degrees and rad/s, or of a speed beyond a gear, obeys mechanics by these two.
"""

from collections.abc import Sequence
from contextlib import ExitStack

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.plant_fmu.checking.budget import Budget, OverBudgetError
from nrs_cosim.plant_fmu.checking.findings import CheckTask, Finding
from nrs_cosim.plant_fmu.checking.mechanics import MechanicsProbe
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.drives.rate import Path, other_rate, path
from nrs_cosim.plant_fmu.plants import Array, Body

ASIDE, RUN, STEPS = 0.1, 1.0, 100
"""rad: how far references are moved; s, in equal steps."""


def rate_finding(
    mechanics: MechanicsProbe, postures: Sequence[Array], velocities: Sequence[Array]
) -> Finding:
    """Judge whether q̇ is the rate of q by motions from postures (m,) at velocities (m,)."""
    paths, refusal = list[Path](), ""
    for j, (q, qd) in enumerate(zip(postures, velocities, strict=True)):
        try:
            paths.append(mechanics.path(q, qd, (-1) ** j))
        except OverBudgetError:
            raise
        except CosimError as error:
            refusal = str(error)
    if not paths:
        return Finding("physics", "rate", "unknown", f"cannot be probed: {refusal}")
    return judged(paths)


def judged(paths: Sequence[Path]) -> Finding:
    """Judge motions by what q̇ adds up to."""
    other = other_rate(paths)
    if other is None:
        why = "its steps are too long, or it moves too little, for what qd adds up to"
        return Finding("physics", "rate", "unknown", f"cannot be probed: {why}")
    if other:
        return Finding("physics", "rate", "fails", other)
    off = max(float(np.abs(p.went - p.summed).max()) for p in paths)
    text = f"q goes as far as qd adds up to, to {off:.2g}, from {len(paths)} states"
    return Finding("physics", "rate", "holds", text, off)


def path_followed(task: CheckTask, body: Body, aside: Array, budget: Budget) -> Path:
    """Return how joints go where references are so far aside, (m,)."""
    with ExitStack() as stack:
        plants = open_plants(stack, task.archive, [body], task.names, task.driving)
        plants.hold((body.q + aside)[None], np.zeros((1, len(body.q))))
        passed = [(plants.q[0].copy(), plants.qd[0].copy())]
        for k in range(STEPS):
            plants.advance(k * RUN / STEPS, RUN / STEPS)
            budget.spend()
            passed.append((plants.q[0].copy(), plants.qd[0].copy()))
        return path(np.array(passed), RUN / STEPS)


def rate_by_references(task: CheckTask, body: Body, budget: Budget) -> Finding:
    """Judge whether q̇ is the rate of q by motions after references to either side."""
    aside = np.full(len(body.q), ASIDE)
    return judged([path_followed(task, body, side * aside, budget) for side in (1, -1)])
