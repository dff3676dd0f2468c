"""The digraph of the paper's example, and small ones drawn by hand."""

import numpy as np
import pytest

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.bus.topology import Topology

PAPER = (
    [
        [0, 1, 1, 0, 0, 0],
        [1, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0],
        [1, 0, 1, 0, 0, 0],
        [0, 1, 1, 1, 0, 0],
        [0, 0, 1, 0, 0, 0],
    ],
    [0, 0, 1, 0, 0, 0],
)


def test_the_papers_topology_has_the_papers_neighbours():
    topology = Topology.of(*PAPER)
    received = {robot: topology.in_neighbours(robot).tolist() for robot in range(1, 7)}
    assert received == {1: [2, 3], 2: [1], 3: [0], 4: [1, 3], 5: [2, 3, 4], 6: [3]}
    assert topology.unreached() == []


def test_normalised_weights_sum_to_one_for_each_robot():
    adjacency = np.array([[0, 0.5, 2], [3, 0, 0], [0, 0, 0]])
    topology = Topology.of(adjacency, [1, 0, 4])
    assert topology.in_degree.tolist() == [3.5, 3, 4]
    B = np.diag([3.5, 3, 4])
    assert np.array_equal(as_array(topology.D), np.linalg.inv(B) @ adjacency)
    assert np.bincount(topology.sink, topology.normalised)[1:] == pytest.approx([1, 1, 1])


def test_edges_are_sorted_by_robot_then_in_neighbour():
    topology = Topology.of(*PAPER)
    edges = list(zip(topology.sink, topology.source, strict=True))
    assert edges == sorted(edges)


def test_unreached_robots_are_named():
    adjacency = [[0, 0, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1], [0, 0, 1, 0]]
    assert Topology.of(adjacency, [1, 0, 0, 0]).unreached() == [3, 4]
    assert Topology.of(adjacency, [0, 0, 0, 0]).unreached() == [1, 2, 3, 4]


def test_the_papers_strongly_connected_components():
    parts = sorted(sorted((part + 1).tolist()) for part in Topology.of(*PAPER).components())
    assert parts == [[1, 2], [3], [4], [5], [6]]
