"""An FMU is looked at step by step: its description, its library, its names, how it moves and runs.

What is known is told at once, each step within a budget of its own.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from io import BytesIO
from zipfile import ZipFile

from fmpy.validation import validate_fmu

from bus.errors import CosimError
from plant_fmu.archives.archive import Archive, unpacked
from plant_fmu.archives.quantities import TYPES, Part
from plant_fmu.archives.reading import NAME
from plant_fmu.archives.units import unit_of
from plant_fmu.archives.variables import find_quantity
from plant_fmu.checking.budget import VALIDATING, Budget, OutOfTime, limited
from plant_fmu.checking.findings import Finding, Task
from plant_fmu.checking.mechanics import Mechanics, open_probe
from plant_fmu.checking.physics import physics
from plant_fmu.checking.running import at_start, fitted, resuming, running, slowness
from plant_fmu.drives.driving import choose, offers
from plant_fmu.errors import FmuError
from plant_fmu.fmi.assigning import assignments, sizes_of
from plant_fmu.fmi.library import Kind, Library

_VARYING = re.compile(r'"[^"]*"|\d+')
"""What problems of one kind differ in: names of variables, and numbers."""
QUANTITIES = ("q", "qd", "tau", "position_ref", "velocity_ref", "tau_applied")


def findings(task: Task, budget: Budget) -> Iterator[Finding]:
    """Yield what is found of an FMU, in this process; of one that cannot be driven, why."""
    archive = task.archive
    budget.begin(VALIDATING)
    yield from _validity(archive, budget.limit)
    budget.begin("loading it")
    yield from _loading(archive)
    budget.begin("looking for its variables")
    try:
        parameters = task.body.parameters if task.body else {}
        sizes = sizes_of(assignments(archive, parameters))
        yield from _mapping(task, sizes)
        offered = offers(archive, task.names, sizes)
        for offer in offered:
            yield Finding("drives", offer.way, "note", f"{offer.kind}: {offer.reason}")
        chosen = choose(archive, task.names, task.driving, sizes)
        body = task.body or at_start(archive, find_quantity(archive, "q", task.names, sizes=sizes))
    except FmuError as error:
        yield Finding("drives", "chosen", "fails", str(error))
        return
    yield Finding("drives", "chosen", "holds", chosen.way)
    budget.begin("checking whether it moves as mechanics does")
    suited, why_slow = task.body, ""
    with ExitStack() as stack:
        try:
            probe = open_probe(stack, archive, body, task.names, offered, chosen)
            mechanics = Mechanics(probe, body, budget)
        except CosimError as error:
            yield Finding("physics", "mechanics", "unknown", f"cannot be probed: {error}")
        else:
            why_slow = slowness(mechanics)
            yield from physics(mechanics, why_slow)
            suited = suited or fitted(mechanics, body)
    budget.begin("running it alone")
    run = running(task, suited or body, suited is not None, budget, why_slow)
    yield run
    if run.verdict == "holds":
        budget.begin("saving its state, and going on in another process")
        yield resuming(task, suited or body, budget, why_slow)


def _validity(archive: Archive, limit: float) -> Iterator[Finding]:
    """Yield FMPy's problems of the model description, which alone it is given to parse."""
    alone = BytesIO()
    with ZipFile(archive.path) as source, ZipFile(alone, "w") as target:
        target.writestr(NAME, source.read(NAME))
    try:
        with limited(limit):
            problems = validate_fmu(alone)
    except OutOfTime:
        text = f"not validated: took longer than {limit:g} s of processor time"
        yield Finding("valid", NAME, "unknown", text)
        return
    for text in _grouped(problems):
        yield Finding("valid", NAME, "note", text)
    if not problems:
        yield Finding("valid", NAME, "holds", f"it is as FMI {archive.fmi_version} has it")


def _grouped(problems: Sequence[str]) -> Iterator[str]:
    """Yield each problem once, whatever its line and the names in it, with how often it is."""
    kinds: dict[str, list[str]] = {}
    for problem in problems:
        told = " ".join(problem.split())
        kinds.setdefault(_VARYING.sub("", told), []).append(told)
    for first, *more in kinds.values():
        yield f"{first} ({len(more) + 1} times alike)" if more else first


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
