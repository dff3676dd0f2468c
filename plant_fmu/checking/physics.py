"""Whether a plant is mechanics: q̇ is q's rate, M symmetric, definite, G rests, no power is gained.

Only what is found at each of two spans is held against the FMU; what cannot be found is unknown.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import permutations
from math import isfinite

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.bus.plurals import numbered
from nrs_cosim.plant_fmu.checking.budget import OverBudgetError
from nrs_cosim.plant_fmu.checking.findings import Finding
from nrs_cosim.plant_fmu.checking.mechanics import HOLDING, MechanicsProbe
from nrs_cosim.plant_fmu.checking.rates import rate_finding
from nrs_cosim.plant_fmu.drives.probe import SEED
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.plants import Array

POSTURES = 4
AROUND = 2.0
"""rad, rad/s: how far the postures are drawn about the start, and velocities about rest."""
TOLERANCE = 3e-3
"""Of what is relative: asymmetry, power."""
MOST_ORDERED = 4
"""Joints of which all orders are tried."""
DRIFT, MOST_GROWTH = 1e-3, 100.0
"""rad, per growth of a deviation; beyond so much growth a drift says nothing."""


def physics(mechanics: MechanicsProbe, why_slow: str) -> Iterator[Finding]:
    """Yield whether it is mechanics, at its start and at postures drawn about it."""
    start = mechanics.start
    drawn = np.random.Generator(np.random.Philox(SEED))
    asides = drawn.uniform(-AROUND, AROUND, (POSTURES - 1, len(start)))
    postures, refusal = [], ""
    mobilities: list[list[Array]] = []
    for q in (start, *(start + asides)):
        try:
            mobilities.append([mechanics.mobility(q, span) for span in mechanics.spans])
            postures.append(q)
        except OverBudgetError as over:
            refusal = f"{over}{why_slow}"
            break
        except CosimError as error:
            refusal = str(error)
    if not postures or not np.isfinite(mobilities).all():
        why = refusal or "its accelerations are not finite"
        yield Finding("physics", "mechanics", "unknown", f"cannot be probed: {why}")
        return
    velocities = drawn.uniform(-AROUND, AROUND, (len(postures), len(start)))
    try:
        yield rate_finding(mechanics, postures, list(velocities))
    except OverBudgetError as over:
        yield Finding("physics", "rate", "unknown", f"cannot be probed: {over}{why_slow}")
    amiss = _amiss(mobilities[0][-1])
    asymmetry = max(min(map(asymmetry_of, at)) for at in mobilities)
    yield _judged(
        "M symmetric",
        asymmetry <= TOLERANCE,
        f"{amiss}relative asymmetry {asymmetry:.2g} at {len(postures)} postures",
        asymmetry,
    )
    ratio = min(max(map(_definiteness, at)) for at in mobilities)
    definite = ratio > 0
    text = f"{amiss}smallest eigenvalue over largest {ratio:.2g} at {len(postures)} postures"
    yield _judged("M positive definite", definite, text, ratio)
    if asymmetry > TOLERANCE or not definite:
        for name in ("rests", "power"):
            why = "cannot be probed: without a mass matrix there is neither G nor kinetic energy"
            yield Finding("physics", name, "unknown", why)
        return
    judges: dict[str, Callable[[], Finding]] = {
        "rests": lambda: _resting(mechanics, postures),
        "power": lambda: _balancing(mechanics, postures, list(velocities)),
    }
    for name, judge in judges.items():
        try:
            yield judge()
        except OverBudgetError as over:
            yield Finding("physics", name, "unknown", f"cannot be probed: {over}{why_slow}")
        except (CosimError, np.linalg.LinAlgError) as error:
            yield Finding("physics", name, "unknown", f"cannot be probed: {error}")


def _resting(mechanics: MechanicsProbe, postures: Sequence[Array]) -> Finding:
    """Judge whether it stays where gravity is balanced, at the posture that is least unstable."""
    rests = [mechanics.rest(q, mechanics.spans[0]) for q in postures]
    rest = min(rests, key=lambda rest: rest.growth)
    if not rest.growth <= MOST_GROWTH:
        raise FmuError(f"at rest a deviation grows at least {rest.growth:.3g} times")
    return _judged(
        "rests",
        rest.drift <= DRIFT * rest.growth,
        f"with the torque of gravity held for {HOLDING:g} s it moves by {rest.drift:.2g}, while "
        f"a deviation may grow {rest.growth:.3g} times",
        rest.drift,
    )


def _balancing(
    mechanics: MechanicsProbe, postures: Sequence[Array], velocities: Sequence[Array]
) -> Finding:
    """Judge where energy goes, at pairs of opposite velocities."""
    gained, doubts = np.transpose(
        [
            min((mechanics.power_gained(q, way, span) for span in mechanics.spans), key=_size)
            for q, qd in zip(postures, velocities, strict=True)
            for way in (qd, -qd)
        ]
    )
    if not np.isfinite(gained).all():
        raise FmuError("its accelerations are not finite")
    low, high, surely = float(gained.min()), float(gained.max()), float((gained - doubts).max())
    if high > TOLERANCE >= surely:
        raise FmuError(
            f"it seems to gain power, {high:.2g} of what flows, as its internal step of "
            f"{mechanics.stairs.internal:.3g} s alone may make it seem"
        )
    if high > TOLERANCE:
        text, worst = f"gains power that no torque gives, {high:.2g} of what flows", high
    elif low < -TOLERANCE:
        text, worst = f"loses energy (damping), up to {-low:.2g} of the power that flows", low
    else:
        worst = float(max(gained, key=abs))
        text = f"energy is kept, to {abs(worst):.1g} of the power that flows"
    return _judged("power", high <= TOLERANCE, text, worst)


def _size(found: tuple[float, float]) -> float:
    return abs(found[0])


def _judged(name: str, holds: bool, text: str, value: float) -> Finding:
    number = value if isfinite(value) else None
    return Finding("physics", name, "holds" if holds else "fails", text, number)


def asymmetry_of(mobility: Array) -> float:
    """Return how far M⁻¹ (m, m) is from symmetric, relative to its largest number."""
    size = float(np.abs(mobility).max())
    return float(np.abs(mobility - mobility.T).max()) / size if size else 0.0


def _amiss(mobility: Array) -> str:
    """Begin a sentence with what signs or order of torques would make M symmetric and definite.

    Where there is none, it is asked; nothing is said of M⁻¹ (m, m) that is so.
    """
    m, joints = len(mobility), np.arange(len(mobility))
    if _is_inertia(mobility):
        return ""
    against = mobility.diagonal() < 0
    if _is_inertia(mobility * np.where(against, -1, 1)):
        which = f" on {numbered('joint', (joints[against] + 1).tolist())}" * (m > 1)
        return f"torque acts against its sign{which}: "
    for order in permutations(joints) if m <= MOST_ORDERED else ():
        if _is_inertia(mobility[:, order]):
            wanted = ", ".join(str(joint + 1) for joint in order)
            return f"it would hold with the numbers of tau in the order {wanted}: "
    return "are q, qd and tau in one order of joints? " * (m > 1)


def _is_inertia(mobility: Array) -> bool:
    return asymmetry_of(mobility) <= TOLERANCE and _definiteness(mobility) > 0


def _definiteness(mobility: Array) -> float:
    """Return the smallest eigenvalue of the symmetric part over the largest in size.

    The ratio of M⁻¹ is that of M where all are positive.
    """
    eigenvalues = np.linalg.eigvalsh((mobility + mobility.T) / 2)
    size = float(np.abs(eigenvalues).max())
    return float(eigenvalues[0]) / size if size else 0.0
