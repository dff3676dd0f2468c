"""Links that lose samples by chance: x(t_{k+1}) = A_k x(t_k), with A_k drawn anew at each tick.

Each link loses a sample with its probability, apart from all others. An agent that drops goes by
the weighted mean of what came, and one that holds by what came last, which is a state more for each
such link. What one robot receives decides its own rows of A_k and no others'.

- E x xᵀ → 0 iff ρ(E[A ⊗ A]) < 1 (statement L1). With the mean Ā and what robots' rows deviate from
  it, E[A X Aᵀ] = Ā X Āᵀ + Σ M_e X M_eᵀ; over the strongly connected components of all outcomes it
  is the largest of theirs. Of large ones it lies between the smallest and the largest c of
  E[A X Aᵀ] = c X for any X > 0 (Collatz and Wielandt in that cone, statement L2).
- Almost every run converges iff λ = lim ln ‖A_k ⋯ A_1‖/k < 0. E ln |det A|/p ≤ λ ≤ ½ ln ρ(E[A ⊗ A])
  is proven (statement L4); between them it is simulated.
- With K = I and G = diag(α, β), 0 < α, β ≤ 1, it converges in both senses whatever the losses below
  1 and bounded delays (statement L3).

Radii are of sizes, not of squares: ρ(E[A ⊗ A])^½ and e^λ.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from math import exp, inf, prod

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import as_array, components
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Missing
from nrs_cosim.estimator_agents.theory.aperiodic import RadiusBounds
from nrs_cosim.estimator_agents.theory.late_states import Delays, Past
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep

Array = NDArray[np.float64]

STATES, IN_LINKS = 400, 8
"""Of a recursion with losses, and lossy links into one robot, up to which it is looked at."""
DENSE = 24
"""States of a component up to which E[A ⊗ A] is a matrix."""
ROUNDING = 1e-13
"""Of deviations from the mean: singular values that are none, relative."""
CHAINS, TICKS, WORK = 500, 1000, 6000
"""Of a simulation: how many, how long; and ticks times robots that it may take."""
MATRICES = 4096
"""Outcomes of a component up to which the determinants of all are taken."""
SIGMAS = 3.29
"""Standard errors around a mean: 99.9 % of a normal distribution is within."""
GRID, NEAR = 8, 1e-6
"""Probabilities of loss at which it is looked for a critical one, and how near it is found."""


@dataclass(frozen=True, slots=True)
class AlmostSure:
    """e^λ: what errors are multiplied by at a tick, in the long run of almost every run."""

    lower: float
    """Proven."""
    upper: float
    """Proven."""
    simulated: RadiusBounds
    """Where it lies by simulation, with a confidence of 99.9 %."""


@dataclass(frozen=True, slots=True, eq=False)
class Outcomes:
    """What rows of A some losses lead to; apart from those of all other rows."""

    rows: NDArray[np.intp]
    """(r,)"""
    chance: Array
    """(o,) of each outcome."""
    parts: Array
    """(o, r, p) these rows of A."""

    @property
    def mean(self) -> Array:
        """(r, p)"""
        mean: Array = np.tensordot(self.chance, self.parts, axes=1)
        return mean

    def deviations(self) -> Array:
        """Return M_e, (e, r, p), with Σ M_e X M_eᵀ = E[(A − Ā) X (A − Ā)ᵀ] in these rows."""
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
    """(p, p) the rows of A that no loss changes; the others are 0."""
    outcomes: tuple[Outcomes, ...]

    @property
    def mean(self) -> Array:
        """Ā, (p, p)."""
        mean = self.fixed.copy()
        for one in self.outcomes:
            mean[one.rows] = one.mean
        return mean

    def components(self) -> "list[LossyStep]":
        """Return the recursions of the strongly connected components of all that A can be."""
        pattern = self.fixed != 0
        for one in self.outcomes:
            pattern[one.rows] = one.parts.any(axis=0)
        return [self._within(part) for part in components(pattern.astype(float))]

    def _within(self, part: NDArray[np.intp]) -> "LossyStep":
        inside = []
        for one in self.outcomes:
            here = np.isin(one.rows, part)
            if here.any():
                rows = np.searchsorted(part, one.rows[here])
                inside.append(Outcomes(rows, one.chance, one.parts[:, here][:, :, part]))
        return LossyStep(self.fixed[np.ix_(part, part)], tuple(inside))


def lossy_step(
    step: LinearStep, topology: Topology, delay: Delays, loss: Array, missing: Missing
) -> LossyStep | None:
    """Return the recursion where each edge is late by its delay and loses samples; (E,) each.

    None where it is too large, or where it is not known what the law does without a sample.
    """
    past = Past(step, topology, delay)
    lossy = np.flatnonzero(loss)
    of_robot = np.bincount(topology.sink[lossy], minlength=topology.n + 1)
    held = past.r * len(lossy) if missing == "hold" else 0
    p = past.size + held
    if (
        p > STATES
        or of_robot.max(initial=0) > IN_LINKS
        or (missing == "drop" and step.alone is None)
    ):
        return None
    every, weight = np.arange(len(loss)), topology.normalised
    signals = np.zeros((past.r * len(every), p))
    for rows, columns, values in past.signal(every):
        np.add.at(signals, (rows, columns), values)
    signals = signals.reshape(len(every), past.r, p)
    memory = {e: past.size + past.r * at + np.arange(past.r) for at, e in enumerate(lossy.tolist())}
    fixed = np.zeros((p, p))
    fixed[: past.size, : past.size] = as_array(past.assembled([*past.own(), *past.kept()]))
    outcomes = []
    for i in range(topology.n):
        x = np.arange(past.s) * topology.n + i
        own = fixed[x]
        into = np.flatnonzero(topology.sink == i + 1)
        here = [int(e) for e in into if loss[e]]
        if not here:
            fixed[x] += np.einsum("e,ar,erp->ap", weight[into], past.U, signals[into])
            continue
        alone = np.zeros_like(own) if step.alone is None else _spread(step.alone, x, p)
        chance, parts = [], []
        for lost in product((False, True), repeat=len(here)):
            gone = dict(zip(here, lost, strict=True))
            chance.append(np.prod([loss[e] if out else 1 - loss[e] for e, out in gone.items()]))
            if missing == "drop":
                there = np.array([e for e in into.tolist() if not gone.get(e, False)], np.intp)
                of = weight[there] / weight[there].sum() if len(there) else weight[there]
                rows = own + np.einsum("e,ar,erp->ap", of, past.U, signals[there])
                parts.append(rows if len(there) else alone)
                continue
            used = signals[into].copy()
            for at, e in enumerate(into.tolist()):
                if gone.get(e, False):
                    used[at] = np.eye(p)[memory[e]]
            heard = own + np.einsum("e,ar,erp->ap", weight[into], past.U, used)
            kept = [used[into.tolist().index(e)] for e in here]
            parts.append(np.concatenate([heard, *kept]))
        fixed[x] = 0
        own_rows = [x, *(memory[e] for e in here if missing == "hold")]
        outcomes.append(Outcomes(np.concatenate(own_rows), np.array(chance), np.array(parts)))
    return LossyStep(fixed, tuple(outcomes))


def _spread(own: Array, x: NDArray[np.intp], p: int) -> Array:
    rows = np.zeros((len(x), p))
    rows[:, x] = own
    return rows


def mean_square_radius(lossy: LossyStep) -> RadiusBounds:
    """Return bounds on ρ(E[A ⊗ A])^½ (statements L1 and L2)."""
    found = [_squared(part) for part in lossy.components()]
    return RadiusBounds(
        max(one.lower for one in found) ** 0.5, max(one.upper for one in found) ** 0.5
    )


def _squared(lossy: LossyStep) -> RadiusBounds:
    mean = lossy.mean
    p = len(mean)
    spread = [(one.rows, one.deviations()) for one in lossy.outcomes]
    if p <= DENSE:
        whole = np.kron(mean, mean)
        for rows, deviations in spread:
            at = (rows[:, None] * p + rows).ravel()
            whole[at] += np.einsum("eac,ebd->abcd", deviations, deviations).reshape(-1, p * p)
        # Of symmetric X alone: entries above the diagonal are those below it.
        row, column = np.tril_indices(p)
        below, above = row * p + column, column * p + row
        whole = whole[below]
        folded = whole[:, below] + np.where(row == column, 0, whole[:, above])
        radius = float(np.abs(np.linalg.eigvals(folded)).max())
        return RadiusBounds(radius, radius)

    def through(X: Array) -> Array:
        after = mean @ X @ mean.T
        for rows, deviations in spread:
            after[np.ix_(rows, rows)] += np.einsum(
                "eac,cd,ebd->ab", deviations, X, deviations, optimize=True
            )
        return (after + after.T) / 2

    return _bracket(through, p)


def _bracket(through: Callable[[Array], Array], p: int) -> RadiusBounds:
    """Return bounds on the radius of a map of positive semidefinite matrices (p, p)."""
    from scipy.linalg import eigh  # noqa: PLC0415, as in `bus.matrices`
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigs  # noqa: PLC0415, as above

    def flat(x: Array) -> Array:
        X = x.reshape(p, p)
        return through((X + X.T) / 2).ravel()

    try:
        operator = LinearOperator((p * p, p * p), matvec=flat, dtype=float)
        _, vectors = eigs(operator, 1, v0=np.eye(p).ravel(), maxiter=50)
    except ArpackError:
        return RadiusBounds(0.0, inf)
    X = vectors[:, 0].reshape(p, p)
    X = (X / np.trace(X)).real
    # What is nearly singular would make the quotients rounding: a little of the identity is added.
    for added in (0.0, 1e-9, 1e-6, 1e-3):
        Y = (X + X.T) / 2 + added * np.eye(p) / p
        if np.linalg.eigvalsh(Y)[0] > 1e-13:
            quotients = eigh(through(Y), Y, eigvals_only=True)
            return RadiusBounds(max(float(quotients[0]), 0.0), float(quotients[-1]))
    return RadiusBounds(0.0, inf)


def almost_sure(lossy: LossyStep, seed: int = 0) -> AlmostSure:
    """Return bounds on e^λ, and where it is by simulation (statement L4)."""
    parts = [(_squared(part).upper ** 0.5, part) for part in lossy.components()]
    lower, found = 0.0, RadiusBounds(0.0, 0.0)
    rng = np.random.Generator(np.random.Philox(seed))
    for upper, part in sorted(parts, key=lambda one: -one[0]):
        least = min(exp(_of_determinants(part)), upper)  # by rounding it may be above
        lower = max(lower, least)
        if upper > found.upper:
            one = RadiusBounds(least, least) if len(part.fixed) == 1 else _simulated(part, rng)
            found = max(found, one, key=lambda interval: interval.upper)
    most = max(upper for upper, _ in parts)
    least, largest = (min(max(end, lower), most) for end in (found.lower, found.upper))
    return AlmostSure(lower, most, RadiusBounds(least, largest))


def _of_determinants(lossy: LossyStep) -> float:
    """Return E ln |det A|/p, of few outcomes; −∞ for others, which any λ is above."""
    p = len(lossy.fixed)
    if prod(len(one.chance) for one in lossy.outcomes) > MATRICES or p > DENSE:
        return -inf
    chance, matrices = np.ones(1), lossy.fixed[None]
    for one in lossy.outcomes:
        matrices = np.repeat(matrices, len(one.chance), axis=0)
        matrices[:, one.rows] = np.tile(one.parts, (len(chance), 1, 1))
        chance = np.outer(chance, one.chance).ravel()
    logs = np.linalg.slogdet(matrices[chance > 0])[1]
    return float(chance[chance > 0] @ logs) / p


def _simulated(lossy: LossyStep, rng: np.random.Generator) -> RadiusBounds:
    """Return where e^λ lies by the growth of vectors, of as many runs as there are chains."""
    p, robots = len(lossy.fixed), max(len(lossy.outcomes), 1)
    ticks = min(TICKS, WORK // robots)
    x, growth = rng.normal(size=(CHAINS, p)), np.zeros(CHAINS)
    bounds = [np.cumsum(one.chance)[:-1] for one in lossy.outcomes]
    for tick in range(ticks):
        after = x @ lossy.fixed.T
        drawn = rng.random((robots, CHAINS))
        for one, ends, at in zip(lossy.outcomes, bounds, drawn, strict=False):
            which = np.searchsorted(ends, at, side="right")
            after[:, one.rows] = np.einsum("mrp,mp->mr", one.parts[which], x)
        size = np.abs(after).max(axis=1)
        if not size.all():  # some products are 0, and so is e^λ
            return RadiusBounds(0.0, 0.0)
        x = after / size[:, None]
        if tick >= ticks // 5:
            growth += np.log(size)
    rate = growth / (ticks - ticks // 5)
    off = SIGMAS * float(rate.std(ddof=1)) / CHAINS**0.5
    return RadiusBounds(exp(rate.mean() - off), exp(rate.mean() + off))


def critical_loss(lossy_at: Callable[[float], LossyStep | None]) -> float | None:
    """Return the least probability of loss from which it does not converge in mean square.

    1 if it converges at all that are looked at; None if it does not without loss, or is too large.
    """

    def diverges(loss: float) -> bool:
        lossy = lossy_at(loss)
        return lossy is None or not mean_square_radius(lossy).upper < 1

    if diverges(0.0):
        return None
    low, high = 0.0, 1.0
    for at in range(1, GRID):
        if diverges(at / GRID):
            high = at / GRID
            break
        low = at / GRID
    else:
        return 1.0
    while high - low > NEAR:
        middle = (low + high) / 2
        low, high = (low, middle) if diverges(middle) else (middle, high)
    return high
