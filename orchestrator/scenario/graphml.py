"""A network in GraphML: what the standard says of it is applied, or refused by name and line.

Nodes are 0, the target, to n; an edge leads from who sends to who receives, and an edge without
direction is one each way, but that the target receives from nobody. `weight`, an edge's number of
that name, is 1 unless the file's key says otherwise. Text says nothing of the digraph and is passed
over, as is what an editor draws by; any other attribute might, so that it is refused.

The standard: http://graphml.graphdrawing.org/specification.html
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from lxml import etree

from nrs_cosim.bus.plurals import any_of
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.edges import Arrow, node_number, positive

NAMESPACE = "{http://graphml.graphdrawing.org/xmlns}"
_ATTRIBUTES = {
    "graphml": set[str](),
    "key": {"id", "for", "attr.name", "attr.type", "yfiles.type"},
    "graph": {"id", "edgedefault"},
    "node": {"id"},
    "edge": {"id", "source", "target", "directed"},
    "data": {"id", "key"},
    "default": set[str](),
}
"""What we know of the standard's elements; `parse.…` is of a graph and a node too."""
_CHILDREN = {
    "graphml": {"desc", "key", "data", "graph"},
    "key": {"desc", "default"},
    "graph": {"desc", "data", "node", "edge"},
    "node": {"desc", "data"},
    "edge": {"desc", "data"},
}
_WHY_NOT = {
    "graph": "a network is one graph, and none within another",
    "hyperedge": "a sample goes from one node to one other; give edges",
    "port": "a robot receives over edges between nodes; leave ports out",
    "locator": "what is elsewhere is not fetched; give its content here",
}
_SCOPES = ("all", "graphml", "graph", "node", "edge", "hyperedge", "port", "endpoint")
_NUMBERS = ("int", "long", "float", "double")
_TYPES = ("boolean", *_NUMBERS, "string")
_TRUTH = {"true": True, "1": True, "false": False, "0": False}
_DRAWING = frozenset({"x", "y", "z", "r", "g", "b", "size", "width", "height", "thickness"})
"""Numbers that layout programs write."""
_OURS = re.compile("weight|^pin", re.IGNORECASE)
"""Names that speak of the network, in any spelling."""


@dataclass(frozen=True, slots=True)
class _Key:
    """An attribute that elements of a kind may have."""

    name: str
    scope: str
    kind: str
    default: str | None

    def is_of(self, element: str) -> bool:
        return self.scope in {element, "all"}

    @property
    def is_weight(self) -> bool:
        return self.name == "weight" and self.is_of("edge")

    @property
    def says_nothing(self) -> bool:
        """Whether it cannot be meant as a part of the digraph."""
        if _OURS.search(self.name):
            return False
        return self.kind == "string" or self.name.lower() in _DRAWING


def arrows_of(data: bytes, where: str) -> list[Arrow]:
    """Return the directed edges of a GraphML file; `ScenarioError` begins with `where`."""
    root = _parsed(data, where)
    if _name(root) != "graphml":
        raise ScenarioError(
            f"{where}: not valid GraphML: its root is {quoted(root.tag)}, not 'graphml'"
        )
    _expect_known(root, where)
    keys = _keys(root, where)
    graphs = [child for child in root if _name(child) == "graph"]
    if len(graphs) != 1:
        at = f"line {graphs[1].sourceline}: " if graphs else ""
        raise ScenarioError(f"{where}: {at}expected one graph, got {len(graphs)}")
    for element in (root, graphs[0]):
        _values(element, keys, where)
    return _arrows(graphs[0], keys, where)


def _parsed(data: bytes, where: str) -> Any:
    """Return the root of a document that declares no entities, nor defaults of attributes."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise ScenarioError(f"{where}: not valid GraphML: {error}") from None
    declared = root.getroottree().docinfo.internalDTD
    if declared is not None and (any(declared.iterentities()) or any(declared.iterelements())):
        raise ScenarioError(f"{where}: declares entities or elements of its own; leave them out")
    return root


def _name(element: Any) -> str:
    """Return an element's name in the standard, also where its namespace is left out."""
    return str(element.tag).removeprefix(NAMESPACE)


def _expect_known(element: Any, where: str) -> None:
    """Raise for an attribute or a child of an element that we know nothing of."""
    name = _name(element)
    here = f"{where}: line {element.sourceline}"
    for attribute in element.attrib:
        known = attribute in _ATTRIBUTES[name] or attribute.startswith(("{", "parse."))
        if not known:
            hint = "; give it as <data> of a <key>" if attribute.lower() == "weight" else ""
            raise ScenarioError(f"{here}: {name}: unknown attribute {quoted(attribute)}{hint}")
    for child in element.iterchildren(tag=etree.Element):
        if _name(child) not in _CHILDREN.get(name, ()):
            why = _WHY_NOT.get(_name(child), "no such element is known there")
            raise ScenarioError(f"{where}: line {child.sourceline}: {_name(child)}: {why}")


def _keys(root: Any, where: str) -> dict[str, _Key]:
    """Return the attributes that a file declares, by their id."""
    keys: dict[str, _Key] = {}
    for element in root:
        if _name(element) != "key":
            continue
        here = f"{where}: line {element.sourceline}: key"
        _expect_known(element, where)
        attributes = element.attrib
        ident, scope = _given(element, "id", here), attributes.get("for", "all")
        kind, name = attributes.get("attr.type", "string"), attributes.get("attr.name", "")
        if ident in keys:
            raise ScenarioError(f"{here}: {quoted(ident)} has been declared before")
        for said, value, known in (("for", scope, _SCOPES), ("attr.type", kind, _TYPES)):
            if value not in known:
                raise ScenarioError(
                    f"{here}: {said}: expected {any_of(known)}, got {quoted(value)}"
                )
        default = next((child for child in element if _name(child) == "default"), None)
        key = keys[ident] = _Key(
            name, scope, kind, None if default is None else _text(default, where)
        )
        if key.is_weight and kind not in _NUMBERS:
            raise ScenarioError(
                f"{here}: weight: expected attr.type {any_of(_NUMBERS)}, got {quoted(kind)}"
            )
    weights = [ident for ident, key in keys.items() if key.is_weight]
    if len(weights) > 1:
        raise ScenarioError(f"{where}: keys {any_of(weights)} are all an edge's weight; keep one")
    return keys


def _values(element: Any, keys: Mapping[str, _Key], where: str) -> str | None:
    """Return the text of an element's weight, its own or the default; None for neither."""
    name, here = _name(element), f"{where}: line {element.sourceline}: {_name(element)}"
    _expect_known(element, where)
    own: dict[str, str] = {}
    for data in element:
        if _name(data) != "data":
            continue
        ident = _given(data, "key", f"{where}: line {data.sourceline}: data")
        key = keys.get(ident)
        if key is None or not key.is_of(name):
            why = "is declared nowhere" if key is None else f"is of {key.scope}, not of {name}"
            raise ScenarioError(f"{here}: data of the key {quoted(ident)}, which {why}")
        if ident in own:
            raise ScenarioError(f"{here}: has two data of the key {quoted(ident)}")
        own[ident] = "" if key.says_nothing else _text(data, where)
    weight = None
    for ident, key in keys.items():
        value = own.get(ident, key.default)
        if value is None or not key.is_of(name) or key.says_nothing:
            continue
        if not (key.is_weight and name == "edge"):
            raise ScenarioError(f"{here}: {_unknown(name, key, ident)}, got {quoted(value)}")
        weight = value
    return weight


def _unknown(element: str, key: _Key, ident: str) -> str:
    """Say what an attribute is that might be a part of the network, and is none we know."""
    named = f"attribute {quoted(key.name or ident)}"
    if element == "edge":
        return f"{named}: an edge has a number 'weight' and no other; rename it, or leave it out"
    if element == "node":
        return f"{named}: an edge from node 0 is how a robot receives from the target; leave it out"
    return f"{named}: a {element} has none; leave it out"


def _arrows(graph: Any, keys: Mapping[str, _Key], where: str) -> list[Arrow]:
    by_default = _either(graph, "edgedefault", {"directed": True, "undirected": False}, where)
    nodes: dict[str, int] = {}
    numbers: set[int] = set()
    edges: list[Any] = []
    for element in graph:
        if _name(element) == "node":
            here = f"{where}: line {element.sourceline}: node"
            _values(element, keys, where)
            ident = _given(element, "id", here)
            number = node_number(ident, here)
            if number in numbers:
                raise ScenarioError(f"{here}: {quoted(ident)} has been given before")
            nodes[ident] = number
            numbers.add(number)
        elif _name(element) == "edge":
            edges.append(element)
    for what, there in (("nodes", len(nodes)), ("edges", len(edges))):
        if graph.get(f"parse.{what}", str(there)) != str(there):
            raise ScenarioError(
                f"{where}: graph: parse.{what} = {quoted(graph.get(f'parse.{what}'))}, but it has "
                f"{there}; is the file whole?"
            )
    arrows = [arrow for edge in edges for arrow in _ways(edge, nodes, by_default, keys, where)]
    alone = {*nodes.values()} - {0, *(arrow.sink for arrow in arrows)}
    if alone:
        why = f"no edge leads to robot {min(alone)}, which receives from no other"
        raise ScenarioError(f"{where}: {why}")
    return arrows


def _ways(
    element: Any, nodes: Mapping[str, int], by_default: bool, keys: Mapping[str, _Key], where: str
) -> Iterator[Arrow]:
    """Yield the directed edges that an edge is, those from which somebody receives."""
    here, line = f"{where}: line {element.sourceline}: edge", element.sourceline
    text = _values(element, keys, where)
    named = [_given(element, end, here) for end in ("source", "target")]
    for name in named:
        if name not in nodes:
            raise ScenarioError(f"{here}: {quoted(name)} is no node of the graph")
    source, sink = (nodes[name] for name in named)
    here = f"{here} {source} to {sink}"
    weight = positive("1" if text is None else text, f"{here}: weight")
    directed = "directed" not in element.attrib and by_default
    if "directed" in element.attrib:
        directed = _either(element, "directed", _TRUTH, where)
    if not sink and (directed or not source):
        raise ScenarioError(f"{here}: the target, 0, receives from none; turn it round")
    for j, i in ((source, sink),) if directed else ((source, sink), (sink, source)):
        if i:
            yield Arrow(j, i, weight, line)


def _either(element: Any, attribute: str, known: Mapping[str, bool], where: str) -> bool:
    """Return which of two values an attribute has."""
    here = f"{where}: line {element.sourceline}: {_name(element)}"
    given = _given(element, attribute, here).strip()
    if given not in known:
        raise ScenarioError(
            f"{here}: {attribute}: expected {any_of([*known])}, got {quoted(given)}"
        )
    return known[given]


def _given(element: Any, attribute: str, here: str) -> str:
    value = element.get(attribute)
    if value is None:
        raise ScenarioError(f"{here}: {attribute}: missing, it has no default")
    return str(value)


def _text(element: Any, where: str) -> str:
    """Return what stands in an element that has text alone."""
    if len(element):
        raise ScenarioError(
            f"{where}: line {element.sourceline}: {_name(element)}: expected text, got an element"
        )
    return str(element.text or "").strip()
