"""What a person sees in a terminal: a run's summary, the analysis of an experiment."""

from collections.abc import Sequence
from itertools import groupby
from statistics import fmean
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Column

from nrs_cosim.orchestrator.analysis.conclusion import conclusion
from nrs_cosim.orchestrator.cli.comparison_text import number, stated
from nrs_cosim.orchestrator.cli.conclusion_text import conclusion_sentence
from nrs_cosim.orchestrator.cli.tables import findings_table, grid, table
from nrs_cosim.orchestrator.cli.theory_text import ALL_HONEST, bound_rows, convergence_rows
from nrs_cosim.orchestrator.scenario.robot_ids import decimals
from nrs_cosim.orchestrator.terminal import prose

if TYPE_CHECKING:
    from nrs_cosim.estimator_agents.condition import Condition
    from nrs_cosim.orchestrator.analysis.bounds import Bound, UltimateBounds
    from nrs_cosim.orchestrator.analysis.conditions import Check
    from nrs_cosim.orchestrator.cli.doctor import Diagnosis
    from nrs_cosim.orchestrator.engine.run import Profile
    from nrs_cosim.orchestrator.replay.diff import Comparison
    from nrs_cosim.plant_fmu.checking.findings import FmuCheck

_MARKS = {
    "holds": "[green]holds[/]",
    "fails": "[red]does not hold[/]",
    "unknown": "[yellow]unknown[/]",
    "note": "",
    "ok": "[green]ok[/]",
    "warning": "[yellow]warning[/]",
}
_BOUNDS = ("steady state", "worst case", "paper")


def theory_table(
    console: Console, checked: "Check", ultimate: "UltimateBounds", rows: "Sequence[Bound]"
) -> None:
    """Show the analysis of an experiment."""
    prose(console, conclusion_sentence(conclusion(checked, ultimate)))
    console.print()
    grid(console, convergence_rows(checked) | bound_rows(ultimate))
    console.print()
    if checked.impaired and checked.conditions:
        prose(console, "conditions are of links without faults")
    if any(checked.status(condition) == "void" for condition in checked.conditions):
        prose(console, f"void: a condition of {ALL_HONEST} proves nothing here")
    if checked.conditions:
        table(
            console,
            (*_columns("condition", "value", "bound", "margin"), Column(), Column("source")),
            (_condition(c, checked.status(c)) for c in checked.conditions),
        )
    if not ultimate.why_not:
        console.print()
        table(console, _columns("bounds", *_BOUNDS), map(_bounds, rows))


def _columns(first: str, *numbers: str) -> tuple[Column, ...]:
    """Return the columns of a name and of numbers."""
    return (Column(first), *(Column(title, justify="right") for title in numbers))


def _condition(c: "Condition", status: str) -> tuple[str, ...]:
    """Return a row of the conditions."""
    mark = {"holds": _MARKS["holds"], "violated": "[red]fails[/]"}
    bound = f"{'>' if c.at_least else '<'} {decimals(c.bound)}"
    numbers = (f"{c.value:g}", bound, f"{'+' * (c.margin >= 0)}{_margin(c.margin)}")
    if status == "unknown":
        numbers = (numbers[0], "not computed", "")
    source = escape(c.source) + ", [yellow]sampled[/]" * c.sampled
    return escape(c.name), *numbers, mark.get(status, f"[yellow]{status}[/]"), source


def _bounds(row: "Bound") -> tuple[str, ...]:
    """Return a row of bounds."""
    name = f"{row.name}, [yellow]sampled[/]" if row.sampled else row.name
    paper = stated(row.paper, unproven=row.unproven)
    return name, number(row.steady_state), number(row.worst_case), paper


def fmu_findings(console: Console, checked: "FmuCheck") -> None:
    """Show what was found of an FMU, by topic."""
    for topic, found in groupby(checked.findings, lambda finding: finding.topic):
        console.print(f"[bold]{topic}[/]")
        rows = ((finding.name, _MARKS[finding.status], finding.text) for finding in found)
        findings_table(console, rows, (22, 15))


def diagnosis(console: Console, made: "Diagnosis") -> None:
    """Show what a machine is fit for, by topic, and what is to be done where it is not."""
    marks = {**_MARKS, "fails": "[red]fails[/]"}
    for topic, symptoms in groupby(made.symptoms, lambda symptom: symptom.topic):
        console.print(f"[bold]{topic}[/]")
        rows = ((symptom.name, marks[symptom.status], symptom.text) for symptom in symptoms)
        findings_table(console, rows, (20, 9))


def comparison(console: Console, found: "Comparison") -> None:
    """Show what is not the same in two recordings."""
    if found.is_same:
        console.print("the same run: scenario, samples and states, to the last bit")
        return
    for name in found.partial:
        prose(console, f"[bold]{name}[/] lacks messages of its run: they are not compared")
    for kind, (a, b) in found.schemas.items():
        prose(console, f"[bold]{kind}s[/]: {escape(_short(a))} -> {escape(_short(b))}")
    for name, (a, b) in found.fields.items():
        prose(console, f"[bold]{escape(name)}[/]: {escape(_short(a))} -> {escape(_short(b))}")
    if found.first is None:
        here = ", as far as both are here" if found.partial else ""
        console.print(f"the same samples and states, to the last bit{here}")
        return
    if found.ends:
        name, tick = found.ends
        said = f"ends at tick {tick}; up to there samples and states are the same, to the last bit"
        prose(console, f"[bold]{name}[/] {said}")
        return
    prose(console, f"[bold]first[/] {escape(found.first.between('A', 'B'))}")
    moved = [apart for apart in found.distances if apart.largest]
    if not moved:
        return
    rows = (
        (str(a.robot), a.quantity, f"{a.largest:.4g}", f"{a.at:g}", f"{a.rms:.4g}") for a in moved
    )
    numbers = _columns("quantity", "largest |A - B|", "at t, s", "rms")
    console.print()
    table(console, (Column("robot", justify="right"), *numbers), rows)


def _short(value: Any, most: int = 60) -> str:
    text = str(value)
    return text if len(text) <= most else f"{text[:most]} …"


def shares(profile: "Profile", wall: float) -> str:
    """Say in a line on what the workers spent the wall time, s, on average, and the recorder.

    Workers that were stopped did not say.
    """
    names = ("plants", "bus", "waiting") if profile.workers else ()
    mean = [fmean(getattr(spent, name) for spent in profile.workers.values()) for name in names]
    parts = dict(zip(names, mean, strict=True))
    if profile.in_one_thread:
        parts["bus"] += profile.orchestrator.bus
    shares = ", ".join(f"{100 * part / wall:.0f} % {name}" for name, part in parts.items())
    whose = " of a worker's on average;" if len(profile.workers) > 1 else ","
    recording = f"{100 * profile.recording / wall:.0f} % recording"
    return f"{shares}{whose} {recording}" if shares else recording


def profile(console: Console, profile: "Profile", wall: float) -> None:
    """Show where the wall time, s, of each process of a run went."""
    mine = profile.orchestrator
    rows = {name: (s.plants, s.bus, 0.0, s.waiting) for name, s in profile.workers.items()}
    if profile.in_one_thread:
        (name, (plants, bus, _, _)) = rows.popitem()
        rows[name] = plants, bus + mine.bus, profile.recording, mine.waiting
    else:
        rows["orchestrator"] = mine.plants, mine.bus, profile.recording, mine.waiting
    cells = (
        (name, *(f"{part:.3f}" for part in (*parts, max(wall - sum(parts), 0.0))))
        for name, parts in rows.items()
    )
    titles = ("plants", "bus", "recording", "waiting", "other")
    console.print()
    table(console, _columns("s of wall time", *titles), cells)
    if profile.in_one_thread:
        by = f"NumPy, for {profile.numpy_why}" if profile.numpy_why else "native code"
        apart = f"; plants are stepped apart, for {profile.steps_why}" * bool(profile.steps_why)
        console.print(f"ticks are done by {by}{apart}")


def _margin(margin: float) -> str:
    """Return a margin with six decimals; in short where these are zeros and it is not."""
    said = decimals(margin)
    return f"{margin:.2g}" if margin and float(said) == 0 else said
