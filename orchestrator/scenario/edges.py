"""Edges in files of others: who is heard, who hears, by what weight, and where that is written."""

from collections.abc import Iterable
from dataclasses import dataclass

from nrs_cosim.bus.numerals import decimal, whole
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.errors import ScenarioError


@dataclass(frozen=True, slots=True)
class Arrow:
    """A directed edge, and the line of its file that it stands in."""

    source: int
    """0 for the target."""
    sink: int
    weight: float
    line: int


def node_number(text: str, where: str, least: int = 0) -> int:
    """Return the number of a robot, or 0 for the target where `least` is 0."""
    try:
        number = whole(text)
    except ValueError:
        number = -1
    if number < least:
        target = "" if least else "0, the target, or "
        raise ScenarioError(f"{where}: expected {target}the number of a robot, got {quoted(text)}")
    return number


def positive(text: str, where: str) -> float:
    """Return a weight."""
    try:
        number = decimal(text)
    except ValueError:
        number = 0.0
    if not 0 < number < float("inf"):
        raise ScenarioError(f"{where}: expected a number above 0, got {quoted(text)}")
    return number


def expect_distinct(arrows: Iterable[Arrow], where: str) -> list[Arrow]:
    """Return edges of which none leads from a robot to itself, nor is given twice."""
    lines: dict[tuple[int, int], int] = {}
    kept = []
    for arrow in arrows:
        source, sink, here = arrow.source, arrow.sink, f"{where}: line {arrow.line}"
        if source == sink:
            raise ScenarioError(f"{here}: expected another source, robot {sink} cannot hear itself")
        before = lines.get((source, sink))
        if before is not None:
            raise ScenarioError(
                f"{here}: the edge from {source} to {sink} has been given before, in line "
                f"{before}; give it once, with the sum of the weights"
            )
        lines[source, sink] = arrow.line
        kept.append(arrow)
    return kept
