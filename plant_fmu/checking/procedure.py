"""An FMU is looked at step by step: its description, its library, its names, how it moves and runs.

What is known is told at once, each step within a budget of its own.
"""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.plant_fmu.archives.archive import Archive, unpacked
from nrs_cosim.plant_fmu.archives.presence import VECTORS
from nrs_cosim.plant_fmu.archives.quantities import TYPES, Part, Quantity
from nrs_cosim.plant_fmu.archives.units import unit_of
from nrs_cosim.plant_fmu.archives.variables import find_quantity, proposing
from nrs_cosim.plant_fmu.checking.budget import VALIDATING, Budget
from nrs_cosim.plant_fmu.checking.findings import CheckTask, Finding
from nrs_cosim.plant_fmu.checking.mechanics import TORQUE, MechanicsProbe, open_probe
from nrs_cosim.plant_fmu.checking.physics import physics
from nrs_cosim.plant_fmu.checking.rates import rate_by_references
from nrs_cosim.plant_fmu.checking.resetting import resetting
from nrs_cosim.plant_fmu.checking.running import at_start, fitted, resuming, running, slowness
from nrs_cosim.plant_fmu.checking.starting import starting
from nrs_cosim.plant_fmu.checking.trial import tried_proposals
from nrs_cosim.plant_fmu.checking.validity import validity
from nrs_cosim.plant_fmu.drives.choice import choose, offers
from nrs_cosim.plant_fmu.drives.reference_driven import ACCELERATION, REFERENCE
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of
from nrs_cosim.plant_fmu.fmi.library import Kind, Library


def findings(task: CheckTask, budget: Budget) -> Iterator[Finding]:
    """Yield what is found of an FMU, in this process; of one that cannot be driven, why."""
    archive = task.archive
    budget.begin(VALIDATING)
    yield from validity(archive, budget.limit)
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
        for ours in ("qd", *(REFERENCE if chosen.way == "reference" else ("tau",))):
            find_quantity(archive, ours, task.names, size=len(body.q), sizes=sizes)
    except FmuError as error:
        cause, _, _said_above = str(error).partition(". First: ")
        yield from tried_proposals(task, budget)
        yield Finding("drives", "chosen", "fails", cause)
        return
    yield Finding("drives", "chosen", "holds", chosen.way)
    budget.begin("starting it elsewhere")
    started = starting(task, body, offered, chosen)
    if started:
        task = replace(task, names={**task.names, **started.names})
        yield started.finding
    budget.begin("checking whether it moves as mechanics does")
    suited, why_slow = task.body, ""
    with ExitStack() as stack:
        try:
            probe = open_probe(stack, archive, body, task.names, offered, chosen)
            mechanics = MechanicsProbe(probe, body, budget)
        except CosimError as error:
            yield Finding("physics", "mechanics", "unknown", f"cannot be probed: {error}")
            if chosen.way not in TORQUE:
                yield rate_by_references(task, body, budget)
        else:
            why_slow = slowness(mechanics)
            yield from physics(mechanics, why_slow)
            suited = suited or fitted(mechanics, body)
    if any(offer.way in TORQUE for offer in offered):
        budget.begin("resetting it")
        yield resetting(archive, body, task.names, offered, chosen, budget)
    budget.begin("running it alone")
    run = running(task, suited or body, suited is not None, budget, why_slow)
    yield run
    if run.status == "holds":
        budget.begin("saving its state, and going on in another process")
        yield resuming(task, suited or body, budget, why_slow)


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
            named = "".join(
                f"; {name} is not named as its modelIdentifier" for name in archive.misnamed
            )
            text = f"it can be instantiated here{archive.needs}{named}"
            yield Finding("loads", kind, "holds", text)


def _mapping(task: CheckTask, sizes: Mapping[int, int]) -> Iterator[Finding]:
    """Yield what stands for each quantity of ours; what is missing is told once, if it is needed.

    A torque makes references needless, and references a torque.
    """
    m = len(task.body.q) if task.body else None
    quantities: dict[str, Quantity | str] = {}
    for ours in VECTORS:
        try:
            found = find_quantity(task.archive, ours, task.names, size=m, sizes=sizes)
        except FmuError as error:
            quantities[ours] = str(error).removesuffix(proposing(task.archive))
        else:
            quantities[ours] = found
            m = found.size if ours == "q" else m
    torque = isinstance(quantities["tau"], Quantity)
    referred = all(isinstance(quantities[ours], Quantity) for ours in REFERENCE)
    chords = "a reference that is no line is given in chords"
    needless = {"tau_applied": "it is computed", ACCELERATION: chords}
    if torque:
        needless |= dict.fromkeys((*REFERENCE, ACCELERATION), "it takes tau")
    elif referred:
        needless["tau"] = "it takes references"
    else:
        needless |= dict.fromkeys(REFERENCE, "tau would do")
    unknown, previous = f"{task.archive.label}: has no variable ", ""
    for ours, what in quantities.items():
        if isinstance(what, Quantity):
            text = ", ".join(_named(task.archive, part) for part in what.parts)
            yield Finding("variables", ours, "holds", text)
        elif not what.startswith(unknown):
            yield Finding("variables", ours, "note", what)
        elif ours in needless:
            yield Finding("variables", ours, "note", f"not there, nor needed: {needless[ours]}")
        elif previous:
            text = f"not found either; write variables.{ours} as well, as of {previous}"
            yield Finding("variables", ours, "note", text)
        else:
            previous = ours
            yield Finding("variables", ours, "note", what)


def _named(archive: Archive, part: Part) -> str:
    """Return a part's name in the FMU, with its aliases, its slice and its unit."""
    variables = [
        v
        for v in archive.description.modelVariables
        if v.type in TYPES and v.valueReference == part.reference
    ]
    units = map(unit_of, variables)
    cut = f"[{part.first}:{part.first + part.size}]" if part.size < part.length else ""
    known = archive.joints and all(joint.unit for joint in archive.joints)
    none = "each joint's own unit" if known else "no unit, taken for SI"
    unit = next(filter(None, units), none)
    return f"{' = '.join(v.name for v in variables)}{cut} ({unit})"
