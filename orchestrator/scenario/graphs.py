"""Networks in files of others: a table of edges (CSV), or GraphML, as a list of edges.

A scenario must be whole where its text goes: into a recording, and to workers that have no files.
So when its file is read, the edges take the place of the name of the file that they are in.
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from secrets import token_hex
from typing import Any

from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.edges import Arrow, expect_distinct, node_number, positive

_FORMS = ("edges", "graphml")
_BESIDE = ("from", "repeat")
"""Keys of a network that are no form of it."""


def with_edges(text: str, folder: Path, origin: str) -> str:
    """Return a scenario's text with the edges of the files that it names, if it names any.

    What else is wrong with the text is left to whoever parses it. `ScenarioError` names the field,
    the file and what is wrong in it.
    """
    if "edges" not in text and "graphml" not in text:
        return text
    import tomlkit  # noqa: PLC0415, 0.05 s that other texts need not wait for
    from tomlkit.exceptions import TOMLKitError  # noqa: PLC0415

    try:
        document = tomlkit.parse(text)
    except (TOMLKitError, ValueError, RecursionError):
        return text
    tables: dict[str, str] = {}
    for where, digraph in _digraphs("network", document.get("network")):
        given = [(key, value) for key, value in digraph.items() if key not in _BESIDE]
        if len(given) != 1:
            continue
        ((form, name),) = given
        if form not in _FORMS or not isinstance(name, str):
            continue
        edges = _edges_of(folder / name, form, f"{origin}: {where}.{form}: {name}")
        del digraph[form]
        # tomlkit takes long to make an item of each number: rows are put in where a word stands
        # that no text has.
        hole = digraph["edge_list"] = token_hex(16)
        tables[f'"{hole}"'] = _rows(edges)
    if not tables:
        return text
    text = tomlkit.dumps(document)
    for hole, table in tables.items():
        text = text.replace(hole, table, 1)
    return text


def _digraphs(where: str, given: Any) -> Iterator[tuple[str, Any]]:
    """Yield the tables in and below one that may name a file, with where they stand."""
    if not isinstance(given, dict):
        return
    yield where, given
    for name in ("position", "velocity"):
        yield from _digraphs(f"{where}.{name}", given.get(name))
    turns = given.get("switching")
    for i, turn in enumerate(turns if isinstance(turns, list) else ()):
        yield from _digraphs(f"{where}.switching[{i}]", turn)


def _edges_of(path: Path, form: str, where: str) -> list[Arrow]:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise ScenarioError(f"{where}: no such file; it is relative to the scenario's") from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise ScenarioError(f"{where}: cannot be read: {why}") from None
    if form == "graphml":
        from nrs_cosim.orchestrator.scenario.graphml import arrows_of  # noqa: PLC0415, it loads lxml

        edges = arrows_of(data, where)
    else:
        edges = _of_csv(data, where)
    if not edges:
        raise ScenarioError(f"{where}: has no edge; robot 1 at least must hear the target, 0")
    return expect_distinct(edges, where)


def _rows(edges: Iterable[Arrow]) -> str:
    """Return edges as TOML, by sink and source; 1 is the weight of an edge without one."""
    rows = (
        f"  [{edge.source}, {edge.sink}{f', {edge.weight!r}' * (edge.weight != 1)}],"
        for edge in sorted(edges, key=lambda edge: (edge.sink, edge.source))
    )
    return "\n".join(["[", *rows, "]"])


def _of_csv(data: bytes, where: str) -> list[Arrow]:
    """Read columns source, sink and, perhaps, weight, in any order."""
    try:
        lines = csv.reader(data.decode("utf-8-sig").splitlines(), strict=True)
        cells = ((lines.line_num, [cell.strip() for cell in row]) for row in lines)
        table = [(line, row) for line, row in cells if row not in ([], [""])]
    except UnicodeDecodeError:
        raise ScenarioError(f"{where}: cannot be read: it is no text in UTF-8") from None
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
