"""Dense and sparse matrices of one digraph are one matrix, and have one set of components."""

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from nrs_cosim.bus import matrices
from nrs_cosim.bus.matrices import as_array, components, identity_like, kron, nonzeros
from nrs_cosim.bus.topology import Topology
from tests.estimator_agents.digraphs import digraphs

untimed = settings(deadline=None)  # SciPy is loaded by the first call


@untimed
@given(digraphs(9))
def test_many_robots_have_the_matrices_of_few(topology):
    few = topology.D
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(matrices, "FEW", 0)
        many = topology.D
    assert isinstance(few, np.ndarray)
    assert sparse.issparse(many)
    np.testing.assert_array_equal(few, many.toarray())
    assert nonzeros(few) == nonzeros(many)
    small = np.array([[1.0, 0.5], [0.0, -2.0]])
    for ours, others in (
        (identity_like(few), identity_like(many)),
        (kron(small, few), kron(small, many)),
    ):
        assert isinstance(ours, np.ndarray)
        assert sparse.issparse(others)
        np.testing.assert_array_equal(ours, as_array(others))


@pytest.mark.parametrize("kind", [np.asarray, sparse.csr_array])
@untimed
@given(st.integers(1, 12), st.floats(0, 0.4), st.integers(0, 99))
def test_components_are_those_of_another_library(kind, n, share, seed):
    edges = np.random.default_rng(seed).random((n, n)) < share
    others = nx.strongly_connected_components(nx.from_numpy_array(edges, create_using=nx.DiGraph))
    ours = components(kind(edges * 0.5))
    assert sorted(part.tolist() for part in ours) == sorted(sorted(part) for part in others)


def test_a_directed_cycle_of_the_most_dense_rows_is_one_component():
    n = 2 * matrices.FEW
    cycle = np.roll(np.eye(n), 1, axis=1)
    assert [part.tolist() for part in components(cycle)] == [list(range(n))]
    assert len(components(np.triu(cycle))) == n


def test_a_component_of_many_robots_is_found_too():
    n = matrices.FEW + 1
    topology = Topology.of_edges(n, [0, *range(1, n)], range(1, n + 1), np.ones(n))
    assert sparse.issparse(topology.D)
    assert sorted(part.tolist() for part in topology.components()) == [[i] for i in range(n)]
