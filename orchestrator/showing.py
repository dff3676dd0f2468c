"""What a person sees in a terminal: the progress of a run, its summary, the theory's verdict."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from orchestrator.checking import Check
from orchestrator.clock import Clock, seconds


class _SimulatedTime(ProgressColumn):
    def render(self, task: Task) -> Text:
        speed = f"{task.speed:.3g} x real time" if task.speed else ""
        return Text(f"t = {task.completed:g} of {task.total:g} s  {speed}")


@contextmanager
def progress(console: Console, clock: Clock) -> Iterator[Callable[[float], None]]:
    """Show simulated time, speed and time left while a run goes on, on a terminal only."""
    columns = (BarColumn(), _SimulatedTime(), TimeRemainingColumn(compact=True))
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("run", total=seconds(clock.t(clock.ticks)))
        yield lambda t: bar.update(task, completed=t)


def summary(console: Console, lines: Mapping[str, str]) -> None:
    """Show short lines by name."""
    for name, line in lines.items():
        console.print(f"[bold]{name:<10}[/] {escape(line)}")


def check(console: Console, checked: Check) -> None:
    """Show the theory's verdict on a scenario."""
    spectrum = ", ".join(_complex(*s) for s in checked.spectrum)
    verdict = "converges" if checked.spectral_radius < 1 else "diverges"
    summary(
        console,
        {
            "algorithm": checked.algorithm,
            "digraph": "has a spanning tree rooted at the target (A2)",
            "spectrum": f"of D: {spectrum}",
            "radius": f"{checked.spectral_radius:.6f} a sampling time: the estimate {verdict}",
        },
    )
    table = Table(box=None, pad_edge=False)
    for title in ("condition", "value", "bound", "margin", "", "source"):
        table.add_column(
            title, justify="right" if title in {"value", "bound", "margin"} else "left"
        )
    for c in checked.conditions:
        mark = "[green]holds[/]" if c.holds else "[red]fails[/]"
        numbers = (f"{c.left:g}", f"{c.right:.6f}", f"{c.margin:+.6f}")
        table.add_row(c.name, *numbers, mark, c.source)
    console.print()
    console.print(table)


def archive(console: Console, told: Mapping[str, Any]) -> None:
    """Show what an FMU offers."""
    summary(console, {name: str(value) for name, value in told.items() if name != "variables"})
    table = Table(box=None, pad_edge=False)
    for title in ("variable", "causality", "size", "unit", "start", "description"):
        table.add_column(title)
    for variable in told["variables"]:
        table.add_row(*(escape(str(value)) for value in variable.values()))
    console.print()
    console.print(table)


def _complex(real: float, imaginary: float) -> str:
    return f"{real:.6g}" if not imaginary else f"{real:.6g}{imaginary:+.6g}j"
