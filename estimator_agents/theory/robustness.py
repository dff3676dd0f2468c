"""Whether robots can agree though some of them lie: (r, s)-robust digraphs.

A digraph is (r, s)-robust when of any two disjoint sets S_1, S_2 of its nodes, neither empty, all
of S_1, or all of S_2, or s in both together have r in-neighbours or more outside of their own set.
H. J. LeBlanc, H. Zhang, X. Koutsoukos, S. Sundaram, IEEE JSAC 31(4), 766-781, 2013, Definition 6.

X(S), how many of S have r in-neighbours outside, is counted for each of the 2^n sets. What decides
is the least X(S_1) + X(S_2) of two disjoint sets in both of which not all have: the least X over
the subsets of each set, found for all sets at once, one node after the other, plus that of its
complement.

Beside a target that is trusted robots come to it if those that receive it, and then again and again
those that receive from 2 F + 1 of these, are all (statement B2): what J. Usevitch, D. Panagou,
Resilient leader-follower consensus to arbitrary reference values, American Control Conference 2018,
call strongly (2 F + 1)-robust with respect to those that receive it.
"""

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.topology import Topology

MOST = 16
"""Robots, of which 2^n sets are looked at."""
_NONE = 2**30
"""More than any number of nodes."""


def robustness(topology: Topology) -> int | None:
    """Return the largest r for which the digraph among the robots is (r, r)-robust.

    None where it is not computed, of more than `MOST` robots; the target is no node of it.
    """
    n = topology.n
    if n > MOST:
        return None
    among = topology.source > 0
    received = np.zeros(n, np.int64)
    np.bitwise_or.at(received, topology.sink[among] - 1, 1 << (topology.source[among] - 1))
    sets = np.arange(2**n, dtype=np.int64)
    outside = np.bitwise_count(received[:, None] & ~sets)
    r = 0
    while r < -(-n // 2) and _is_robust(outside, sets, r + 1):
        r += 1
    return r


def out_of_reach(topology: Topology, many: int) -> int:
    """Return how many robots are not reached from the target by in-neighbours, `many` of each."""
    source, sink = topology.source, topology.sink
    reached = np.zeros(topology.n + 1, bool)
    received = np.zeros(topology.n + 1, np.int64)
    new = np.unique(sink[source == 0])
    order = np.argsort(source, kind="stable")
    first = np.searchsorted(source[order], np.arange(topology.n + 2))
    while len(new):
        reached[new] = True
        of_new = [order[first[robot] : first[robot + 1]] for robot in new]
        receive = sink[np.concatenate(of_new)]
        np.add.at(received, receive, 1)
        new = np.unique(receive[(received[receive] >= many) & ~reached[receive]])
    return topology.n - int(reached.sum())


def _is_robust(outside: NDArray[np.uint8], sets: NDArray[np.int64], r: int) -> bool:
    """Return whether it is (r, r)-robust, from in-neighbours outside of each set, (n, 2^n)."""
    n = len(outside)
    members = (sets >> np.arange(n)[:, None]) & 1 == 1
    many = ((outside >= r) & members).sum(axis=0)
    least = np.where(many < members.sum(axis=0), many, _NONE)
    for node in range(n):
        with_it = least.reshape(-1, 2, 2**node)
        np.minimum(with_it[:, 1], with_it[:, 0], out=with_it[:, 1])
    return bool((least + least[::-1]).min() >= r)
