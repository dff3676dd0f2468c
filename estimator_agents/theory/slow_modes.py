"""Σ_j |w A^j v| over a long past: fast modes die out soon, slow ones change little in a period.

A is brought to diag(A_f, A_s), where A_s has the eigenvalues near 1, as periods that are short give
them: A_s = I + O(h). What is fast is summed period by period, by whoever asks. Of the slow part

    Σ_{l<L} |w A_s^{a+l} z| = |w (I + A_s + … + A_s^{L−1}) A_s^a z|

where w A_s^{a+l} z has one sign, with powers and their sums by doubling. That it has one is proven
for a stretch of L periods: it is off the straight line between its ends by L²/8 max |second
difference| at most, and |w A_s^{a+i} (A_s − I)² z| ≤ |w| |A_s^i| |(A_s − I)² A_s^a z|. Where that
does not do, both halves of a stretch are looked at; or, when little depends on it, the most that it
may come to is taken. So a sum is never too small, but for rounding, some 10⁻¹⁶/(1 − ρ) of it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Reals = NDArray[np.floating[Any]]
Complex = NDArray[np.complex128]

SLOW = 0.1
"""How far from 1 a slow eigenvalue is at most."""
BENT = 0.25
"""How much a slow state changes at most, relative, in the longest stretch."""
CROOKED = 1e6
"""The size of what brings A to blocks, from which it is rounding."""
LEFT = 1e-16
"""The part of what is fast, and of what is slow, from which nothing is summed any more."""
MOST, SHARE = 50_000, 1e-9
"""Stretches that are looked at; and the part of a sum that they may be in doubt of together."""
TOGETHER = 256
"""Stretches that are looked at at once."""


@dataclass(frozen=True, slots=True, eq=False)
class SlowModes:
    """The slow part of A^j first, j >= 0: basis step^j start."""

    basis: Complex
    """(p, s)"""
    step: Complex
    """(s, s)"""
    start: Complex
    """(s, c)"""
    gone: int
    """From this j on there is nothing else."""

    def after(self, periods: int) -> Complex:
        """Return the slow state, (s, c), that many periods after the first."""
        return np.linalg.matrix_power(self.step, periods) @ self.start


def slow_modes(A: Array, first: Reals, most: int) -> SlowModes | None:
    """Return the slow modes of A, (p, p), in `first`, (p, c).

    None where what is not slow takes more than so many periods to die out.
    """
    from scipy import linalg  # noqa: PLC0415, 0.2 s that most checks need not wait for

    found = np.linalg.eigvals(A)
    found = found[np.argsort(np.abs(1 - found))]
    apart, sizes = np.abs(1 - found), np.abs(found)
    best, cut = 0.0, 0
    for count in range(1, len(found) + 1):
        remaining = float(sizes[count:].max(initial=0.0))
        if apart[count - 1] > SLOW or (
            remaining > 0 and log(LEFT) / log(min(remaining, 1 - 1e-16)) > most
        ):
            continue
        gap = apart[count] / max(apart[count - 1], 1e-300) if count < len(found) else np.inf
        best, cut = max((best, cut), (float(gap), count))
    if not cut:
        return None
    limit = float(np.sqrt(apart[cut - 1] * apart[cut])) if cut < len(found) else np.inf
    even, (scale, _) = linalg.matrix_balance(A - np.eye(len(A)), permute=False, separate=True)
    even = even.astype(complex) + np.eye(len(A))
    T, Z, count = linalg.schur(even, "complex", sort=lambda z: abs(1 - z) < limit)
    slow, coupling, fast = T[:cut, :cut], T[:cut, cut:], T[cut:, cut:]
    mix = linalg.solve_sylvester(slow, -fast, -coupling) if cut < len(found) else coupling
    size = float(np.abs(mix).sum(axis=1).max(initial=0.0))
    if count != cut or not size < CROOKED:
        return None
    start = Z.conj().T @ (first / scale[:, None])
    basis, first_slow = scale[:, None] * Z[:, :cut], start[:cut] - mix @ start[cut:]
    return SlowModes(basis, slow, first_slow, _gone(fast, LEFT / (1 + size)))


def _gone(step: Complex, left: float) -> int:
    """Return how many periods it takes until next to nothing is left, as k ρ^k takes longer."""

    def stays(power: Complex) -> bool:
        return bool(np.abs(power).sum(axis=1).max(initial=0.0) > left)

    powers = [step]
    while stays(powers[-1]):
        powers.append(powers[-1] @ powers[-1])
    found, periods = np.eye(len(step), dtype=complex), 0
    for k in reversed(range(len(powers))):
        if stays(longer := found @ powers[k]):
            found, periods = longer, periods + 2**k
    return periods + 1


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """L = 2^k periods: what a slow state comes to in them."""

    length: int
    change: Complex
    """A_s^L − I"""
    total: Complex
    """I + A_s + … + A_s^{L−1}"""
    most: Array
    """At least |A_s^i| for all i < L."""


def _stretches(step: Complex) -> Iterator[_Stretch]:
    """Yield stretches of 1, 2, 4, … periods, as far as a state changes little."""
    unit = np.eye(len(step))
    now = _Stretch(1, step - unit, unit.astype(complex), unit)
    while True:
        yield now
        change, sizes = now.change, np.abs(now.change)
        longer = _Stretch(
            2 * now.length,
            2 * change + change @ change,
            2 * now.total + change @ now.total,
            now.most + now.most @ sizes,
        )
        if np.abs(longer.change).sum(axis=1).max() > BENT:
            return
        now = longer


@dataclass(frozen=True, slots=True, eq=False)
class Moduli:
    """What is summed of w z_0 = p and w z_1 = r, for each row w: see `theory.estimates`."""

    h: float
    gamma_1: float
    gamma_2: float
    sizes: tuple[float, float]
    """The most of |Δ|."""
    drag: Array
    """(2,)"""

    @property
    def ways(self) -> Array:
        """(4, 2): p, r, r + h p and what the drag makes of them."""
        return np.array([[1.0, 0.0], [0.0, 1.0], [self.h, 1.0], self.drag])

    def bounds(self, response: Reals) -> tuple[Array, Array]:
        """Return what each period adds to both bounds, (q, b), from p and r, (q, 2, b)."""
        p, r = response[:, 0], response[:, 1]
        held: Array = np.abs(p * self.drag[0] + r * self.drag[1]) * self.gamma_1
        bounded: Array = np.abs(p) * self.sizes[0] + np.abs(r) * self.sizes[1] + held
        return bounded, self.gamma_2 * modulus(r, r + self.h * p, self.h) + held

    def most(self, sums: Array) -> Array:
        """Return the bound by |Δ|, from the sums of the moduli, (q, 4, …)."""
        p, r, _, held = np.moveaxis(sums, 1, 0)
        found: Array = p * self.sizes[0] + r * self.sizes[1] + held * self.gamma_1
        return found

    def free(self, sums: Array, pushed: Array) -> Array:
        """Return the bound by |a_0|, from the sums of ∫ |r + u p| du, (q, …), too."""
        found: Array = self.gamma_2 * pushed + sums[:, 3] * self.gamma_1
        return found


def slow_sums(slow: SlowModes, seen: Array, of: Moduli, begin: int) -> tuple[Array, Array] | None:
    """Return both bounds' sums, each (q,), over all j >= `begin`, on `seen` x, (q, p).

    None where too many stretches have to be looked at.
    """
    levels = list(_stretches(slow.step))
    longest, radius = levels[-1], float(np.abs(np.diag(slow.step)).max())
    if not radius < 1 or log(LEFT) / log(radius) / longest.length > MOST:
        return None
    power = longest.change + np.eye(len(slow.step))
    if (count := _gone(power, LEFT)) > MOST:
        return None
    rows, bend = seen @ slow.basis, levels[0].change @ levels[0].change
    states = slow.after(begin)[..., None]
    while states.shape[-1] < count:
        states = np.concatenate([states, _times(power, states)], axis=-1)
        power = power @ power
    states = states[..., :count]
    most, free = np.zeros(len(seen)), np.zeros(len(seen))
    doubt, looked = SHARE / count, 0
    scale: Array | None = None
    for stretch in reversed(levels):
        looked += states.shape[-1]
        if looked > MOST:
            return None
        parts = [
            _looked_at(stretch, rows, bend, states[..., at : at + TOGETHER], of)
            for at in range(0, states.shape[-1], TOGETHER)
        ]
        low, high = (np.concatenate([part[i] for part in parts], axis=-1) for i in (0, 1))
        if scale is None:  # of rows that have next to nothing no more is known than of others
            scale = low.sum(axis=-1)
            scale = np.maximum(scale, 1e-9 * scale.max(axis=1, keepdims=True))[..., None]
        with np.errstate(invalid="ignore"):
            open_ = ((high - low) > doubt * scale).any(axis=(0, 1))
        most, free = np.stack([most, free]) + high[..., ~open_].sum(axis=-1)
        states = states[..., open_]
        if not states.shape[-1]:
            return most, free
        if stretch.length > 1:
            half = levels[levels.index(stretch) - 1]
            states = np.concatenate([states, states + _times(half.change, states)], axis=-1)
    return None


def _looked_at(
    stretch: _Stretch, rows: Complex, bend: Complex, states: Complex, of: Moduli
) -> tuple[Array, Array]:
    """Return what stretches come to at least and at most, each (2, q, b): both bounds."""
    L = stretch.length
    ways = np.einsum("wc,scb->swb", of.ways, states)
    begin = _times(rows, ways).real
    total = np.abs(summed := _times(rows, _times(stretch.total, ways)).real)
    if L == 1:
        exact = np.stack(of.bounds(begin[:, :2]))
        return exact, exact
    end = _times(rows, ways + _times(stretch.change, ways)).real
    off = L * L / 8 * _times(np.abs(rows), _times(stretch.most, np.abs(_times(bend, ways))))
    one_sign = (begin * end >= 0) & (np.minimum(np.abs(begin), np.abs(end)) >= off)
    line = np.abs(begin) * ((L + 1) / 2) + np.abs(end) * ((L - 1) / 2)
    at_most = np.where(one_sign, total, np.maximum(line + L * off, total))
    pushed, opposed = modulus(summed[:, 1], summed[:, 2], of.h), begin[:, 1] * begin[:, 2] < 0
    pushed_at_most = np.where(
        one_sign[:, 1] & one_sign[:, 2],
        pushed + np.where(opposed, _opposed(begin, end, summed, off) * of.h, 0.0),
        np.maximum(pushed, (at_most[:, 1] + at_most[:, 2]) * (of.h / 2)),
    )
    low = np.stack([of.most(total), of.free(total, pushed)])
    return low, np.stack([of.most(at_most), of.free(at_most, pushed_at_most)])


def _opposed(begin: Array, end: Array, summed: Array, off: Array) -> Array:
    """Return by how much Σ ∫ |r + u p| du / h is more than that of Σ r and Σ p, (q, b), at most.

    Of r and q = r + h p of opposite signs that is Σ |q − r| (t − t̄)², where t = q/(q − r), and t̄ is
    that of the sums. On the line between the ends t is between theirs; off it, not far from there.
    """
    apart = [part[:, 2] - part[:, 1] for part in (begin, end, summed)]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, last, mean = (
            part[:, 2] / width for part, width in zip((begin, end, summed), apart, strict=True)
        )
        least = np.minimum(np.abs(apart[0]), np.abs(apart[1])) - off[:, 1] - off[:, 2]
        strayed = (off[:, 1] + 2 * off[:, 2]) / np.maximum(least, 0.0)
        farthest = np.maximum(np.abs(first - mean), np.abs(last - mean)) + strayed
        found: Array = np.nan_to_num(np.abs(apart[2]) * farthest**2, nan=np.inf)
    return found


def _times(A: NDArray[Any], stacked: NDArray[Any]) -> NDArray[Any]:
    """Multiply (a, s) by (s, …)."""
    found: NDArray[Any] = A @ stacked.reshape(len(stacked), -1)
    return found.reshape(len(A), *stacked.shape[1:])


def modulus(first: Reals, last: Reals, h: float | Array) -> Array:
    """Return ∫ |f| over 0 … h of what goes straight from `first` to `last`, in their shape."""
    apart = np.abs(last - first)
    crossed = (first**2 + last**2) / np.where(apart > 0, 2 * apart, 1)
    mean: Array = np.where(first * last >= 0, np.abs(first + last) / 2, crossed)
    return h * mean
