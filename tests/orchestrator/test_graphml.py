"""GraphML means what its standard says, or is refused by name: each construct has a case."""

import pytest

from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.edges import expect_distinct
from nrs_cosim.orchestrator.scenario.graphml import arrows_of

HEAD = '<graphml xmlns="http://graphml.graphdrawing.org/xmlns">'
WEIGHT = '<key id="w" for="edge" attr.name="weight" attr.type="double"/>'
NODES = '<node id="0"/><node id="1"/><node id="2"/>'
EDGES = '<edge source="0" target="1"/><edge source="1" target="2"/>'
LINE = {(0, 1): 1.0, (1, 2): 1.0}


def document(body=NODES + EDGES, keys="", head=HEAD, graph='edgedefault="directed"'):
    return f"{head}{keys}<graph {graph}>{body}</graph></graphml>"


def edges_of(text):
    found = expect_distinct(arrows_of(text.encode(), "net.graphml"), "net.graphml")
    return {(a.source, a.sink): a.weight for a in found}


def edge(source, sink, more="", inside=""):
    return f'<edge source="{source}" target="{sink}" {more}>{inside}</edge>'


def weight_key(default="", scope='for="edge"', kind='attr.type="double"'):
    return f'<key id="w" {scope} attr.name="weight" {kind}>{default}</key>'


WEIGHED = NODES + edge(0, 1) + edge(1, 2, "", '<data key="w"> 2.5 </data>')


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (document(), LINE),
        (document(head="<graphml>"), LINE),
        (
            document(head='<?xml version="1.0"?><!DOCTYPE graphml SYSTEM "graphml.dtd">' + HEAD),
            LINE,
        ),
        (document(EDGES + NODES), LINE),
        (document("<!-- who -->" + NODES + "<desc>a line</desc>" + EDGES), LINE),
        (document(graph='edgedefault="undirected"'), LINE | {(2, 1): 1.0}),
        (
            document(NODES + edge(1, 0) + edge(1, 2), graph='edgedefault="undirected"'),
            LINE | {(2, 1): 1.0},
        ),
        # the type of `directed` is xs:boolean, which has four words
        (document(NODES + edge(0, 1) + edge(1, 2, 'directed="false"')), LINE | {(2, 1): 1.0}),
        (document(NODES + edge(0, 1) + edge(1, 2, 'directed="0"')), LINE | {(2, 1): 1.0}),
        (
            document(
                NODES + edge(0, 1) + edge(1, 2, 'directed=" 1 "'), graph='edgedefault="undirected"'
            ),
            LINE,
        ),
        (
            document(
                NODES + edge(0, 1) + edge(1, 2, 'directed="true"'), graph='edgedefault="undirected"'
            ),
            LINE,
        ),
        # a default is the value of those that have no data of their own
        (document(WEIGHED, weight_key("<default>3.0</default>")), {(0, 1): 3.0, (1, 2): 2.5}),
        (document(WEIGHED, weight_key()), {(0, 1): 1.0, (1, 2): 2.5}),
        (
            document(
                NODES + edge(0, 1) + edge(1, 2, 'directed="0"'),
                weight_key("<default>3</default>", kind='attr.type="int"'),
            ),
            {(0, 1): 3.0, (1, 2): 3.0, (2, 1): 3.0},
        ),
        (
            document(WEIGHED, '<key id="w" for="all" attr.name="weight" attr.type="float"/>'),
            {(0, 1): 1.0, (1, 2): 2.5},
        ),
        (
            document(WEIGHED, '<key id="w" attr.name="weight" attr.type="float"/>'),
            {(0, 1): 1.0, (1, 2): 2.5},
        ),
        # text and drawing say nothing of who receives from whom
        (
            document(
                '<node id="0"/><node id="1"><data key="l">first</data><data key="x">7</data>'
                '</node><node id="2"/>' + EDGES,
                '<key id="l" for="node" attr.name="label" attr.type="string"/>'
                '<key id="x" for="node" attr.name="x" attr.type="float"/>',
            ),
            LINE,
        ),
        (
            document(
                '<node id="0"/><node id="1"><data key="g"><y:Shape xmlns:y="urn:y"/></data></node>'
                '<node id="2"/>' + EDGES,
                '<key id="g" for="node" yfiles.type="nodegraphics"/>',
            ),
            LINE,
        ),
        (
            document(
                graph='edgedefault="directed" parse.nodes="3" parse.edges="2" parse.order="free"'
            ),
            LINE,
        ),
    ],
)
def test_standard_graphml_constructs_are_applied(text, expected):
    assert edges_of(text) == expected


def key(name, kind="double", scope="edge", default=""):
    default = f"<default>{default}</default>" * bool(default)
    return f'<key id="k" for="{scope}" attr.name="{name}" attr.type="{kind}">{default}</key>'


MARKED = NODES + edge(0, 1, "", '<data key="k">2</data>') + edge(1, 2)
PINNED = '<node id="0"/><node id="1"><data key="k">1</data></node><node id="2"/>' + EDGES


@pytest.mark.parametrize(
    ("text", "result"),
    [
        (
            document(MARKED, key("Weight")),
            "line 1: edge: attribute 'Weight': an edge has a number 'w",
        ),
        (document(MARKED, key("Weight", "string")), "edge: attribute 'Weight'"),
        (
            document(MARKED, key("delay", "int")),
            "attribute 'delay': an edge has a number 'weight' an",
        ),
        (document(MARKED, key("active", "boolean")), "attribute 'active'"),
        (
            document(keys=key("delay", default="3")),
            "attribute 'delay': an edge has a number 'weight'",
        ),
        (
            document(MARKED, key("weight", "string")),
            "key: weight: expected attr.type int, long, floa",
        ),
        (
            document(MARKED, key("weight", "vector")),
            "key: attr.type: expected boolean, int, long, fl",
        ),
        (
            document(PINNED, key("pinning", scope="node")),
            "node: attribute 'pinning': an edge from node 0 is how",
        ),
        (
            document(PINNED, key("weight", scope="node")),
            "node: attribute 'weight': an edge from node 0 is how",
        ),
        (
            document(keys=key("leader", "boolean", "node", "false")),
            "node: attribute 'leader': an edge from node 0 is how",
        ),
        (
            document("<data key='k'>2</data>" + NODES + EDGES, key("scale", scope="graph")),
            "graph: attribute 'scale': a graph has none",
        ),
        (
            document(PINNED, key("weight")),
            "node: data of the key 'k', which is of edge, not of node",
        ),
        (document(MARKED), "edge: data of the key 'k', which is declared nowhere"),
        (
            document(keys=key("weight", scope="link")),
            "key: for: expected all, graphml, graph, node",
        ),
        (document(keys=key("weight") * 2), "key: 'k' has been declared before"),
        (document(keys=key("weight") + WEIGHT), "keys k or w are all an edge's weight; keep one"),
        (
            document(
                NODES + edge(0, 1, "", "<data key='k'>1</data>" * 2) + edge(1, 2), key("weight")
            ),
            "edge: has two data of the key 'k'",
        ),
        (
            document(NODES + edge(0, 1, "", "<data key='k'><v/></data>"), key("weight")),
            "data: expected text, got an element",
        ),
        (
            document(NODES + edge(0, 1, 'weight="3"') + edge(1, 2)),
            "edge: unknown attribute 'weight'; give it as <data> of a <key>",
        ),
        (
            document(NODES + edge(0, 1, 'directed="yes"') + edge(1, 2)),
            "edge: directed: expected true, 1, false or 0, got 'yes'",
        ),
        (
            document(NODES + edge(0, 1, 'sourceport="p"') + edge(1, 2)),
            "edge: unknown attribute 'sourceport'",
        ),
        (document(graph=""), "graph: edgedefault: missing, it has no default"),
        (
            document(graph='edgedefault="mixed"'),
            "edgedefault: expected directed or undirected, got",
        ),
        (
            document(graph='edgedefault="directed" parse.edges="3"'),
            "parse.edges = '3', but it has 2",
        ),
        (
            document().replace("</graphml>", '<graph edgedefault="directed"/></graphml>'),
            "line 1: expected one graph, got 2",
        ),
        (f"{HEAD}</graphml>", "net.graphml: expected one graph, got 0"),
        (
            document(NODES.replace('"2"/>', '"2"><graph edgedefault="directed"/></node>') + EDGES),
            "graph: a network is one graph, and none within another",
        ),
        (
            document(NODES + edge(0, 1, "", '<graph edgedefault="directed"/>') + edge(1, 2)),
            "graph: a network is one graph, and none within another",
        ),
        (
            document(NODES + EDGES + '<hyperedge><endpoint node="1"/></hyperedge>'),
            "hyperedge: a sam",
        ),
        (
            document(NODES.replace('"2"/>', '"2"><port name="in"/></node>') + EDGES),
            "port: a robot r",
        ),
        (document("<locator/>"), "locator: what is elsewhere is not fetched"),
        (document(NODES + EDGES + "<arc/>"), "arc: no such element is known there"),
        (
            document(NODES + EDGES + edge(1, 2)),
            "the edge from 1 to 2 has been given before, in line",
        ),
        (
            document(
                NODES + edge(0, 1) + edge(1, 2) + edge(2, 1), graph='edgedefault="undirected"'
            ),
            "the edge from 2 to 1 has been given before",
        ),
        (
            document(NODES + EDGES + edge(2, 2)),
            "expected another source, robot 2 cannot receive from itself",
        ),
        (
            document(NODES + EDGES + edge(2, 0)),
            "edge 2 to 0: the target, 0, receives from none; turn it",
        ),
        (
            document(NODES + EDGES + edge(0, 0, 'directed="0"')),
            "edge 0 to 0: the target, 0, receives from n",
        ),
        (document(NODES + EDGES + edge(2, 3)), "edge: '3' is no node of the graph"),
        (document(NODES + '<node id="01"/>' + EDGES), "node: '01' has been given before"),
        (document(NODES + '<node id="1_0"/>' + EDGES), "or the number of a robot, got '1_0'"),
        (
            document(NODES + '<node id="3"/>' + EDGES),
            "no edge leads to robot 3, which receives from no other",
        ),
        (document("<node/>"), "node: id: missing"),
        *(
            (
                document(
                    NODES + edge(0, 1, "", f"<data key='w'>{bad}</data>") + edge(1, 2), WEIGHT
                ),
                f"edge 0 to 1: weight: expected a number above 0, got {bad!r}",
            )
            for bad in ("0", "-1", "1_0", "١", "NaN", "INF", "infinity", "1e999", "")
        ),
        (
            '<!DOCTYPE graphml [<!ENTITY n "1">]>' + document(),
            "declares entities or elements of its",
        ),
        (
            '<!DOCTYPE graphml [<!ATTLIST edge directed CDATA "0"><!ELEMENT edge ANY>]>'
            + document(),
            "declares entities or elements of its own",
        ),
        ("<gexf/>", "not valid GraphML: its root is 'gexf', not 'graphml'"),
        ("<graphml><no", "net.graphml: not valid GraphML: "),
    ],
)
def test_an_ambiguous_graphml_construct_is_refused_by_name(text, result):
    with pytest.raises(ScenarioError) as error:
        edges_of(text)
    assert result in str(error.value)


def test_an_error_names_the_line_of_a_construct():
    text = document().replace("><", ">\n<").replace("</graph>", "<hyperedge/></graph>")
    with pytest.raises(ScenarioError, match=r"^net\.graphml: line 8: hyperedge"):
        edges_of(text)
