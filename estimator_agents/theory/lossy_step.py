"""A sampling period over links that lose samples: what A_k and its inputs are, by what is lost.

Each link loses a sample with its probability, apart from all others. An agent that drops goes by
the weighted mean of what came, and one that holds by what came last, which is a state more for each
such link. What one robot receives decides its own rows of A_k and no others'.

The states are errors: x(t_k) − 1 ⊗ E z(t_k), with z = [ε_0; υ_0; a_0], and samples that are held
less what the target's would be at t_k. So x(t_{k+1}) = A_k x(t_k) + B_k u(t_k), where u has z at
t_{k+1}, t_k, t_{k−1}, … as far back as the longest delay. What links deliver is V x_j(t_{k−d}) +
V E (z(t_{k−d}) − z(t_k)).
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import as_array, components
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Missing
from nrs_cosim.estimator_agents.theory.late_states import Delays, Past
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep

Array = NDArray[np.float64]

STATES, IN_LINKS = 80, 8
"""Of a recursion with losses, and lossy links into one robot, up to which it is looked at."""
ROUNDING = 1e-13
"""Of deviations from the mean: singular values that are none, relative."""
Z = 3
"""Numbers of z."""


@dataclass(frozen=True, slots=True, eq=False)
class Outcomes:
    """What rows of A some losses lead to; apart from those of all other rows."""

    rows: NDArray[np.intp]
    """(r,)"""
    chance: Array
    """(o,) of each outcome."""
    parts: Array
    """(o, r, p + q) these rows of A and B."""

    @property
    def mean(self) -> Array:
        """(r, p + q)"""
        mean: Array = np.tensordot(self.chance, self.parts, axes=1)
        return mean

    def deviations(self) -> Array:
        """Return M_e, (e, r, p + q), with E[(M − M̄) X (M − M̄)ᵀ] = Σ M_e X M_eᵀ, M = [A, B]."""
        o, r, p = self.parts.shape
        weighed = np.sqrt(self.chance)[:, None, None] * (self.parts - self.mean)
        used = np.flatnonzero(weighed.any(axis=(0, 1)))
        _, sizes, across = np.linalg.svd(weighed[:, :, used].reshape(o, -1), full_matrices=False)
        kept = sizes > ROUNDING * sizes.max(initial=0)
        found = np.zeros((int(kept.sum()), r, p))
        found[:, :, used] = (sizes[:, None] * across)[kept].reshape(len(found), r, len(used))
        return found


@dataclass(frozen=True, slots=True, eq=False)
class LossyStep:
    """A sampling period over links of which some lose samples."""

    fixed: Array
    """(p, p + q) the rows of A and B that no loss changes; the others are 0."""
    outcomes: tuple[Outcomes, ...]

    @property
    def mean(self) -> Array:
        """[Ā, B̄], (p, p + q)."""
        mean = self.fixed.copy()
        for one in self.outcomes:
            mean[one.rows] = one.mean
        return mean

    def deviations(self) -> list[tuple[NDArray[np.intp], Array]]:
        """Return rows and M_e, (e, r, p + q), with E[M X Mᵀ] = M̄ X M̄ᵀ + Σ M_e X M_eᵀ."""
        return [(one.rows, one.deviations()) for one in self.outcomes]

    def components(self) -> "list[LossyStep]":
        """Return the recursions of the strongly connected components of all that A can be.

        They are without inputs.
        """
        p = len(self.fixed)
        pattern = self.fixed[:, :p] != 0
        for one in self.outcomes:
            pattern[one.rows] = one.parts[:, :, :p].any(axis=0)
        return [self._within(part) for part in components(pattern.astype(float))]

    def _within(self, part: NDArray[np.intp]) -> "LossyStep":
        inside = []
        for one in self.outcomes:
            here = np.isin(one.rows, part)
            if here.any():
                rows = np.searchsorted(part, one.rows[here])
                inside.append(Outcomes(rows, one.chance, one.parts[:, here][:, :, part]))
        return LossyStep(self.fixed[np.ix_(part, part)], tuple(inside))


def squared(mean: Array, deviations: list[tuple[NDArray[np.intp], Array]], X: Array) -> Array:
    """Return E[A X Aᵀ], (p, p), of Ā and M_e."""
    after: Array = mean @ X @ mean.T
    for rows, of in deviations:
        after[np.ix_(rows, rows)] += np.einsum("ead,ebd->ab", of @ X, of)
    return after


def squares(mean: Array, deviations: list[tuple[NDArray[np.intp], Array]]) -> Array:
    """Return E[A ⊗ A], (p², p²), of Ā and M_e."""
    p = len(mean)
    whole: Array = np.kron(mean, mean).astype(np.float64)
    for rows, of in deviations:
        at = (rows[:, None] * p + rows).ravel()
        whole[at] += np.einsum("eac,ebd->abcd", of, of).reshape(-1, p * p)
    return whole


def lossy_step(
    step: LinearStep, topology: Topology, delay: Delays, loss: Array, missing: Missing
) -> LossyStep | None:
    """Return the recursion where each edge is late by its delay and loses samples; (E,) each.

    None where it is too large, or where it is not known what the law does without a sample.
    """
    past, lossy = Past(step, topology, delay), np.flatnonzero(loss)
    into = np.bincount(topology.sink[lossy], minlength=topology.n + 1)
    p = past.size + (past.r * len(lossy) if missing == "hold" else 0)
    unknown = missing == "drop" and step.alone is None
    if unknown or p > STATES or into.max(initial=0) > IN_LINKS:
        return None
    rows = _Rows(step, topology, past, delay, loss, missing, p)
    fixed, outcomes = np.zeros((p, rows.width)), []
    fixed[: past.size, : past.size] = as_array(past.assembled([*past.own(), *past.kept()]))
    for i in range(topology.n):
        x = np.arange(past.s) * topology.n + i
        own = fixed[x].copy()
        fixed[x] = 0
        found = rows.of_robot(i, x, own)
        if len(found.chance) == 1:
            fixed[found.rows] = found.parts[0]
        else:
            outcomes.append(found)
    return LossyStep(fixed, tuple(outcomes))


class _Rows:
    """Rows of [A, B], of `width` columns, by robot."""

    def __init__(
        self,
        step: LinearStep,
        topology: Topology,
        past: Past,
        delay: Delays,
        loss: Array,
        missing: Missing,
        p: int,
    ) -> None:
        self._step, self._topology, self._past, self._p = step, topology, past, p
        self._loss, self._holds, r = loss, missing == "hold", past.r
        self.width = p + Z * (int(delay.max(initial=0)) + 2)
        signals = np.zeros((r * len(delay), self.width))
        for rows, columns, values in past.signal(np.arange(len(delay))):
            np.add.at(signals, (rows, columns), values)
        late = [self._truth(past.V, d) - self._truth(past.V, 0) for d in delay.tolist()]
        self._signals = signals.reshape(len(delay), r, self.width) + np.array(late)
        lossy = np.flatnonzero(loss).tolist()
        self._memory = {e: past.size + r * at + np.arange(r) for at, e in enumerate(lossy)}
        """The states that hold what came last over each lossy edge."""

    def of_robot(self, i: int, x: NDArray[np.intp], own: Array) -> Outcomes:
        """Return what its rows, x and what it holds, come to by what is lost; `own` is of F K."""
        step, weight = self._step, self._topology.normalised
        ahead, still = self._truth(np.eye(len(x)), -1), own + self._truth(step.own, 0)
        into = np.flatnonzero(self._topology.sink == i + 1)
        here = [int(e) for e in into if self._loss[e]]
        chance, parts = [], []
        for lost in product((False, True), repeat=len(here)):
            gone = [e for e, out in zip(here, lost, strict=True) if out]
            chance.append(np.prod(np.where(lost, self._loss[here], 1 - self._loss[here])))
            came, there = self._signals.copy(), np.setdiff1d(into, gone)
            if self._holds:
                there = into
                for e in gone:
                    came[e] = np.eye(self._p, self.width)[self._memory[e]]
            if len(there):
                mean = np.einsum("e,erw->rw", weight[there] / weight[there].sum(), came[there])
                rows = still + self._truth(step.received, 0) + self._past.U @ mean
            else:
                assert step.alone is not None
                rows = self._truth(step.alone, 0)
                rows[:, x] += step.alone
            V, held = self._past.V, here if self._holds else []
            kept = [came[e] + self._truth(V, 0) - self._truth(V, -1) for e in held]
            parts.append(np.concatenate([rows - ahead, *kept]))
        held_rows = [self._memory[e] for e in here if self._holds]
        return Outcomes(np.concatenate([x, *held_rows]), np.array(chance), np.array(parts))

    def _truth(self, matrix: Array, lag: int) -> Array:
        """Return what multiplies u in `matrix` E z(t_{k−lag})."""
        rows, at = np.zeros((len(matrix), self.width)), self._p + Z * (lag + 1)
        rows[:, at : at + Z] = matrix @ self._step.truth
        return rows
