"""Whether q̇ is the rate of q: how far q goes in some steps, against what q̇ adds up to in them.

Within a step q̇ may have been anything between its values at the ends: by what it changes there a
plant that has steps of its own may be off, by whatever rule it takes them.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import pi

import numpy as np

from nrs_cosim.bus.plurals import numbered
from nrs_cosim.plant_fmu.drives.probe import MOVED, Probe, inverse_inertia, under_torque
from nrs_cosim.plant_fmu.errors import FmuError, StepError
from nrs_cosim.plant_fmu.plants import Array, Body

NOT_THE_RATE = "qd is not the rate of q"
STEPS = 32
APART = 0.05
"""Of how far q goes, relative: by how much it may be off beside what steps explain."""
UNITS = {
    180 / pi: "; q in degrees?",
    pi / 180: "; qd in degrees per second?",
    pi / 30: "; qd in revolutions per minute?",
    1 / (2 * pi): "; q in revolutions?",
    -1.0: "; with the other sign?",
}
"""What one would ask where q is so many times as fast as q̇ says."""
OTHERWISE = "otherwise than qd says; are q and qd in one order of joints?"


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """What became of the joints in some steps, all (m,), rad or m."""

    went: Array
    summed: Array
    """What q̇ adds up to."""
    doubt: Array
    """By how much that may be off."""


def path(passed: Array, span: float) -> Path:
    """Return what became of joints by their q and q̇ at times a span apart, (times, 2, m)."""
    q, qd = passed[:, 0], passed[:, 1]
    doubt = span * np.abs(np.diff(qd, axis=0)).sum(axis=0)
    return Path(q[-1] - q[0], np.asarray(np.trapezoid(qd, dx=span, axis=0), float), doubt)


def other_rate(paths: Sequence[Path]) -> str | None:
    """Say of which joints q goes otherwise than q̇ says: empty where it goes so; None if not known.

    Known it is where each joint has gone far enough for steps not to explain what it did.
    """
    went, summed, doubt = np.transpose([(p.went, p.summed, p.doubt) for p in paths], (1, 0, 2))
    size = np.maximum(np.abs(went), np.abs(summed))
    other = (np.abs(went - summed) > APART * size + doubt).any(axis=0)
    if other.any():
        with np.errstate(all="ignore"):
            times = (went * summed).sum(axis=0) / (summed**2).sum(axis=0)
            off = np.abs(went - times * summed) > APART * size + np.abs(times) * doubt + doubt
        found: dict[str, list[int]] = {}
        for joint in np.flatnonzero(other):
            fixed = np.isfinite(times[joint]) and not off[:, joint].any()
            text = _times(float(times[joint])) if fixed else OTHERWISE
            found.setdefault(text, []).append(int(joint) + 1)
        return "; ".join(f"q of {numbered('joint', of)} moves {t}" for t, of in found.items())
    far_enough = (size > MOVED) & (doubt <= size / 4)
    return "" if far_enough.any(axis=0).all() else None


def other_rate_at_start(probe: Probe, body: Body, step: float) -> str:
    """Say as `other_rate` what a robot does from its start by pushes; nothing if it is not known.

    q̇ is told at the start alone: only later ones are of the FMU's equations.
    """
    paths = []
    with suppress(FmuError, StepError):
        sizes = np.linalg.norm(inverse_inertia(probe, body, body.q, step, step), axis=0)
        push = 1 / np.where(sizes > 0, sizes, 1)
        for side in (1, -1):
            qd = body.qd + side * (1 + np.arange(len(body.q)) / 4)
            probe.start_again([under_torque(body, body.q, qd, side * push)])
            passed = []
            for j in range(STEPS + 1):
                probe.advance(j * step, step)
                passed.append((probe.q[0].copy(), probe.qd[0].copy()))
            paths.append(path(np.array(passed), step))
    return other_rate(paths) or "" if paths else ""


def _times(factor: float) -> str:
    asked = (text for unit, text in UNITS.items() if abs(factor - unit) <= APART * abs(unit))
    return f"about {factor:.2g} times as fast as qd says{next(asked, '')}"
