"""Whether an FMU can be a robot here: what it offers, whether it runs, whether it is mechanics.

Each finding holds, fails, is unknown for a reason, or is a note; they come one after another, so
that those before a crash are known.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, field, replace
from io import BytesIO
from math import isfinite
from typing import Any, Literal
from zipfile import ZipFile

import numpy as np
from fmpy.validation import validate_fmu

from bus.errors import CosimError
from plant_fmu.archives.archive import Archive, unpacked
from plant_fmu.archives.naming import Spec
from plant_fmu.archives.quantities import TYPES, Layout, Part, Quantity
from plant_fmu.archives.reading import NAME
from plant_fmu.archives.units import unit_of
from plant_fmu.archives.variables import find_quantity
from plant_fmu.checking.mechanics import HOLDING, SPANS, Mechanics, open_probe
from plant_fmu.checking.resuming import resumed
from plant_fmu.drives.driving import Driving, choose, offers
from plant_fmu.drives.opening import open_plants
from plant_fmu.drives.probing import SEED
from plant_fmu.errors import FmuError
from plant_fmu.fmi.assigning import assignments, sizes_of
from plant_fmu.fmi.library import Kind, Library
from plant_fmu.plants import Array, Body, Disturbance

QUANTITIES = ("q", "qd", "tau", "position_ref", "velocity_ref", "tau_applied")
POSTURES = 4
AROUND = 2.0
"""rad, rad/s: how far the postures are drawn about the start, and velocities about rest."""
TOLERANCE = 3e-3
"""Of what is relative: asymmetry, power."""
DRIFT, MOST_GROWTH = 1e-3, 100.0
"""rad, per growth of a deviation; beyond so much growth a drift says nothing."""
PACE = 5.0
"""rad/s, of the critically damped motion to which the gains of a lone run are fitted."""
RUN, STEPS = 1.0, 100
"""s, in equal steps."""

Verdict = Literal["holds", "fails", "unknown", "note"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    topic: str
    """valid, loads, variables, drives, runs or physics"""
    name: str
    verdict: Verdict
    text: str
    value: float | None = None
    """The number that decided, where there is one and it is finite."""


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be checked, as a scenario tells it where there is one."""

    archive: Archive
    body: Body | None = None
    """The robot; without one, it is at the FMU's start values, with gains fitted to its inertia."""
    names: Mapping[str, Spec] = field(default_factory=dict)
    driving: Driving = field(default_factory=Driving)


@dataclass(frozen=True, slots=True)
class FmuCheck:
    """All findings of an FMU."""

    fmu: str
    sha256: str
    findings: tuple[Finding, ...]

    @property
    def passes(self) -> bool:
        """Whether nothing fails."""
        return all(finding.verdict != "fails" for finding in self.findings)

    def as_json(self) -> dict[str, Any]:
        """Return the findings for JSON."""
        return {
            "fmu": self.fmu,
            "sha256": self.sha256,
            "passes": self.passes,
            "findings": [asdict(finding) for finding in self.findings],
        }


def findings(task: Task) -> Iterator[Finding]:
    """Yield what is found of an FMU, in this process; of one that cannot be driven, why."""
    archive = task.archive
    yield from _validity(archive)
    yield from _loading(archive)
    try:
        parameters = task.body.parameters if task.body else {}
        sizes = sizes_of(assignments(archive, parameters))
        yield from _mapping(task, sizes)
        offered = offers(archive, task.names, sizes)
        for offer in offered:
            yield Finding("drives", offer.way, "note", f"{offer.kind}: {offer.reason}")
        chosen = choose(archive, task.names, task.driving, sizes)
        body = task.body or _at_start(archive, find_quantity(archive, "q", task.names, sizes=sizes))
    except FmuError as error:
        yield Finding("drives", "chosen", "fails", str(error))
        return
    yield Finding("drives", "chosen", "holds", chosen.way)
    with ExitStack() as stack:
        try:
            probe = open_probe(stack, archive, body, task.names, offered, chosen)
            mechanics = Mechanics(probe, body)
        except CosimError as error:
            physics = [Finding("physics", "mechanics", "unknown", f"cannot be probed: {error}")]
        else:
            physics = list(_physics(mechanics, body.q))
            body = body if task.body else _fitted(mechanics, body)
    running = _running(task, body)
    yield running
    if running.verdict == "holds":
        yield _resuming(task, body)
    yield from physics


def _validity(archive: Archive) -> Iterator[Finding]:
    """Yield FMPy's problems of the model description, which alone it is given to parse."""
    alone = BytesIO()
    with ZipFile(archive.path) as source, ZipFile(alone, "w") as target:
        target.writestr(NAME, source.read(NAME))
    problems = validate_fmu(alone)
    for problem in problems:
        yield Finding("valid", NAME, "note", " ".join(problem.split()))
    if not problems:
        yield Finding("valid", NAME, "holds", f"it is as FMI {archive.fmi_version} has it")


def _loading(archive: Archive) -> Iterator[Finding]:
    kinds: tuple[Kind, ...] = ("CoSimulation", "ModelExchange")
    for kind in kinds:
        if kind not in archive.kinds:
            continue
        try:
            with unpacked(archive) as folder, Library(archive, folder, kind) as library:
                library.instantiate("check")
        except FmuError as error:
            yield Finding("loads", kind, "fails", str(error))
        else:
            yield Finding("loads", kind, "holds", f"it can be instantiated here{archive.needs}")


def _mapping(task: Task, sizes: Mapping[int, int]) -> Iterator[Finding]:
    """Yield what stands for each quantity of ours; what is not found may not be needed."""
    m = len(task.body.q) if task.body else None
    for ours in QUANTITIES:
        try:
            quantity = find_quantity(task.archive, ours, task.names, size=m, sizes=sizes)
        except FmuError as error:
            yield Finding("variables", ours, "note", str(error))
        else:
            m = quantity.size if ours == "q" else m
            text = ", ".join(_named(task.archive, part) for part in quantity.parts)
            yield Finding("variables", ours, "holds", text)


def _named(archive: Archive, part: Part) -> str:
    """Return a part's name in the FMU, with its aliases, its slice and its unit."""
    variables = [
        v
        for v in archive.description.modelVariables
        if v.type in TYPES and v.valueReference == part.reference
    ]
    units = map(unit_of, variables)
    cut = f"[{part.first}:{part.first + part.size}]" if part.size < part.length else ""
    unit = next(filter(None, units), "no unit, taken for SI")
    return f"{' = '.join(v.name for v in variables)}{cut} ({unit})"


def _at_start(archive: Archive, q: Quantity) -> Body:
    """Return a robot at rest at the FMU's start values, with gains of 1."""
    declared = {
        v.valueReference: v.start
        for v in archive.description.modelVariables
        if v.type in TYPES and v.start
    }
    theirs: list[float] = []
    for reference in Layout.of([q]).references:
        length = next(part.length for part in q.parts if part.reference == reference)
        numbers: list[float] = []
        with suppress(ValueError):
            numbers = [float(number) for number in declared.get(reference, "").split()]
        theirs += numbers if len(numbers) == length else [*(numbers[:1] or [0.0])] * length
    layout, m = Layout.of([q]), q.size
    start, none, one = layout.factor * np.array(theirs)[layout.index], np.zeros(m), np.eye(m)
    still = Disturbance(none, none, *np.zeros((3, m, 0)))
    return Body(1, {}, one, one, still, q=start, qd=none, position=start, velocity=none)


def _fitted(mechanics: Mechanics, body: Body) -> Body:
    """Return a robot whose gains are critically damped at its inertia, if it has one."""
    try:
        mobility = mechanics.mobility(body.q, SPANS[0])
        mass: Array = np.asarray(np.linalg.inv((mobility + mobility.T) / 2), float)
        fits = bool(np.linalg.eigvalsh(mass)[0] > 0)
    except (CosimError, np.linalg.LinAlgError):
        return body
    return replace(body, kp=PACE**2 * mass, kd=2 * PACE * mass) if fits else body


def _running(task: Task, body: Body) -> Finding:
    """Run one robot alone, its reference at its start unless a scenario says otherwise."""
    try:
        with ExitStack() as stack:
            plants = open_plants(stack, task.archive, [body], task.names, task.driving)
            moved = 0.0
            for j in range(STEPS):
                plants.advance(j * RUN / STEPS, RUN / STEPS)
                moved = max(moved, float(np.abs(plants.q[0] - body.q).max()))
    except CosimError as error:
        return Finding("runs", "alone", "fails", str(error))
    text = f"{RUN:g} s by {plants.drive}: finite, up to {moved:.3g} from its start"
    return Finding("runs", "alone", "holds", text, moved)


def _resuming(task: Task, body: Body) -> Finding:
    """Save the robot, and go on in another process."""

    def finding(verdict: Verdict, text: str, value: float | None = None) -> Finding:
        return Finding("runs", "resumed", verdict, text, value)

    try:
        found = resumed(task.archive, body, task.names, task.driving)
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


def _physics(mechanics: Mechanics, start: Array) -> Iterator[Finding]:
    """Yield whether it is mechanics, at its start and at postures drawn about it."""
    drawn = np.random.Generator(np.random.Philox(SEED))
    asides = drawn.uniform(-AROUND, AROUND, (POSTURES - 1, len(start)))
    postures, refusal = [], ""
    mobilities: list[list[Array]] = []
    for q in (start, *(start + asides)):
        try:
            mobilities.append([mechanics.mobility(q, span) for span in SPANS])
            postures.append(q)
        except CosimError as error:
            refusal = str(error)
    if not postures or not np.isfinite(mobilities).all():
        why = refusal or "its accelerations are not finite"
        yield Finding("physics", "mechanics", "unknown", f"cannot be probed: {why}")
        return
    asymmetry = max(min(map(_asymmetry, at)) for at in mobilities)
    yield _judged(
        "M symmetric",
        asymmetry <= TOLERANCE,
        f"relative asymmetry {asymmetry:.2g} at {len(postures)} postures",
        asymmetry,
    )
    ratio = min(max(map(_definiteness, at)) for at in mobilities)
    definite = ratio > 0
    text = f"smallest eigenvalue over largest {ratio:.2g} at {len(postures)} postures"
    yield _judged("M positive definite", definite, text, ratio)
    if asymmetry > TOLERANCE or not definite:
        for name in ("rests", "power"):
            why = "cannot be probed: without a mass matrix there is neither G nor kinetic energy"
            yield Finding("physics", name, "unknown", why)
        return
    velocities = drawn.uniform(-AROUND, AROUND, (len(postures), len(start)))
    judges: dict[str, Callable[[], Finding]] = {
        "rests": lambda: _resting(mechanics, postures),
        "power": lambda: _balancing(mechanics, postures, list(velocities)),
    }
    for name, judge in judges.items():
        try:
            yield judge()
        except (CosimError, np.linalg.LinAlgError) as error:
            yield Finding("physics", name, "unknown", f"cannot be probed: {error}")


def _resting(mechanics: Mechanics, postures: Sequence[Array]) -> Finding:
    """Judge whether it stays where gravity is balanced, at the posture that is least unstable."""
    rest = min((mechanics.rest(q, SPANS[0]) for q in postures), key=lambda rest: rest.growth)
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
    mechanics: Mechanics, postures: Sequence[Array], velocities: Sequence[Array]
) -> Finding:
    """Judge where energy goes, at pairs of opposite velocities."""
    gained = [
        min((mechanics.power_gained(q, way, span) for span in SPANS), key=abs)
        for q, qd in zip(postures, velocities, strict=True)
        for way in (qd, -qd)
    ]
    if not np.isfinite(gained).all():
        raise FmuError("its accelerations are not finite")
    low, high = min(gained), max(gained)
    if high > TOLERANCE:
        text, worst = f"gains power that no torque gives, {high:.2g} of what flows", high
    elif low < -TOLERANCE:
        text, worst = f"loses energy (damping), up to {-low:.2g} of the power that flows", low
    else:
        worst = max(gained, key=abs)
        text = f"energy is kept, to {abs(worst):.1g} of the power that flows"
    return _judged("power", high <= TOLERANCE, text, worst)


def _judged(name: str, holds: bool, text: str, value: float) -> Finding:
    number = value if isfinite(value) else None
    return Finding("physics", name, "holds" if holds else "fails", text, number)


def _asymmetry(mobility: Array) -> float:
    size = float(np.abs(mobility).max())
    return float(np.abs(mobility - mobility.T).max()) / size if size else 0.0


def _definiteness(mobility: Array) -> float:
    """Return the smallest eigenvalue of the symmetric part over the largest in size.

    The ratio of M⁻¹ is that of M where all are positive.
    """
    eigenvalues = np.linalg.eigvalsh((mobility + mobility.T) / 2)
    size = float(np.abs(eigenvalues).max())
    return float(eigenvalues[0]) / size if size else 0.0
