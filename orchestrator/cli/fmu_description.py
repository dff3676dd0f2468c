"""What a person sees of an FMU: what it is, whether it runs here, and a line for each variable.

The scalars of a family such as `q[1]`, `q[2]` are one line. The joints of a URDF are a table of
their own, and variables have their numbers in place of their names.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from math import prod
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Column

from nrs_cosim.orchestrator.cli.tables import grid, table
from nrs_cosim.orchestrator.terminal import prose

MOST_STARTS = 4
"""Of one family, before the rest are left out."""
_CAUSALITIES = {"structuralParameter": "structural", "calculatedParameter": "calculated"}
_COLUMNS = (
    Column("variable"),
    Column("causality"),
    Column("numbers", justify="right"),
    *map(Column, ("unit", "start", "about")),
)

_LIMITS = ("lower", "upper", "effort", "velocity")
_JOINT_COLUMNS = (
    Column("q", justify="right"),
    *map(Column, ("type", "unit")),
    *(Column(limit, justify="right") for limit in _LIMITS),
    *map(Column, ("mimics", "joint")),
)


def show_description(console: Console, description: Mapping[str, Any]) -> None:
    """Show what `Archive.describe` says."""
    grid(console, dict(_lines(description)))
    families = [
        list(family)
        for _, family in groupby(description["variables"], lambda v: v["name"].partition("[")[0])
    ]
    console.print()
    of_joints = _named(description["joints"])
    table(console, _COLUMNS, (tuple(map(escape, _row(family, of_joints))) for family in families))
    if description["joints"]:
        console.print()
        numbers = {joint["name"]: joint["number"] for joint in description["joints"]}
        rows = (tuple(map(escape, _joint(joint, numbers))) for joint in description["joints"])
        table(console, _JOINT_COLUMNS, rows)
    if any(family[0]["causality"] == "structuralParameter" for family in families):
        prose(
            console,
            "\nA structural parameter decides how many numbers others hold; as any parameter, it "
            "stands in a scenario's plant.parameters.",
        )


def _lines(description: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "name", description["name"]
    yield "about", description["description"]
    yield (
        "FMI",
        f"{description['fmi_version']}, "
        f"{' and '.join(description['kinds']) or 'for no use that is known here'}",
    )
    yield "sha256", description["sha256"]
    yield "platforms", ", ".join(description["platforms"]) or "none: it has no library"
    if description["needs_execution_tool"]:
        yield "needs", f"{description['needs_execution_tool']}, on the machine where it runs"
    if description["cannot_run_here"]:
        yield "here", f"cannot run here: {description['cannot_run_here']}"


def _named(joints: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Return how descriptions of variables name all joints, and what says so by numbers."""
    names = [joint["name"] for joint in joints if joint["number"]]
    return f" ({', '.join(names)})", f" (joint{'s 1-' * (len(names) > 1)}{len(names)})"


def _joint(joint: Mapping[str, Any], numbers: Mapping[str, int | None]) -> tuple[str, ...]:
    limits = (joint[limit] for limit in _LIMITS)
    return (
        str(joint["number"] or ""),
        joint["type"],
        joint["unit"],
        *("" if limit is None else f"{limit:g}" for limit in limits),
        _followed(joint["mimics"], numbers),
        joint["name"],
    )


def _followed(mimic: Mapping[str, Any] | None, numbers: Mapping[str, int | None]) -> str:
    """Say which joint another follows, and how: multiplier times it plus offset."""
    if mimic is None:
        return ""
    factor: float = mimic["multiplier"]
    offset: float = mimic["offset"]
    number = numbers.get(mimic["joint"])
    joint = f"q[{number}]" if number else str(mimic["joint"])
    return f"{factor:g} " * (factor != 1) + joint + f" {offset:+g}" * (offset != 0)


def _row(family: Sequence[Mapping[str, Any]], of_joints: tuple[str, str]) -> tuple[str, ...]:
    first, (names, numbers) = family[0], of_joints
    return (
        first["name"].partition("[")[0] if len(family) > 1 or first["shape"] else first["name"],
        _CAUSALITIES.get(first["causality"], first["causality"]),
        str(sum(prod(variable["shape"]) for variable in family)),
        first["unit"],
        _starts(family),
        first["description"].replace(names, numbers),
    )


def _starts(family: Sequence[Mapping[str, Any]]) -> str:
    """Return the family's start values, once where all are the same."""
    if family[0]["type"] in {"String", "Binary"}:
        starts = [repr(variable["start"]) for variable in family if variable["start"]]
    else:
        starts = " ".join(variable["start"] for variable in family).split()
    if len(set(starts)) == 1:
        return starts[0]
    return " ".join(starts[:MOST_STARTS]) + (" …" if len(starts) > MOST_STARTS else "")
