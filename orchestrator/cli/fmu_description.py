"""What a person sees of an FMU: what it is, whether it runs here, and a line for each variable.

The scalars of a family such as `q[1]`, `q[2]` are one line.
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


def show_description(console: Console, description: Mapping[str, Any]) -> None:
    """Show what `Archive.describe` says."""
    grid(console, dict(_lines(description)))
    families = [
        list(family)
        for _, family in groupby(description["variables"], lambda v: v["name"].partition("[")[0])
    ]
    console.print()
    table(console, _COLUMNS, (tuple(map(escape, _row(family))) for family in families))
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


def _row(family: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    first = family[0]
    return (
        first["name"].partition("[")[0] if len(family) > 1 or first["shape"] else first["name"],
        _CAUSALITIES.get(first["causality"], first["causality"]),
        str(sum(prod(variable["shape"]) for variable in family)),
        first["unit"],
        _starts(family),
        first["description"],
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
