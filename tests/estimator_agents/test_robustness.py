"""(r, r)-robustness of digraphs against the definition read aloud, and known graphs."""

from itertools import product

import networkx as nx
import numpy as np
import pytest

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.theory.robustness import MOST, out_of_reach, robustness
from nrs_cosim.estimator_agents.wmsr import Wmsr


def topology_of(graph):
    """Return a digraph of networkx, whose nodes are 0 … n − 1, with the target received by one."""
    edges = [(j + 1, i + 1) for j, i in graph.to_directed().edges] + [(0, 1)]
    source, sink = np.array(edges).T
    return Topology.of_edges(graph.number_of_nodes(), source, sink, np.ones(len(edges)))


def by_definition(graph):
    """Return the largest r for which all pairs of disjoint sets are as they must be."""
    digraph = graph.to_directed()
    nodes = sorted(digraph)

    def reached(chosen, r):
        return {i for i in chosen if len(set(digraph.predecessors(i)) - chosen) >= r}

    def is_robust(r):
        for sides in product((0, 1, 2), repeat=len(nodes)):
            one, two = ({i for i, s in zip(nodes, sides, strict=True) if s == k} for k in (1, 2))
            if one and two:
                x, y = reached(one, r), reached(two, r)
                if x != one and y != two and len(x) + len(y) < r:
                    return False
        return True

    return max(r for r in range(len(nodes) + 1) if r == 0 or is_robust(r))


def test_random_digraphs_are_as_the_definition_says():
    found = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 7))
        graph = nx.gnp_random_graph(n, float(rng.uniform(0.3, 1)), seed=seed, directed=True)
        found.append(robustness(topology_of(graph)))
        assert found[-1] == by_definition(graph), seed
    assert {*found} == {0, 1, 2, 3}


@pytest.mark.parametrize(
    ("graph", "r"),
    [
        *((nx.complete_graph(n), (n + 1) // 2) for n in (1, 2, 3, 4, 7, 8, 11)),
        (nx.path_graph(5, create_using=nx.DiGraph), 1),
        (nx.cycle_graph(6), 1),
        (nx.cycle_graph(16), 1),
        (nx.cycle_graph(17), None),
        (nx.star_graph(6), 1),
        (nx.disjoint_union(nx.complete_graph(4), nx.complete_graph(4)), 0),
        # with a node of 2 r - 1 neighbours more it is as (r, r)-robust as before (Theorem 5 there)
        (nx.compose(nx.complete_graph(7), nx.star_graph([7, 0, 1, 2, 3, 4])), 3),
        (nx.circulant_graph(8, [1, 2]), 2),
    ],
)
def test_known_graphs(graph, r):
    graph = nx.convert_node_labels_to_integers(graph)
    assert robustness(topology_of(graph)) == r


def test_two_complete_graphs_with_a_perfect_matching_are_connected_well_and_robust_hardly():
    """Their connectivity is n / 2, and yet no robot receives from two of the other half."""
    graph = nx.disjoint_union(nx.complete_graph(4), nx.complete_graph(4))
    graph.add_edges_from((i, i + 4) for i in range(4))
    assert nx.node_connectivity(graph) == 4
    assert robustness(topology_of(graph)) == 1


def test_of_many_robots_it_is_not_computed_and_the_condition_says_so():
    topology = topology_of(nx.complete_graph(MOST + 1))
    assert robustness(topology) is None
    of_graph, of_liars, _ = Wmsr(1).graph_conditions(topology, frozenset({2}))
    assert not of_graph.holds
    assert np.isnan(of_graph.margin)
    assert of_liars.holds


def test_one_liar_more_than_f_is_received():
    topology = topology_of(nx.complete_graph(7))
    many = [
        [c.left for c in Wmsr(1, trusts_target=False).graph_conditions(topology, frozenset(liars))]
        for liars in ([], [3], [3, 5], [1, 2, 3, 4, 5, 6, 7])
    ]
    assert many == [[1, 0], [1, 1], [1, 2], [1, 0]]
    for F, liars, holds in ((2, {3, 5}, [True, True]), (4, set(), [False, True])):
        found = Wmsr(F, trusts_target=False).graph_conditions(topology, frozenset(liars))
        assert [c.holds for c in found] == holds


def test_random_digraphs_reach_all_where_each_set_has_one_that_receives_enough_from_outside():
    """Of each set of robots one receives the target, or r of the robots that are not in it."""
    found = []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        n, r = int(rng.integers(2, 7)), int(rng.integers(1, 4))
        received = rng.random((n, n + 1)) < rng.uniform(0.3, 0.9)
        received[:, 1:][np.eye(n, dtype=bool)] = False
        received[rng.integers(n), 0] = True
        sink, source = np.nonzero(received)
        topology = Topology.of_edges(n, source, sink + 1, np.ones(len(sink)))
        reached = all(
            any(
                received[i, 0] or received[i, 1:][~chosen].sum() >= r
                for i in np.flatnonzero(chosen)
            )
            for chosen in map(np.array, product((False, True), repeat=n))
            if chosen.any()
        )
        found.append(out_of_reach(topology, r) == 0)
        assert found[-1] == reached, seed
    assert 100 < sum(found) < 250
