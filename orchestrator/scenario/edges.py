"""Edges in tables (CSV): who sends, who receives, by what weight, and where that is written."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from nrs_cosim.bus.numerals import decimal, whole
from nrs_cosim.bus.text import not_utf8, quoted
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.tables.values import MOST_ROBOTS


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
    if number > MOST_ROBOTS:
        raise ScenarioError(f"{where}: expected at most {MOST_ROBOTS} robots, got {quoted(text)}")
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
            why = f"expected another source, robot {sink} cannot receive from itself"
            raise ScenarioError(f"{here}: {why}")
        before = lines.get((source, sink))
        if before is not None:
            raise ScenarioError(
                f"{here}: the edge from {source} to {sink} has been given before, in line "
                f"{before}; give it once, with the sum of the weights"
            )
        lines[source, sink] = arrow.line
        kept.append(arrow)
    return kept


def read_edges(data: bytes, where: str) -> list[Arrow]:
    """Return the edges of a table with columns source, sink and, perhaps, weight, in any order."""
    try:
        lines = csv.reader(data.decode("utf-8-sig").splitlines(), strict=True)
        cells = ((lines.line_num, [cell.strip() for cell in row]) for row in lines)
        table = [(line, row) for line, row in cells if row not in ([], [""])]
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{where}: cannot be read: {not_utf8(error)}") from None
    except csv.Error as error:
        raise ScenarioError(f"{where}: not valid CSV: {error}") from None
    head = table[0][1] if table else []
    if sorted(head) not in (["sink", "source"], ["sink", "source", "weight"]):
        raise ScenarioError(
            f"{where}: expected the columns source,sink or source,sink,weight in its first line, "
            f"separated by commas, got {quoted(','.join(head))}"
        )
    return [_arrow(line, head, row, f"{where}: line {line}") for line, row in table[1:]]


def _arrow(line: int, head: Sequence[str], row: Sequence[str], here: str) -> Arrow:
    if len(row) != len(head):
        raise ScenarioError(f"{here}: expected {len(head)} values, got {quoted(','.join(row))}")
    cell = dict(zip(head, row, strict=True))
    return Arrow(
        node_number(cell["source"], f"{here}: source"),
        node_number(cell["sink"], f"{here}: sink", 1),
        positive(cell.get("weight", "1"), f"{here}: weight"),
        line,
    )


def written(arrows: Iterable[Arrow]) -> bytes:
    """Return edges as a table, by sink and source."""
    rows = sorted((arrow.sink, arrow.source, arrow.weight) for arrow in arrows)
    lines = (f"{source},{sink},{weight!r}" for sink, source, weight in rows)
    return "\n".join(["source,sink,weight", *lines, ""]).encode()
