"""Random digraphs with a spanning tree from the target, alone and in turn, and rings."""

import numpy as np
from hypothesis import strategies as st

from nrs_cosim.bus.topologies import InteractionGraphs
from nrs_cosim.bus.topology import Topology


@st.composite
def digraphs(draw: st.DrawFn, most: int = 7, least: int = 1) -> Topology:
    """Draw weights for a random tree from the target, and for some more edges."""
    n = draw(st.integers(least, most))
    weight = st.floats(0.1, 5.0)
    adjacency, pinning = np.zeros((n, n)), np.zeros(n)
    for i in range(n):
        parent = draw(st.integers(0, i))
        if parent:
            adjacency[i, parent - 1] = draw(weight)
        else:
            pinning[i] = draw(weight)
    for _ in range(draw(st.integers(0, 2 * n))):
        i, j = draw(st.integers(0, n - 1)), draw(st.integers(0, n - 1))
        if i != j:
            adjacency[i, j] = draw(weight)
    order = np.array(draw(st.permutations(range(n))))
    return Topology.of(adjacency[np.ix_(order, order)], pinning[order])


@st.composite
def exchanges(draw: st.DrawFn, most: int = 5, turns: int = 3) -> list[InteractionGraphs]:
    """Draw some exchanges of the same robots, of one digraph or of two."""
    n = draw(st.integers(1, most))
    found = []
    for _ in range(draw(st.integers(1, turns))):
        position = draw(digraphs(n, n))
        apart = draw(st.booleans())
        found.append(InteractionGraphs(position, draw(digraphs(n, n)) if apart else position))
    return found


def ring(n: int, both: bool) -> Topology:
    """Return a ring that receives one way or both, with robot 1 pinned; edges sorted by (i, j)."""
    robot = np.arange(1, n + 1)
    sides = [np.roll(robot, 1), np.roll(robot, -1)] if both else [np.roll(robot, 1)]
    source = np.concatenate([[0], *sides])
    sink = np.concatenate([[1], *(robot for _ in sides)])
    order = np.lexsort((source, sink))
    return Topology(n, source[order], sink[order], np.ones(len(order)))


def drawn(rng: np.random.Generator, n: int) -> Topology:
    """Return a random tree from the target over n robots, with some more edges."""
    adjacency = np.where(rng.random((n, n)) < 0.3, rng.uniform(0.1, 5, (n, n)), 0)
    np.fill_diagonal(adjacency, 0)
    pinning = np.where(rng.random(n) < 0.2, rng.uniform(0.1, 5, n), 0)
    order = rng.permutation(n)
    for place, i in enumerate(order):
        parent = rng.integers(0, place + 1)
        if parent:
            adjacency[i, order[parent - 1]] = rng.uniform(0.1, 5)
        else:
            pinning[i] = rng.uniform(0.1, 5)
    return Topology.of(adjacency, pinning)
