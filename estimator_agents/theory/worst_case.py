"""The worst that any target within γ1 and γ2 does to an error, and the target that does it.

An error in steady state is a functional of the target's past (statement W1): with S for what a
constant velocity makes of it, and N(t) of the recursion,

    x = S υ_0(0) − ∫ N a_0 dt,      sup x = min over u of γ1 TV(u) + γ2 ∫ |u − N| dt,

where |υ_0| ≤ γ1, |a_0| ≤ γ2, and u goes from 0 long ago to S after the end (W2). Every u gives a
bound, and every target is below it. On a grid of cells in which u and a_0 are constant, the
minimum is found exactly: of cell after cell f(u) ← min_v [f(v) + γ1 |u − v|] + w |u − N| is convex
and piecewise linear, and its slopes are kept as masses that lie between −γ1 and γ1. What the grid
leaves out is seen in the difference of bound and target, and the grid is refined.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from heapq import heappop, heappush
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import Matrix, as_array
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.slow_modes import modulus

Array = NDArray[np.float64]
Reals = NDArray[np.floating[Any]]

DENSE, BLOCK = 400, 64
"""Rows of A up to which so many of its powers are made at once."""
LEFT = 1e-13
"""The part of a response at which the past ends."""
PARTS, COARSE = 256, 0.2
"""Of a period at most; and the relative change of N within a cell, at first."""
ROUNDS, NEAR = 4, 1e-3
"""Grids, each four times finer; and how near the bound and a target are to come, relative."""
TOGETHER = 32
"""Errors whose responses are found at once, at most."""
FLOOR = 1e-3
"""The share of the largest N below which its changes count as if it were that large."""


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """How an error in steady state depends on the target: p and r of each period that is past."""

    h: float | Array
    """s, or (J,) of each period."""
    p: Array
    """(J,) of the position error that a period adds, the last period first."""
    r: Array
    """(J,) of the velocity error."""
    drag: Array
    """(2,)"""
    held: float
    """What the target's velocity at the end adds by itself."""

    def pieces(self, coarse: float) -> tuple[Array, Array, Array, float]:
        """Return widths, s, and N at both ends of parts of periods, the oldest first, and S.

        N is linear in each part, and changes little there, relative.
        """
        pulled = np.cumsum((self.p * self.drag[0] + self.r * self.drag[1])[::-1])
        end = self.r[::-1] + pulled
        h: Array = np.broadcast_to(self.h, self.p.shape)[::-1]
        change = h * self.p[::-1]
        size = _sizes(end + change / 2)
        count = np.clip(np.ceil(np.abs(change) / size / coarse), 1, PARTS).astype(np.intp)
        period = np.repeat(np.arange(len(count)), count)
        place = np.arange(len(period)) - np.repeat(np.cumsum(count) - count, count)
        begin = end[period] + change[period] * (1 - place / count[period])
        after = end[period] + change[period] * (1 - (place + 1) / count[period])
        return (h / count)[period], begin, after, float(pulled[-1]) + self.held


def _sizes(N: Array) -> Array:
    """Return the size of each N, or what counts as its size where it is next to nothing."""
    size = np.maximum(np.abs(N), FLOOR * np.abs(N).max(initial=0.0))
    return np.where(size > 0, size, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class ErrorRecursion:
    """x(t_{k+1}) = A x(t_k) + B Δ(k), of whatever depends on one target."""

    h: float
    """s"""
    A: Matrix
    """(p, p)"""
    B: Array
    """(p, 2): what a target's Δ adds to x."""
    drag: Array
    """(2,)"""

    @classmethod
    def of(cls, recursion: Recursion) -> "ErrorRecursion":
        """Return that of the estimates, where every robot's error has the same added."""
        B: Array = np.kron(np.eye(2), np.ones((recursion.n, 1))).astype(np.float64)
        return cls(recursion.h, recursion.matrix, B, recursion.drag[:, 1])


def responses(
    error: ErrorRecursion, seen: Array, held: float, most_periods: int
) -> list[Response] | None:
    """Return the responses of `seen` x, (q, p); None where the past lasts more than so long."""
    block, power = _block(error)
    found: list[Array] = []
    most, rows = np.zeros(len(seen)), seen
    while len(found) * block.shape[1] // 2 < most_periods:
        now = (rows @ block).reshape(len(seen), 2, -1)
        found.append(now)
        size = np.abs(now).max(axis=(1, 2))
        most = np.maximum(most, size)
        if np.all(size <= LEFT * most):
            whole = np.concatenate(found, axis=2)
            return [Response(error.h, p, r, error.drag, held) for p, r in whole]
        rows = rows @ power
    return None


@lru_cache(maxsize=2)
def _block(error: ErrorRecursion) -> tuple[Array, Matrix]:
    """Return A^j B of some j from 0 on, side by side, (p, 2 b), and A^b.

    All that is seen of one recursion, as it is one after another, is seen through these.
    """
    power, block = error.A, error.B[:, :, None]
    if power.shape[0] <= DENSE:
        power = as_array(power)
        while block.shape[2] < BLOCK:
            block = np.concatenate([block, np.tensordot(power, block, axes=1)], axis=2)
            power = power @ power
    return block.reshape(len(block), -1), power


def largest_of(
    error: ErrorRecursion, seen: Array, held: float, gammas: tuple[float, float], periods: int
) -> float | None:
    """Return the worst case of the largest of `seen` x, (q, p); None where it is not computed."""
    found = responses(error, seen, held, periods)
    if found is None:
        return None
    simple = np.array([_without_turns(response, *gammas) for response in found])
    best = 0.0
    for i in np.argsort(-simple).tolist():
        if simple[i] <= best * (1 + NEAR):
            return max(best, float(simple[i]))
        best = max(best, min(float(simple[i]), bound_of(found[i], *gammas, best)))
    return best


def _without_turns(response: Response, gamma_1: float, gamma_2: float) -> float:
    """Return the bound of u = 0: γ1 |S| + γ2 ∫ |N|."""
    widths, begin, end, S = response.pieces(np.inf)
    return gamma_1 * abs(S) + gamma_2 * float(modulus(begin, end, widths).sum())


def bound_of(response: Response, gamma_1: float, gamma_2: float, least: float = 0.0) -> float:
    """Return the worst case, or less than `least`; u = 0 where γ1 does not bind, nor drag."""
    widths, begin, end, S = response.pieces(np.inf)
    if not S:
        sizes = np.abs(begin) + np.abs(end)
        sizes[sizes == 0] = 1.0
        before = np.cumsum(gamma_2 * widths * (begin + end) / sizes)
        crossed = before - gamma_2 * widths * end / sizes
        speeds = np.concatenate([[0.0], before, crossed[begin * end < 0]])
        if np.ptp(speeds) <= 2 * gamma_1:
            return gamma_2 * float(modulus(begin, end, widths).sum())
    return worst_case_of(response, gamma_1, gamma_2, least).bound


@dataclass(frozen=True, slots=True, eq=False)
class WorstCase:
    """The least upper bound on an error, as a grid has it, and what a target comes to."""

    bound: float
    reached: float
    widths: Array
    """(c,) s, of the cells, the oldest first."""
    mean: Array
    """(c,) of N."""
    u: Array
    """(c,)"""
    constant: float
    """S"""


def worst_case_of(
    response: Response, gamma_1: float, gamma_2: float, least: float = 0.0
) -> WorstCase:
    """Return the supremum over all targets, of the first grid that comes near enough.

    That it is no more than `least` is enough as well.
    """
    for i in range(ROUNDS):
        found = _on_grid(response, gamma_1, gamma_2, COARSE / 4**i)
        if found.bound <= max(least, found.reached + NEAR * found.bound):
            break
    return found


def _on_grid(response: Response, gamma_1: float, gamma_2: float, coarse: float) -> WorstCase:
    widths, begin, end, S = response.pieces(coarse)
    mean = (begin + end) / 2
    size = _sizes(mean)
    turned = np.abs(np.diff(mean, prepend=mean[0])) / np.minimum(size, np.roll(size, 1))
    turned[0] = 0.0
    passed = np.cumsum(turned + np.abs(end - begin) / size)
    cell = np.unique(np.floor(passed / coarse), return_inverse=True)[1]
    wide: Array = np.bincount(cell, widths).astype(np.float64)
    middle: Array = np.bincount(cell, widths * mean) / wide
    u = np.array(_least(middle.tolist(), (gamma_2 * wide).tolist(), gamma_1, S))
    reached = gamma_2 * float(wide @ np.abs(u - middle)) + gamma_1 * _variation(u, u, S)
    held = u[cell]
    follows = held == middle[cell]
    bound = np.inf
    for low, high in ((held, held), (np.where(follows, begin, held), np.where(follows, end, held))):
        missed = float(modulus(begin - low, end - high, widths).sum())
        bound = min(bound, gamma_1 * _variation(low, high, S) + gamma_2 * missed)
    return WorstCase(bound, reached, wide, middle, u, S)


def _variation(begin: Array, end: Array, S: float) -> float:
    """Return the total variation of what goes straight in each part, from 0 to S."""
    jumps = np.abs(np.append(begin, S) - np.append(0.0, end)).sum()
    return float(jumps + np.abs(end - begin).sum())


def _least(N: Sequence[float], w: Sequence[float], gamma_1: float, S: float) -> list[float]:
    """Return u, the minimum of γ1 (|u_1| + Σ |u_{c+1} − u_c| + |S − u_last|) + Σ w |u − N|."""
    mass = [2 * gamma_1]
    least_first, most_first = [(0.0, 0)], [(0.0, 0)]
    low: list[float] = []
    high: list[float] = []
    for place, weight in zip(N, w, strict=True):
        mass.append(2 * weight)
        heappush(least_first, (place, len(low) + 1))
        heappush(most_first, (-place, len(low) + 1))
        for heap in (least_first, most_first):
            taken = weight
            while len(heap) > 1 and mass[heap[0][1]] <= taken:  # also what the other end has taken
                at = heappop(heap)[1]
                taken, mass[at] = taken - mass[at], 0.0
            mass[heap[0][1]] -= taken
        low.append(least_first[0][0])
        high.append(-most_first[0][0])
    found, u = [], S
    for least, most in zip(reversed(low), reversed(high), strict=True):
        u = min(max(u, least), most)
        found.append(u)
    return found[::-1]


def worst_motion(worst: WorstCase, gamma_1: float, gamma_2: float) -> tuple[Array, Array]:
    """Return the ends of cells, s before the end, and υ_0 there, both (c + 1,), of the target.

    Where u rises υ_0 is γ1, where it falls −γ1; where u is above N a_0 is γ2, below it −γ2, and
    where it is N, anything. One velocity after another is chosen within these.
    """
    low, high = [], []
    rises = np.sign(np.diff(worst.u, prepend=0.0, append=worst.constant))
    pulls = np.sign(worst.u - worst.mean)
    steps = gamma_2 * worst.widths
    least, most = -gamma_1, gamma_1
    for i, rise in enumerate(rises.tolist()):
        if i:
            pull, step = pulls[i - 1], steps[i - 1]
            least += step if pull > 0 else -step
            most += -step if pull < 0 else step
        wanted = (gamma_1 * rise,) * 2 if rise else (-gamma_1, gamma_1)
        least, most = (min(max(end, wanted[0]), wanted[1]) for end in (least, most))
        low.append(least)
        high.append(most)
    velocity = [(low[-1] + high[-1]) / 2]
    for i in reversed(range(len(steps))):
        pull, step, now = pulls[i], steps[i], velocity[-1]
        before = now if not pull else now - step * pull
        before = min(max(before, low[i]), high[i])
        velocity.append(min(max(before, now - step), now + step))
    before_end = np.append(np.cumsum(worst.widths[::-1])[::-1], 0.0)
    return before_end, np.array(velocity[::-1])


def attained(
    error: ErrorRecursion,
    seen: Matrix,
    most: Array,
    gammas: tuple[float, float],
    held: Array,
    periods: int,
) -> tuple[Array, list[int]]:
    """Return the worst case of `seen` x, (2,): the largest of positions and of velocities.

    And the rows whose it is; −1 where no target was found that attains it.

    `most`, (2 n,), are bounds: rows are taken from the largest on, until what is left of them is
    below what was found. Where more than so many periods would be summed, the next is the answer.
    """
    found, at = [], []
    for half, own in enumerate(held.tolist()):
        bounds = most.reshape(2, -1)[half]
        order = half * len(bounds) + np.argsort(-bounds)
        best, begin, count, place = 0.0, 0, 1, int(order[0])
        while begin < len(order):
            rows = order[begin : begin + count]
            rows = rows[most[rows] > best * (1 + NEAR)]
            some = len(rows) and responses(error, as_array(seen[rows]), own, periods)
            if not some:
                if most[order[begin]] > best * (1 + NEAR):
                    place = -1
                best = max(best, float(most[order[begin]]))
                break
            periods -= len(some[0].p)
            for row, response in zip(rows, some, strict=True):
                bound = min(float(most[row]), bound_of(response, *gammas, best))
                best, place = max((best, place), (bound, int(row)))
            begin, count = begin + count, min(4 * count, TOGETHER)
        found.append(best)
        at.append(place)
    return np.array(found), at
