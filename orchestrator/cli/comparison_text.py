"""What a person sees of a run beside the theory, from what is told of it as JSON."""

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Column

from nrs_cosim.orchestrator.cli.links_text import noise_sentence
from nrs_cosim.orchestrator.cli.tables import grid, table

NEAR = 0.01
"""By how much a measured spectral radius may differ without a word."""
_COLUMNS = ("measured", "steady state", "worst case", "paper")

Compared = Mapping[str, Any]
"""See `orchestrator.analysis.comparison.TheoryComparison.as_json`, or a quantity of it."""


def theory_comparison(console: Console, compared: Compared) -> None:
    """Show a run's measurements beside the theory's bounds, and its status."""
    if compared["why_not"]:
        rows = {"theory": f"has no bounds for this run: {compared['why_not']}"}
        if compared["noise"]:
            rows["noise"] = noise_sentence(compared["noise"])
        if of := compared["mean_squares"]:
            shown = (
                f"{one['name']} {one['measured']:.4g}, expected {one['expected']:.4g}" for one in of
            )
            rows["rms"] = f"in the last fifth {'; '.join(shown)} (statement L6)"
        grid(console, rows)
        return
    lines = [
        (
            row["name"],
            *map(number, (row["measured"], row["bounds"]["steady_state"])),
            number(row["bounds"]["worst_case"]),
            stated(row["bounds"]["paper"], unproven=bool(row["unproven"])),
            _status(row),
        )
        for row in compared["quantities"]
    ]
    seen, computed = compared["measured_radius"], compared["spectral_radius"]
    if seen is not None and computed is not None:
        lines.append(("rho", f"{seen:.4f}", f"{computed:.4f}", "", "", "each tick"))
    columns = (Column(title, justify="right") for title in _COLUMNS)
    table(console, (Column("last fifth"), *columns, Column()), lines)
    grid(console, _beside(compared))


def stated(paper: float | None, *, unproven: bool) -> str:
    """Show the paper's bound, and whether it does not follow from the paper's proof."""
    return number(paper) + ", [yellow]unproven[/]" * (unproven and paper is not None)


def number(value: float | None) -> str:
    """Show a number, or that there is none."""
    return "-" if value is None else f"{value:.4g}"


def _status(row: Compared) -> str:
    """Show whether a measurement is within what is proven."""
    where = f", at k = {row['tick']}" if row["status"] == "exceeded" else ""
    colour = {"within": "green", "exceeded": "red"}.get(row["status"], "yellow")
    return f"[{colour}]{row['status']}{where}[/]"


def _beside(compared: Compared) -> dict[str, str]:
    """Return lines on what is above a bound of the steady state and yet breaks none."""
    rows, left = {}, compared["transient"]
    known = [row for row in compared["quantities"] if row["status"] != "exceeded"]
    over = [row for row in known if {*row["above"]} - {"paper"}]
    loose = [row["name"] for row in known if [*row["above"]] == ["paper"]]
    if left is not None or over:
        if compared["steady_since"] is not None:
            begun = (
                "outages, or digraphs of before, last into the last fifth, and bounds are of the "
                f"steady state from {compared['steady_since']:g} s on"
            )
        elif left is None:
            begun = "what the initial error still contributes is not known"
        else:
            begun = f"the initial error still contributes up to {left:.4g}"
        above = "".join(f"; {row['name']} is above {' and '.join(row['above'])}" for row in over)
        rows["transient"] = f"{begun}{above}"
    if compared["untracked"]:
        rows["bounds"] = f"none of tracking: {compared['untracked']}"
    if loose:
        rows["paper"] = f"{' and '.join(loose)} above it: its bounds of tracking are not proven"
    seen, computed = compared["measured_radius"], compared["spectral_radius"]
    if seen is not None and computed is not None and abs(seen - computed) > NEAR:
        rows["rho"] = "the computed one is of the steady state, and this run's is not near it"
    return rows
