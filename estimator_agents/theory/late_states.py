"""What is under way over late links, as further states of a recursion.

The states are x, field f of robot i + 1 as number f n + i, and then V x_j(t_{k−1}), V x_j(t_{k−2}),
… of each robot j, as far back as its links need, where F G S = U V is of rank r.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import FEW, Matrix, as_array, components, identity_like
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep
from nrs_cosim.estimator_agents.theory.solving import solve

Array = NDArray[np.float64]
Delays = NDArray[np.int64]
Edges = NDArray[np.integer[Any]]

DENSE = 600
"""The order of a block of a matrix up to which it is solved densely."""

TRIED = 500
"""Vectors that are tried for a proof about a larger block."""

Entries = list[tuple[NDArray[np.integer], NDArray[np.integer], Array]]
"""Of a matrix: rows, columns and values, which add up where they meet."""


class Past:
    """The states of a recursion whose edges are late."""

    def __init__(
        self, step: LinearStep, topology: Topology, delay: Delays, longest: Delays | None = None
    ) -> None:
        """Take the delay of each edge, (E,), and the longest that there is at some time."""
        self.U, self.V = factors(step.received)
        """(s, r) and (r, s): F G S = U V."""
        self._step, self.delay = step, delay
        self.source, self.sink = topology.source - 1, topology.sink - 1
        """(E,) of each edge, robots from 0; the target is −1."""
        self.n, self.s, self.r = topology.n, len(step.fields), self.U.shape[1]
        depth = np.zeros(self.n + 1, np.int64)
        np.maximum.at(depth, topology.source, delay if longest is None else longest)
        depth[0] = 0
        ends = self.r * np.cumsum(depth)[1:]
        self._depth, self._first = depth[1:], self.s * self.n + ends - self.r * depth[1:]
        self.size = self.s * self.n + int(ends[-1])
        """The number of states."""

    def signal(self, edges: Edges) -> Entries:
        """Return V x_j(t_{k−d}) of edges, r rows for each one after the other, from 0."""
        at, r = np.arange(len(edges)) * self.r, self.r
        late = self.delay[edges] > 0
        entries: Entries = []
        for here in (late, ~late):
            some, rows = (
                edges[here & (self.source[edges] >= 0)],
                at[here & (self.source[edges] >= 0)],
            )
            j, ones = self.source[some], np.ones(len(some))
            if here is late:
                first = self._first[j] + r * (self.delay[some] - 1)
                entries += [(rows + b, first + b, ones) for b in range(r)]
            else:
                entries += [
                    (rows + b, f * self.n + j, self.V[b, f] * ones)
                    for b, f in np.argwhere(self.V).tolist()
                ]
        return entries

    def own(self) -> Entries:
        """Return F K ⊗ I."""
        n = np.arange(self.n)
        return [
            (a * self.n + n, f * self.n + n, np.full(self.n, self._step.own[a, f]))
            for a, f in np.argwhere(self._step.own).tolist()
        ]

    def kept(self) -> Entries:
        """Return what moves on by a period: V x_j(t_k) is V x_j(t_{k+1−1}), and so on."""
        entries: Entries = []
        for b in range(self.r):
            j = np.flatnonzero(self._depth)
            entries += [
                (self._first[j] + b, f * self.n + j, np.full(len(j), self.V[b, f]))
                for f in np.flatnonzero(self.V[b])
            ]
            # Row d of a robot is row d − 1 of before: all rows but each robot's first.
            rows = np.setdiff1d(np.arange(self.s * self.n, self.size, self.r), self._first[j])
            entries.append((rows + b, rows + b - self.r, np.ones(len(rows))))
        return entries

    def received(self, edges: Edges, weight: Array) -> Entries:
        """Return Σ over edges of their weights times U V x_j(t_{k−d}), in the rows of x."""
        entries: Entries = []
        for rows, columns, values in self.signal(edges):
            edge, b = rows // self.r, rows % self.r
            for a in range(self.s):
                entries.append(
                    (
                        a * self.n + self.sink[edges[edge]],
                        columns,
                        weight[edge] * self.U[a, b] * values,
                    )
                )
        return entries

    def assembled(self, entries: Entries) -> Matrix:
        """Return the matrix of entries, (size, size)."""
        rows, columns, values = (np.concatenate(part) for part in zip(*entries, strict=True))
        if self.size <= 2 * FEW:
            dense = np.zeros((self.size, self.size))
            np.add.at(dense, (rows, columns), values)
            return dense
        from scipy import sparse  # noqa: PLC0415, as in `bus.matrices`

        found = sparse.csr_array((values, (rows, columns)), shape=(self.size, self.size))
        found.eliminate_zeros()
        return found


def factors(received: Array) -> tuple[Array, Array]:
    """Return U, (s, r), and V, (r, s), with F G S = U V and as small an r as there is.

    Zeros stay where they are if no r smaller than the number of columns in use is.
    """
    used = np.flatnonzero(received.any(axis=0))
    rank = int(np.linalg.matrix_rank(received)) if len(used) else 0
    if rank == len(used):
        return received[:, used], np.eye(received.shape[1])[used]
    left, sizes, right = np.linalg.svd(received)
    return left[:, :rank] * sizes[:rank], right[:rank]


def block_radius(A: Matrix) -> float:
    """Return ρ of a matrix, by its strongly connected components; not a number if not found."""
    parts = components(A)
    lone = np.array([part[0] for part in parts if len(part) == 1], np.intp)
    found = [float(np.abs(A.diagonal()[lone]).max(initial=0.0))]
    found += [_of_block(A[part][:, part]) for part in parts if len(part) > 1]
    return max(found, key=lambda radius: (np.isnan(radius), radius))


def is_proven(A: Matrix, radius: float) -> bool:
    """Return whether it is proven that ρ is on the side of 1 where the radius above is.

    It is of blocks that are solved densely. What Arnoldi's method finds of larger ones may not be
    the largest; of those without negative entries A x < x, or A x ≥ x, with some x > 0 proves it.
    """
    large = [part for part in components(A) if len(part) > DENSE]
    found = [_side(A[part][:, part], radius) for part in large]
    if radius < 1:
        return all(found)
    return not large or any(found)


def _of_block(block: Matrix) -> float:
    if block.shape[0] <= DENSE:
        return float(np.abs(np.linalg.eigvals(as_array(block))).max())
    from scipy.sparse.linalg import ArpackError, eigs  # noqa: PLC0415, as above

    try:
        found = eigs(block, 1, v0=np.ones(block.shape[0]), return_eigenvectors=False)
    except ArpackError:
        return float("nan")
    return float(np.abs(found).max())


def _side(block: Matrix, radius: float) -> bool:
    """Return whether some positive vector shows that ρ of a block is below 1, or is not."""
    if block.min() < 0:
        return False
    x = np.ones(block.shape[0])
    if radius < 1:
        x = solve(identity_like(block) - block, x)
        return bool(x.min() > 0 and (block @ x < x).all())
    for _ in range(TRIED):
        after = block @ x
        if (after >= x).all():
            return True
        x = (after + x) / after.max()  # of A + I, whose powers have no period
    return False
