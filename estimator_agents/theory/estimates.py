"""How far the estimates stay from the target in steady state: three answers, each within the next.

- steady state: for a target of sines. Δ(k) is then Σ Im Δ̂ e^{jωkh}, and x(t_k) →
  Σ Im X e^{jωkh} with (e^{jωh} I − A) X = Δ̂; its largest value is at most Σ |X|, and comes as near
  to it as one likes when no ωh is a rational part of 2π or of another;
- worst case: over all targets with |υ_0| ≤ γ1, |a_0| ≤ γ2 (A1). On (t_k, t_{k+1}] an acceleration
  adds −∫ ((t_{k+1} − w) A^j 1⊗[1; 0] + A^j 1⊗[0; 1]) a_0(w) dw to x(t_{k+1+j}). The sum of the
  integrals' moduli is a bound for each robot, and `worst_case.py` makes it what a target attains;
- paper: Theorems 1 and 3, h κ, of ‖Δ(k)‖∞ ≤ h max(2 γ1, γ2) (equation 0.7) and a small-value norm.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from math import log
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nrs_cosim.bus.matrices import Matrix, as_array, identity_like, nonzeros
from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.theory.norms import SmallValueNorm, small_value_norm
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.slow_modes import Moduli, slow_modes, slow_sums
from nrs_cosim.estimator_agents.theory.solving import solve
from nrs_cosim.estimator_agents.theory.worst_case import LEFT, ErrorRecursion, attained

Array = NDArray[np.float64]
Reals = NDArray[np.floating[Any]]

WORK = 5e4
"""Sampling periods of the past, of a few robots, that a sum may take; of more robots, fewer."""
WHOLE = 1 + 1e-12
"""What weights of a mean add up to, with rounding."""
REST = 1e-13
"""The part of the sum at which it ends."""
LARGEST = 200
"""Rows of A up to which slow modes are separated from fast ones."""
BLOCK, DENSE = 256, 100
"""Sampling periods that are summed at once, a power of 2, where A has no more rows than so many."""


@dataclass(frozen=True, slots=True)
class EstimateBounds:
    """Bounds on lim ‖ε̄_i‖∞ and lim ‖ῡ_i‖∞ over all robots."""

    position: float
    velocity: float

    def plus(self, added: "EstimateBounds") -> "EstimateBounds":
        """Return the bounds with what else adds to the errors."""
        return EstimateBounds(self.position + added.position, self.velocity + added.velocity)

    def most(self, other: "EstimateBounds") -> "EstimateBounds":
        """Return the larger bound of each."""
        larger = max(self.position, other.position), max(self.velocity, other.velocity)
        return EstimateBounds(*larger)


@dataclass(frozen=True, slots=True)
class PaperBound:
    """The paper's bounds, with what they are made of: κ3 is κ1 of the matrix Γ."""

    norm: SmallValueNorm
    """Of A."""
    kappa: float
    """κ1 or κ3, per s: ‖x‖∞ → at most h κ (equations 0.5 and 5.3)."""
    velocity_norm: SmallValueNorm | None
    """Of 𝒫; None where velocities depend on positions."""
    velocity_kappa: float | None
    """κ2"""
    bound: EstimateBounds
    """δ1 = h κ1 and δ2 = h min(κ1, κ2) (equation 6.6), or h κ3 for both (equation 5.3)."""


def paper_bound(recursion: Recursion, gamma_1: float, gamma_2: float) -> PaperBound | None:
    """Return Theorem 1's or 3's bounds; None where no small-value norm is found."""
    h = recursion.h
    drag = np.abs(recursion.drag[:, 1]) * gamma_1 / h
    norm = small_value_norm(recursion.matrix)
    if norm is None or recursion.drag[:, 0].any():
        return None
    kappa = norm.gain * float(max(2 * gamma_1 + drag[0], gamma_2 + drag[1]))
    apart, kappa_2 = None, None
    if recursion.velocities_alone:
        apart = small_value_norm(recursion.velocity_block)
    if apart is not None:
        kappa_2 = apart.gain * float(gamma_2 + drag[1])
    best = kappa if kappa_2 is None else min(kappa, kappa_2)
    return PaperBound(norm, kappa, apart, kappa_2, EstimateBounds(h * kappa, h * best))


def worst_case(
    recursion: Recursion, gamma_1: float, gamma_2: float, radius: float
) -> EstimateBounds | None:
    """Return the worst-case bounds at the sampling times, left limits.

    None where ρ = `radius` ≥ 1, or where forgetting takes too long to be summed: of many robots, or
    in modes that are not near 1.
    """
    seen = identity_like(recursion.matrix)
    return _attained(recursion, gamma_1, gamma_2, radius, seen, np.zeros(2))


def worst_case_always(
    recursion: Recursion,
    gamma_1: float,
    gamma_2: float,
    radius: float,
    before: EstimateBounds | None = None,
) -> EstimateBounds | None:
    """Return the worst-case bounds at all times: an interval's are at its ends,
    and so also after jumps.

    In between x is affine in time but for what the target does meanwhile, at most a convex part.
    `before` is what `worst_case` has of the same, if that is known already.
    """
    before = before or worst_case(recursion, gamma_1, gamma_2, radius)
    if before is None:
        return None
    held = (recursion.keep - np.eye(2))[:, 1]
    after = _attained(recursion, gamma_1, gamma_2, radius, recursion.jump, held)
    return None if after is None else before.most(after)


def _attained(
    recursion: Recursion, gamma_1: float, gamma_2: float, radius: float, seen: Matrix, held: Array
) -> EstimateBounds | None:
    most = worst(recursion, gamma_1, gamma_2, radius, seen, recursion.h)
    if most is None:
        return None
    most += np.repeat(np.abs(held) * gamma_1, recursion.n)
    periods = _periods_of_work(recursion.matrix) * (4 if seen.shape[1] <= DENSE else 1)
    if radius > 0 and log(LEFT) / log(radius) > periods:
        found = largest(most)
    else:
        gammas = gamma_1, gamma_2
        both, _ = attained(ErrorRecursion.of(recursion), seen, most, gammas, held, periods)
        found = EstimateBounds(*both.tolist())
    if _are_means(recursion, seen):
        return EstimateBounds(found.position, min(found.velocity, 2 * gamma_1))
    return found


def _are_means(recursion: Recursion, seen: Matrix) -> bool:
    """Whether velocities are means of the target's, with weights of at least 0 (W2)."""
    parts = [matrix[recursion.n :] for matrix in (recursion.matrix, seen)]
    return not recursion.drag[1].any() and all(
        part.min() >= 0 and part[:, : recursion.n].max() <= 0 and part.sum(axis=1).max() <= WHOLE
        for part in parts
    )


def _periods_of_work(A: Matrix) -> int:
    """Return over how many periods of the past a sum may go."""
    return int(WORK / (1 + nonzeros(A) / 4000))


def always(
    before: EstimateBounds, after: EstimateBounds, recursion: Recursion, gamma_1: float
) -> EstimateBounds:
    """Return bounds at all times from those before jumps, and after them but for the drag."""
    dragged = np.abs(recursion.keep - np.eye(2))[:, 1] * gamma_1
    return EstimateBounds(
        max(before.position, after.position + float(dragged[0])),
        max(before.velocity, after.velocity + float(dragged[1])),
    )


def largest(most: Array) -> EstimateBounds:
    """Return the largest of bounds on positions and then velocities, (2 n,)."""
    position, velocity = most.reshape(2, -1).max(axis=1).tolist()
    return EstimateBounds(position, velocity)


def worst(
    recursion: Recursion,
    gamma_1: float,
    gamma_2: float,
    radius: float,
    seen: Matrix,
    h: float,
) -> Array | None:
    """Return the worst-case bounds, (p,), on `seen` x, (p, 2 n), at the sampling times.

    The target moves for h, s, at most between two of them.
    """
    if radius >= 1 or recursion.drag[:, 0].any():
        return None
    n, A = recursion.n, recursion.matrix
    sizes = slip(h, gamma_1, gamma_2), min(2 * gamma_1, h * gamma_2)
    unit = np.kron(np.eye(2), np.ones((n, 1)))
    if A.min() >= 0 and seen.min() >= 0 and not recursion.drag.any():
        found: Array = seen @ solve(identity_like(A) - A, unit @ sizes)
        return found
    of = Moduli(h, gamma_1, gamma_2, sizes, recursion.drag[:, 1])
    most_steps = _periods_of_work(A)
    if radius > 0 and log(REST) / log(radius) > most_steps:
        return _worst_of_slow(A, unit, seen, of, most_steps)
    most, free = np.zeros(seen.shape[0]), np.zeros(seen.shape[0])
    block = BLOCK if A.shape[0] <= DENSE else 1
    for kernels in islice(history(A, unit, block), most_steps // block + 1):
        bounded, driven = of.bounds(
            (seen @ kernels.reshape(2 * n, -1)).reshape(-1, *kernels.shape[1:])
        )
        most, free = most + bounded.sum(axis=1), free + driven.sum(axis=1)
        if bounded.max() <= REST * (1 - radius) * most.max() and driven.max() <= REST * free.max():
            least: Array = np.minimum(most, free)
            return least
    return None


def _worst_of_slow(
    A: Matrix, unit: Reals, seen: Matrix, of: Moduli, most_steps: int
) -> Array | None:
    """Return the same where forgetting takes longer: what is slow is summed by stretches."""
    if A.shape[0] > LARGEST:
        return None
    slow = slow_modes(as_array(A), unit, most_steps)
    if slow is None:
        return None
    most, free = np.zeros(seen.shape[0]), np.zeros(seen.shape[0])
    blocks = -(-slow.gone // BLOCK)
    for kernels in islice(history(A, unit, BLOCK), blocks):
        response = (seen @ kernels.reshape(len(unit), -1)).reshape(-1, *kernels.shape[1:])
        bounded, driven = of.bounds(response)
        most, free = most + bounded.sum(axis=1), free + driven.sum(axis=1)
    remaining = slow_sums(slow, as_array(seen), of, blocks * BLOCK)
    if remaining is None:
        return None
    least: Array = np.minimum(most + remaining[0], free + remaining[1])
    return least


def history(A: Matrix, first: Reals, block: int) -> Iterator[Reals]:
    """Yield A^j `first`, (2 n, c, b), b of one after another at a time, for j = 0, 1, …"""
    kernels, power = first[:, :, None], A
    if block > 1:
        power = as_array(A)
        while kernels.shape[2] < block:
            further = np.tensordot(power, kernels, axes=1)
            kernels, power = np.concatenate([kernels, further], axis=2), power @ power
    while True:
        yield kernels
        kernels = (power @ kernels.reshape(len(first), -1)).reshape(kernels.shape)


def slip(h: float, gamma_1: float, gamma_2: float) -> float:
    """Return the most of |Δ_1(k)|: ∫ min(2 γ1, γ2 w) dw over 0 … h."""
    if gamma_2 * h <= 2 * gamma_1:
        return gamma_2 * (h * h) / 2
    return 2 * gamma_1 * h - 2 * gamma_1 * (gamma_1 / gamma_2)


@dataclass(frozen=True, slots=True, eq=False)
class SteadyMotion:
    """What the errors settle to for one target: constants and sines at the sampling times."""

    h: float
    """s"""
    copies: int
    """c: how many ticks it takes until the digraphs come again."""
    constant: Array
    """(2, c n, m) of ε̄ and ῡ: of n robots, at each of these ticks."""
    frequency: Array
    """(w,) rad/s"""
    phasor: NDArray[np.complex128]
    """(w, 2, c n, m)"""

    def at(self, k: ArrayLike) -> Array:
        """Return ε̄ and ῡ at t_k, (…, 2, n, m), of k of any shape (…)."""
        ticks, (s, rows, m) = np.asarray(k), self.constant.shape
        here = (ticks - 1) % self.copies
        each = (s, self.copies, rows // self.copies, m)
        constant = np.moveaxis(self.constant.reshape(each), 1, 0)[here]
        phasor = np.moveaxis(self.phasor.reshape(-1, *each), 2, 0)[here]
        turned = np.exp(1j * self.frequency * (ticks[..., None] * self.h))
        motion: Array = constant + np.einsum("...w,...wsnm->...snm", turned, phasor).imag
        return motion

    @property
    def bound(self) -> EstimateBounds:
        """The largest that it comes to."""
        most = np.abs(self.constant) + np.abs(self.phasor).sum(axis=0)
        return EstimateBounds(float(most[0].max()), float(most[1].max()))


def steady_motion(recursion: Recursion, target: Harmonic, radius: float) -> SteadyMotion | None:
    """Return what the errors settle to; None where ρ = `radius` ≥ 1."""
    if radius >= 1 or recursion.drag[:, 0].any():
        return None
    n, A, h = recursion.n, recursion.matrix, recursion.h
    ones, unit = np.ones(n), identity_like(A)
    keep = recursion.flow @ recursion.keep
    frequency, waves = target.phasors()
    phasor = np.zeros((len(frequency), 2, n, waves.shape[1]), complex)
    for w, omega in enumerate(frequency):
        phase = np.exp(1j * omega * h)
        given = (keep - phase * np.eye(2)) @ [1, 1j * omega]
        X = solve(phase * unit - A, np.kron(given, ones))
        phasor[w] = X.reshape(2, n, 1) * waves[w]
    constant = np.zeros((2, n, waves.shape[1]))
    if recursion.drag.any():
        X = solve(unit - A, np.kron(recursion.drag[:, 1], ones))
        constant = X.reshape(2, n, 1) * target.rate
    return SteadyMotion(h, recursion.copies, constant, frequency, phasor)
