"""Networks in files of others: a table of edges (CSV), or GraphML, as a list of edges.

A scenario must be whole where its text goes: into a recording, and to hosts that have no files. So
when its file is read, the edges take the place of the name of the file that they are in.
"""

import csv
from collections.abc import Iterable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

from orchestrator.errors import ScenarioError

Weighted = tuple[int, int, float]
"""Source, 0 for the target; sink; weight."""
_HOLE = "edges {} that take the place of a file's name"
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
    tables: list[str] = []
    for where, digraph in _digraphs("network", document.get("network")):
        given = [(key, value) for key, value in digraph.items() if key not in _BESIDE]
        if len(given) != 1:
            continue
        ((form, name),) = given
        if form not in _READ or not isinstance(name, str):
            continue
        edges = _edges_of(folder / name, form, f"{origin}: {where}.{form}: {name}")
        del digraph[form]
        digraph["edge_list"] = _HOLE.format(len(tables))
        tables.append(_rows(edges))
    if not tables:
        return text
    text = tomlkit.dumps(document)
    for number, table in enumerate(tables):
        text = text.replace(f'"{_HOLE.format(number)}"', table, 1)
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


def _edges_of(path: Path, form: str, where: str) -> list[Weighted]:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise ScenarioError(f"{where}: no such file; it is relative to the scenario's") from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise ScenarioError(f"{where}: cannot be read: {why}") from None
    edges = _READ[form](data, where)
    if not edges:
        raise ScenarioError(f"{where}: has no edge; robot 1 at least must hear the target, 0")
    return edges


def _rows(edges: Iterable[Weighted]) -> str:
    """Return edges as TOML, by sink and source; 1 is the weight of an edge without one."""
    rows = (
        f"  [{source}, {sink}]," if weight == 1 else f"  [{source}, {sink}, {weight!r}],"
        for source, sink, weight in sorted(edges, key=lambda edge: (edge[1], edge[0]))
    )
    return "\n".join(["[", *rows, "]"])


def _of_csv(data: bytes, where: str) -> list[Weighted]:
    """Read columns source, sink and, perhaps, weight, in any order."""
    try:
        lines = csv.reader(data.decode("utf-8-sig").splitlines(), strict=True)
        table = [(lines.line_num, [cell.strip() for cell in row]) for row in lines if row]
    except UnicodeDecodeError:
        raise ScenarioError(f"{where}: cannot be read: it is no text in UTF-8") from None
    except csv.Error as error:
        raise ScenarioError(f"{where}: not valid CSV: {error}") from None
    head = table[0][1] if table else []
    if sorted(head) not in (["sink", "source"], ["sink", "source", "weight"]):
        raise ScenarioError(
            f"{where}: expected the columns source,sink or source,sink,weight in its first line, "
            f"got {','.join(head)!r}"
        )
    edges = []
    for line, row in table[1:]:
        here = f"{where}: line {line}"
        if len(row) != len(head):
            raise ScenarioError(f"{here}: expected {len(head)} values, got {','.join(row)!r}")
        cell = dict(zip(head, row, strict=True))
        edges.append(
            (
                _node(cell["source"], f"{here}: source"),
                _node(cell["sink"], f"{here}: sink", 1),
                _number(cell.get("weight", "1"), f"{here}: weight"),
            )
        )
    return edges


def _of_graphml(data: bytes, where: str) -> list[Weighted]:
    """Read a graph whose nodes are 0 … n; an edge without direction is one each way."""
    try:
        import networkx  # noqa: PLC0415, an extra
    except ImportError:
        raise ScenarioError(
            f"{where}: reading it needs networkx, which is not installed: "
            "pip install '.[graphs]' in nrs-cosim's sources; or give network.edges, a CSV file"
        ) from None
    try:
        graph = networkx.read_graphml(BytesIO(data))
    except (networkx.NetworkXError, SyntaxError, ValueError, KeyError, StopIteration) as error:
        raise ScenarioError(f"{where}: not valid GraphML: {error}") from None
    edges = []
    for source, sink, values in graph.edges(data=True):
        weight = _number(values.get("weight", 1.0), f"{where}: edge {source} to {sink}: weight")
        ends = _node(source, f"{where}: node"), _node(sink, f"{where}: node")
        ways = [ends] if graph.is_directed() else [ends, ends[::-1]]
        if graph.is_directed() and not ends[1]:
            raise ScenarioError(
                f"{where}: edge {source} to {sink}: the target, 0, hears nobody; turn it round"
            )
        edges += [(j, i, weight) for j, i in ways if i]
    alone = {_node(node, f"{where}: node") for node in graph} - {0, *(i for _, i, _ in edges)}
    if alone:
        raise ScenarioError(f"{where}: no edge leads to robot {min(alone)}, which hears nobody")
    return edges


def _node(text: Any, where: str, least: int = 0) -> int:
    try:
        number = int(text)
    except ValueError:
        number = -1
    if number < least:
        target = "" if least else "0, the target, or "
        raise ScenarioError(f"{where}: expected {target}the number of a robot, got {text!r}")
    return number


def _number(text: Any, where: str) -> float:
    try:
        number = float(text)
    except (TypeError, ValueError):
        number = 0.0
    if not 0 < number < float("inf"):
        raise ScenarioError(f"{where}: expected a number above 0, got {text!r}")
    return number


_READ = {"edges": _of_csv, "graphml": _of_graphml}
