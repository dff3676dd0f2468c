"""A network by rule, by edges or from a file is the digraph that its definition says."""

import json

import numpy as np
import pytest

from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.file import parse_scenario, read_scenario
from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema
from nrs_cosim.recordings.mcap.reader import Reader
from tests.orchestrator.networks import PAPERS, generator, on, read_on
from tests.scenarios import SCENARIOS, SHORT, toml, write


def edges_of(scenario):
    """Return the edges (j, i) of a scenario with their weights."""
    t = scenario.topologies.links
    edges = zip(t.source.tolist(), t.sink.tolist(), strict=True)
    return dict(zip(edges, t.weight.tolist(), strict=True))


def generated(seed=1, **keys):
    return edges_of(on(generator(**keys), {"run.seed": seed}))


def reached(edges):
    """Return the nodes to which a path leads from the target, by repeated relaxation."""
    nodes = {0}
    while more := {i for j, i in edges if j in nodes} - nodes:
        nodes |= more
    return nodes


def dense(edges, n):
    """Return the adjacency and pinning of edges."""
    full = np.zeros((n, n + 1))
    for (j, i), weight in edges.items():
        full[i - 1, j] = weight
    return {"adjacency": full[:, 1:].tolist(), "pinning": full[:, 0].tolist()}


def test_a_ring_a_path_and_a_star():
    assert generated(kind="ring", n=4).keys() == {(0, 1), (4, 1), (1, 2), (2, 3), (3, 4)}
    assert generated(kind="path", n=4).keys() == {(0, 1), (1, 2), (2, 3), (3, 4)}
    assert generated(kind="star", n=4).keys() == {(0, 1), (1, 2), (1, 3), (1, 4)}
    assert generated(kind="path", n=1) == {(0, 1): 1.0}
    edges = generated(kind="ring", n=3, pinned=[2, 3], weight=0.5)
    assert edges == dict.fromkeys([(0, 2), (0, 3), (3, 1), (1, 2), (2, 3)], 0.5)


@pytest.mark.parametrize(
    ("n", "k", "pinned"), [(2, 1, [1]), (40, 3, [1]), (40, 1, [17]), (9, 8, [9, 2]), (300, 5, [7])]
)
def test_in_a_random_network_each_robot_has_k_neighbours_and_a_path_from_the_target(n, k, pinned):
    for seed in range(5):
        edges = generated(seed, kind="random_k_in", n=n, k=k, pinned=pinned)
        among = [edge for edge in edges if edge[0]]
        assert sorted(i for j, i in edges if not j) == sorted(pinned)
        assert len(among) == n * k
        assert np.bincount([i for _, i in among], minlength=n + 1)[1:].tolist() == [k] * n
        assert all(j != i and 1 <= j <= n for j, i in among)
        first = {edge for edge in edges if edge != (0, pinned[0]) and edge[0]} | {(0, pinned[0])}
        assert reached(first) == set(range(n + 1))


def test_neighbours_in_a_random_network_are_spread_over_all_robots():
    edges = generated(kind="random_k_in", n=2000, k=4)
    received = np.array([j for j, _ in edges if j])
    halves = np.mean(received > 1000)
    # one of four is drawn below i, so above 1000 in (1 − ln 2)/2 of the cases; three are uniform
    expected = (3 * 0.5 + (1 - np.log(2)) / 2) / 4
    assert abs(halves - expected) < 4 * 0.5 / np.sqrt(len(received))


@pytest.mark.parametrize(("n", "k"), [(3, 1), (7, 3), (50, 2), (400, 4)])
def test_a_small_world_keeps_its_ring_and_its_number_of_edges(n, k):
    ring = {(i, i % n + 1) for i in range(1, n + 1)}
    for rewire in (0, 0.3, 1) if k > 1 else (0,):
        edges = generated(kind="small_world", n=n, k=k, rewire=rewire, pinned=[n])
        among = {edge for edge in edges if edge[0]}
        assert len(among) == 2 * n * k
        assert {(i, j) for j, i in among} == among
        assert ring <= among
        assert all(j != i for j, i in among)
        far = sum(min((i - j) % n, (j - i) % n) > k for j, i in among) / 2
        if not rewire:
            assert far == 0
        elif n == 400:
            count = n * (k - 1)
            away = 1 - 2 * k / (n - 1)
            assert abs(far / count - rewire * away) < 4 * 0.5 / np.sqrt(count) + 0.01


def test_a_random_network_depends_on_the_seed_alone():
    for keys in ({"kind": "random_k_in", "k": 3}, {"kind": "small_world", "k": 3, "rewire": 0.5}):
        again = [generated(seed, n=50, **keys) for seed in (1, 2, 1)]
        assert again[0] == again[2]
        assert again[0] != again[1]


def test_generated_networks_agree_with_networkx():
    networkx = pytest.importorskip("networkx")

    def same(ours, theirs):
        both = theirs if theirs.is_directed() else theirs.to_directed()
        assert {(j - 1, i - 1) for j, i in ours if j} == set(both.edges)

    same(generated(kind="ring", n=9), networkx.cycle_graph(9, create_using=networkx.DiGraph))
    same(generated(kind="path", n=9), networkx.path_graph(9, create_using=networkx.DiGraph))
    lattice = networkx.watts_strogatz_graph(20, 6, 0)
    same(generated(kind="small_world", n=20, k=3, rewire=0), lattice)
    for kind in ("random_k_in", "small_world"):
        graph = networkx.DiGraph(list(generated(kind=kind, n=200, k=2)))
        assert networkx.descendants(graph, 0) == set(range(1, 201))


def test_every_form_of_a_network_gives_the_same_run(tmp_path):
    ours = generated(kind="random_k_in", n=6, k=2, weight=0.5)
    rows = [[j, i, weight] for (j, i), weight in ours.items()]
    lines = [f"{i},{weight!r},{j}" for j, i, weight in reversed(rows)]
    (tmp_path / "net.csv").write_text("\n".join(["sink,weight,source", *lines]), "utf-8")
    networks = [
        generator(kind="random_k_in", n=6, k=2, weight=0.5),
        dense(ours, 6),
        {"edge_list": rows},
        {"edges": "net.csv"},
    ]
    digests = set()
    for number, network in enumerate(networks):
        with Reader(run(read_on(network, tmp_path), tmp_path / f"{number}.mcap").path) as reader:
            digests.add(reader.digest)
    assert len(digests) == 1


def test_a_ring_of_a_hundred_runs_to_its_end(tmp_path):
    outcome = run(read_scenario(SCENARIOS / "ring_100.toml"), tmp_path / "ring.mcap")
    assert (outcome.status, outcome.ticks) == ("completed", 50)


def test_the_edges_of_a_file_travel_beside_the_unchanged_text(tmp_path):
    lines = [f"{j},{i}" for j, i in PAPERS]
    (tmp_path / "a.csv").write_text(
        "\ufeffsource,sink\r\n" + "\r\n\r\n \t \r\n".join(lines), "utf-8"
    )
    rest = toml(SHORT, {"network": None})
    for form in (
        f"{rest}\n[network]\nedges = 'a.csv'  # who\n",
        f"network.edges = 'a.csv'\n{rest}",
    ):
        (tmp_path / "net.toml").write_text(form, "utf-8")
        file = read_scenario(tmp_path / "net.toml")
        again = parse_scenario(file.text, "again", SCENARIOS / "nowhere", "again", file.assets)
        assert again.scenario == file.scenario
        assert edges_of(again) == dict.fromkeys(sorted(PAPERS), 1.0)
        assert again.scenario.n == 6
        assert file.text == form


def test_a_comment_does_not_matter_to_a_file_of_edges(tmp_path):
    (tmp_path / "a.csv").write_text("source,sink\n0,1\n1,2\n", "utf-8")
    path = write(tmp_path / "net.toml", SHORT, {"network": {"edges": "a.csv"}})
    comment = '# "edges 0 that take the place of a file\'s name"\n'
    path.write_text(comment + path.read_text("utf-8"), "utf-8")
    assert edges_of(read_scenario(path)) == {(0, 1): 1.0, (1, 2): 1.0}


def test_graphml_is_read_as_networkx_writes_it(tmp_path):
    networkx = pytest.importorskip("networkx")
    graph = networkx.DiGraph()
    graph.add_weighted_edges_from([(j, i, 0.5 + i) for j, i in PAPERS])
    networkx.write_graphml(graph, tmp_path / "net.graphml")
    path = write(tmp_path / "net.toml", SHORT, {"network": {"graphml": "net.graphml"}})
    assert edges_of(read_scenario(path)) == {(j, i): 0.5 + i for j, i in PAPERS}
    networkx.write_graphml(networkx.path_graph(4), tmp_path / "net.graphml")
    both = {(0, 1), (1, 2), (2, 1), (2, 3), (3, 2)}
    assert edges_of(read_scenario(path)).keys() == both
    for wrong, result in {
        "a": "expected 0, the target, or the number of a robot, got 'a'",
        "-1": "a robot, got '-1'",
        "7": "no edge leads to robot 7",
    }.items():
        graph = networkx.DiGraph(PAPERS)
        graph.add_node(wrong)
        networkx.write_graphml(graph, tmp_path / "net.graphml")
        with pytest.raises(ScenarioError, match=result):
            read_scenario(path)
    networkx.write_graphml(networkx.DiGraph([*PAPERS, (1, 0)]), tmp_path / "net.graphml")
    with pytest.raises(ScenarioError, match="edge 1 to 0: the target, 0, receives from none"):
        read_scenario(path)
    (tmp_path / "net.graphml").write_text("<graphml><no", "utf-8")
    with pytest.raises(ScenarioError, match=r"network\.graphml: net\.graphml: not valid GraphML"):
        read_scenario(path)


@pytest.mark.parametrize(
    ("lines", "result"),
    [
        (
            "",
            "expected the columns source,sink or source,sink,weight in its first line, separated",
        ),
        ("0,1", "got '0,1'"),
        ("source,sink", "has no edge"),
        ("source,sink\n0,1\n1", "line 3: expected 2 values, got '1'"),
        ("source,sink\n0,x", "line 2: sink: expected the number of a robot, got 'x'"),
        ("source,sink\n0,1\n1,0", "line 3: sink: expected the number of a robot, got '0'"),
        ("source,sink,weight\n0,1,0", "line 2: weight: expected a number above 0, got '0'"),
        ("source,sink,weight\n0,1,nan", "line 2: weight: expected a number above 0, got 'nan'"),
        ("source;sink\n0;1", "in its first line, separated by commas, got 'source;sink'"),
        (
            "source,sink\n0,1\n1,1",
            "line 3: expected another source, robot 1 cannot receive from it",
        ),
        ("source,sink\n0,1\n,", "line 3: source: expected 0, the target, or the number of a rob"),
        (
            "source,sink\n0,1\n1,100001",
            "line 3: sink: expected at most 100000 robots, got '100001'",
        ),
        ("source,sink\n0,1_0", "line 2: sink: expected the number of a robot, got '1_0'"),
        ("source,sink\n0,١", "line 2: sink: expected the number of a robot, got '١'"),
        ("source,sink,weight\n0,1,1_0", "line 2: weight: expected a number above 0, got '1_0'"),
        ("source,sink,weight\n0,1,١", "line 2: weight: expected a number above 0, got '١'"),
        ("source,sink,weight\n0,1,infinity", "weight: expected a number above 0, got 'infinity'"),
        (
            "source,sink\n0,1\n1,2\n1,2",
            "line 4: the edge from 1 to 2 has been given before, in line 3",
        ),
    ],
)
def test_a_wrong_table_of_edges_names_the_line(tmp_path, lines, result):
    (tmp_path / "net.csv").write_text(lines, "utf-8")
    with pytest.raises(ScenarioError) as error:
        read_on({"edges": "net.csv"}, tmp_path)
    assert result in str(error.value)


K_IN = {"kind": "random_k_in", "n": 5, "k": 2}


@pytest.mark.parametrize(
    ("network", "result"),
    [
        ({}, "expected one of adjacency (with pinning), generator, edge_list, edges, graphml, p"),
        ({"edge_list": [[0, 1]], "pinning": [1]}, "got pinning and edge_list; keep one of them"),
        ({"adjacency": [[0]]}, "network.pinning: missing, it has no default beside"),
        ({"pinning": [1]}, "network.adjacency: missing, it has no default beside"),
        ({"edges": "a.csv"}, "network.edges: 'a.csv' is read where a scenario file is, and did no"),
        ({"edge_list": []}, "network.edge_list: expected at least one, got []"),
        ({"edge_list": [[0, 1], [1]]}, "edge_list[1]: expected [source, sink] or [source, sink, w"),
        (
            {"edge_list": [[0, 1], [1, 0]]},
            "network.edge_list[1][1]: expected greater than or equal",
        ),
        ({"edge_list": [[0, 1, 0.0]]}, "network.edge_list[0][2]: expected greater than 0, got 0.0"),
        ({"edge_list": [[0, 1], [1, 1]]}, "network.edge_list[1]: expected another source, robot 1"),
        ({"edge_list": [[0, 1], [2, 3]]}, "no path leads from the target to robots 2-3; let"),
        (
            {"edge_list": [[0, 1, 1e308], [2, 1, 1e308], [1, 2]]},
            "that of what robot 1 receives is not",
        ),
        ({"edge_list": [[0, 1000000000]]}, "network.edge_list[0][1]: expected less than or equal"),
        (generator(kind="path", n=20, pinned=[20]), "robots 1-19 (19 robots)"),
        (generator(kind="ring", n=1), "network.generator.n: expected at least 2 robots in a ring"),
        (generator(kind="ring", n=0), "network.generator.n: expected greater than or equal to 1"),
        (generator(kind="ring", n=9, k=2), "network.generator.k: is of random_k_in and small_worl"),
        (generator(kind="tree", n=9), "network.generator.kind: expected 'ring', 'path', 'star'"),
        (generator(kind="small_world", n=9), "network.generator.k: missing"),
        (generator(**K_IN | {"k": 5}), "expected at most 4 for random_k_in of 5 robots, got 5"),
        (generator(**K_IN, rewire=0.1), "network.generator.rewire: is of small_world, not of rand"),
        (generator(kind="small_world", n=5, k=3), "expected at most 2 for small_world of 5 robots"),
        (generator(kind="small_world", n=5, k=1, rewire=0.1), "expected 0 with k = 1"),
        (generator(**K_IN, pinned=[6]), "network.generator.pinned[0]: expected 1 to 5, got 6"),
        (generator(**K_IN, pinned=[2, 2]), "pinned: expected each robot once, got [2, 2]"),
        (generator(**K_IN, pinned=[]), "network.generator.pinned: expected at least one, got []"),
        (generator(kind="random_k_in", n=100_000, k=5000), "expected n k of at most 10000000"),
    ],
)
def test_a_wrong_network_names_field_value_and_remedy(network, result):
    with pytest.raises(ScenarioError) as error:
        on(network)
    assert result in str(error.value)


def test_a_topology_is_built_once_and_read_only():
    scenario = on(generator(kind="ring", n=10_000))
    topology = scenario.topologies.links
    assert scenario.topologies.links is topology
    assert len(topology.source) == 10_001
    assert topology.steps().tolist() == list(range(1, 10_001))
    with pytest.raises(ValueError, match="read-only"):
        topology.weight[0] = 2.0


def test_the_schema_knows_the_forms_of_a_network():
    schema = json.dumps(json_schema())
    for key in ("generator", "edge_list", "edges", "graphml", "rewire", "random_k_in"):
        assert f'"{key}"' in schema


@pytest.mark.parametrize(
    ("network", "result"),
    [
        ({"edges": 3}, "network.edges: expected a valid string, got 3"),
        ({"edges": "a.csv", "edge_list": [[0, 1]]}, "got edge_list and edges; keep one of them"),
        ({"edges": "a.csv", "pinning": [1]}, "got pinning and edges; keep one of them"),
    ],
)
def test_no_file_is_read_for_a_network_that_is_wrong_by_itself(tmp_path, network, result):
    with pytest.raises(ScenarioError) as error:
        read_on(network, tmp_path)
    assert result in str(error.value)
    assert "no such file" not in str(error.value)


def test_all_files_that_are_missing_are_named_at_once(tmp_path):
    network = {"position": {"edges": "p.csv"}, "velocity": {"graphml": "v.graphml"}}
    target = {"kind": "sampled", "file": "t.csv"}
    path = write(tmp_path / "net.toml", {"network": network, "target": target})
    with pytest.raises(ScenarioError) as error:
        read_scenario(path)
    assert str(error.value).splitlines() == [
        f"{path}: {field}: {name}: no such file; it is relative to the scenario's"
        for field, name in (
            ("network.position.edges", "p.csv"),
            ("network.velocity.graphml", "v.graphml"),
            ("target.file", "t.csv"),
        )
    ]
