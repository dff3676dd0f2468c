"""A sampling period over links that lose samples: what A_k and its inputs are, by what is lost.

Each link loses a sample with its probability, apart from all others. An agent that drops goes by
the weighted mean of what came, and one that holds by what came last, which is a state more for each
such link. What one robot receives decides its own rows of A_k and no others'.

The states are errors: x(t_k) − 1 ⊗ E z(t_k), with z = [ε_0; υ_0; a_0], and samples that are held
less what the target's would be at t_k. So x(t_{k+1}) = A_k x(t_k) + B_k u(t_k), where u has z at
t_{k+1}, t_k, t_{k−1}, … as far back as the longest delay. What links deliver is V x_j(t_{k−d}) +
V E (z(t_{k−d}) − z(t_k)).
"""

from collections.abc import Iterator, Sequence
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
MOST_STATES = 400
"""The same of one in which nothing is drawn."""
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

    def pattern(self) -> NDArray[np.bool_]:
        """Return where A may be other than 0, (p, p)."""
        p = len(self.fixed)
        pattern: NDArray[np.bool_] = self.fixed[:, :p] != 0
        for one in self.outcomes:
            pattern[one.rows] = one.parts[:, :, :p].any(axis=0)
        return pattern

    def within(self, part: NDArray[np.intp]) -> "LossyStep":
        """Return the recursion of some states by themselves, without inputs."""
        inside = []
        for one in self.outcomes:
            here = np.isin(one.rows, part)
            if here.any():
                rows = np.searchsorted(part, one.rows[here])
                inside.append(Outcomes(rows, one.chance, one.parts[:, here][:, :, part]))
        return LossyStep(self.fixed[np.ix_(part, part)], tuple(inside))


def by_components(steps: Sequence[LossyStep]) -> Iterator[list[LossyStep]]:
    """Yield the recursions of each strongly connected component of all that all A can be."""
    united = np.any([step.pattern() for step in steps], axis=0)
    for part in components(united.astype(float)):
        yield [step.within(part) for step in steps]


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


@dataclass(frozen=True, slots=True, eq=False)
class TickEdges:
    """What edges are at a sampling time."""

    weight: Array
    """(g, E) w_ij/ϖ_i, 0 where an edge is none: of all fields, or of positions and velocities."""
    loss: Array
    """(E,) the probability that the sample which is due now is lost; 1 where none was sent."""


def lossy_step(
    step: LinearStep, topology: Topology, delay: Delays, loss: Array, missing: Missing
) -> LossyStep | None:
    """Return the recursion where each edge is late by its delay and loses samples; (E,) each.

    None as of `lossy_ticks`.
    """
    found = lossy_ticks(
        step, topology, delay, [TickEdges(topology.normalised[None], loss)], missing
    )
    return found[0] if found else None


def lossy_ticks(
    step: LinearStep, links: Topology, delay: Delays, ticks: Sequence[TickEdges], missing: Missing
) -> list[LossyStep] | None:
    """Return the recursion of each tick over the edges of all, late by (E,), in the same states.

    None where it is too large, or where it is not known what the law does without a sample, or what
    of samples is of positions and what of velocities.
    """
    past, g = Past(step, links, delay), max(len(tick.weight) for tick in ticks)
    absent = np.flatnonzero(np.any([tick.loss > 0 for tick in ticks], axis=0))
    drawn = np.any([(tick.loss > 0) & (tick.loss < 1) for tick in ticks], axis=0)
    into = np.bincount(links.sink[drawn], minlength=links.n + 1)
    p = past.size + (past.r * len(absent) if missing == "hold" else 0)
    unknown = missing == "drop" and step.alone is None
    mixed = g > 1 and (len(step.fields) != g or bool(((past.V != 0).sum(axis=1) > 1).any()))
    most = STATES if drawn.any() else MOST_STATES
    if unknown or mixed or p > most or into.max(initial=0) > IN_LINKS:
        return None
    rows = _Rows(step, links, past, delay, absent, missing, p)
    own = as_array(past.assembled([*past.own(), *past.kept()]))
    return [rows.at(tick, own) for tick in ticks]


class _Rows:
    """Rows of [A, B], of `width` columns, by robot."""

    def __init__(
        self,
        step: LinearStep,
        links: Topology,
        past: Past,
        delay: Delays,
        absent: NDArray[np.intp],
        missing: Missing,
        p: int,
    ) -> None:
        self._step, self._links, self._past, self._p = step, links, past, p
        self._holds, r = missing == "hold", past.r
        self._alone = np.zeros_like(step.own)
        """What a robot does without any sample; 0 where it never is."""
        if not self._holds and step.alone is not None:
            self._alone = step.alone
        self._law = step, past.U, past.V, self._alone
        self.width = p + Z * (int(delay.max(initial=0)) + 2)
        signals = np.zeros((r * len(delay), self.width))
        for rows, columns, values in past.signal(np.arange(len(delay))):
            np.add.at(signals, (rows, columns), values)
        late = [self._truth(past.V, d) - self._truth(past.V, 0) for d in delay.tolist()]
        self._signals = signals.reshape(len(delay), r, self.width) + np.array(late)
        self._memory = {
            e: past.size + r * at + np.arange(r) for at, e in enumerate(absent.tolist())
        }
        """The states that hold what came last over each edge on which a sample may not come."""

    def at(self, tick: TickEdges, own: Array) -> LossyStep:
        """Return the recursion of a tick; `own` has what each state does by itself."""
        fixed, outcomes = np.zeros((self._p, self.width)), []
        fixed[: len(own), : len(own)] = own
        for i in range(self._past.n):
            x = np.arange(self._past.s) * self._past.n + i
            fixed[x] = 0
            found = self._of_robot(i, x, tick)
            if len(found.chance) == 1:
                fixed[found.rows] = found.parts[0]
            else:
                outcomes.append(found)
        return LossyStep(fixed, tuple(outcomes))

    def _of_robot(self, i: int, x: NDArray[np.intp], tick: TickEdges) -> Outcomes:
        """Return what its rows, x and what it holds, come to by what is lost."""
        V, ahead = self._past.V, self._truth(np.eye(len(x)), -1)
        into = np.flatnonzero(self._links.sink == i + 1)
        held = [at for at, e in enumerate(into.tolist()) if self._holds and e in self._memory]
        memory = [self._memory[into[at]] for at in held]
        loss = tick.loss[into]
        here = np.flatnonzero((loss > 0) & (loss < 1))
        chance, parts = [], []
        for lost in product((False, True), repeat=len(here)):
            chance.append(np.prod(np.where(lost, loss[here], 1 - loss[here])))
            gone = loss == 1
            gone[here] = lost
            came = self._signals[into]
            for at, kept in zip(held, memory, strict=True):
                if gone[at]:
                    came[at] = np.eye(self._p, self.width)[kept]
            weight = tick.weight[:, into] * (self._holds | ~gone)
            rows = self._lifted(self._alone, x)
            for of, (own, received, U) in zip(
                weight, by_digraph(*self._law, len(weight)), strict=True
            ):
                if of.any():
                    mean = np.tensordot(of / of.sum(), came, axes=1)
                    rows += self._lifted(own, x) + self._truth(received, 0) + U @ mean
            kept = [came[at] + self._truth(V, 0) - self._truth(V, -1) for at in held]
            parts.append(np.concatenate([rows - ahead, *kept]))
        return Outcomes(np.concatenate([x, *memory]), np.array(chance), np.array(parts))

    def _lifted(self, matrix: Array, x: NDArray[np.intp]) -> Array:
        """Return what multiplies [x, u] in `matrix` (x_i + E z(t_k))."""
        rows = self._truth(matrix, 0)
        rows[:, x] += matrix
        return rows

    def _truth(self, matrix: Array, lag: int) -> Array:
        """Return what multiplies u in `matrix` E z(t_{k−lag})."""
        rows, at = np.zeros((len(matrix), self.width)), self._p + Z * (lag + 1)
        rows[:, at : at + Z] = matrix @ self._step.truth
        return rows


def by_digraph(
    step: LinearStep, U: Array, V: Array, alone: Array, digraphs: int
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield what comes with the samples over each digraph: of F K, of F G S and of U.

    Of two digraphs the first is that of positions, and F K without any sample is `alone`.
    """
    for part in range(digraphs):
        fields = np.ones(len(step.fields)) if digraphs == 1 else np.eye(digraphs)[part]
        yield (step.own - alone) * fields, step.received * fields, U * (np.abs(V) @ fields > 0)
