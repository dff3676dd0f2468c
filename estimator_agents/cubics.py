"""Pieces c_0 + c_1 s + c_2 s² + c_3 s³ of the time s since each began, by IEEE's + − × ÷ alone.

Through positions x_i and velocities v_i at t_i, with h_i = t_{i+1} − t_i and slopes
d_i = (x_{i+1} − x_i)/h_i, the piece of Hermite has

    c_0 = x_i,   c_1 = v_i,   c_2 = (d_i − v_i)/h_i − h_i c_3,   c_3 = (v_i + v_{i+1} − 2 d_i)/h_i².

The spline has the velocities at which the acceleration is continuous at the inner times,

    h_i v_{i−1} + 2 (h_{i−1} + h_i) v_i + h_{i−1} v_{i+1} = 3 (h_i d_{i−1} + h_{i−1} d_i),

and its rate is at the first and the last of them (not-a-knot). These rows are diagonally dominant
once they are freed of the first and last unknown: they are solved from the first on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nrs_cosim.bus import former_mathematics

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Cubics:
    """The pieces between increasing times, on m axes."""

    times: Array
    """(s,)"""
    coefficients: Array
    """(4, s − 1, m), from c_0 on"""

    def at(self, seconds: ArrayLike, order: int = 0) -> Array:
        """Return the derivative of an order, up to 2, at times (…): (…, m); NaN beyond all."""
        if former_mathematics.is_former():
            return former_mathematics.former_cubics(self.times, self.coefficients, seconds, order)
        t = np.asarray(seconds, float)
        within = (t >= self.times[0]) & (t <= self.times[-1])
        last = len(self.times) - 2
        piece = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, last)
        s = np.where(within, t - self.times[piece], np.nan)[..., None]
        c0, c1, c2, c3 = self.coefficients[:, piece]
        found: Array = (
            c0 + s * (c1 + s * (c2 + s * c3)),
            c1 + s * (2 * c2 + 3 * s * c3),
            2 * c2 + 6 * s * c3,
        )[order]
        return found


def hermite(times: Array, positions: Array, velocities: Array) -> Cubics:
    """Return the cubics through positions and velocities, both (s, m), at s ≥ 2 times."""
    if former_mathematics.is_former():
        return Cubics(times, former_mathematics.former_hermite(times, positions, velocities))
    with np.errstate(all="ignore"):  # what is not finite is told elsewhere
        h = np.diff(times)[:, None]
        slope = np.diff(positions, axis=0) / h
        c3 = (velocities[:-1] + velocities[1:] - 2 * slope) / (h * h)
        c2 = (slope - velocities[:-1]) / h - h * c3
    return Cubics(times, np.stack([positions[:-1], velocities[:-1], c2, c3]))


def spline(times: Array, positions: Array) -> Cubics:
    """Return the spline through positions (s, m) at s ≥ 2 times; `ValueError` as below."""
    if former_mathematics.is_former():
        return Cubics(times, former_mathematics.former_spline(times, positions))
    return hermite(times, positions, _spline_velocities(times, positions))


def _spline_velocities(times: Array, positions: Array) -> Array:
    """Return the velocities, (s, m), of the spline through positions at s ≥ 2 times.

    `ValueError` where two times are so near to one another that rounding leaves none.
    """
    with np.errstate(all="ignore"):  # as in `hermite`
        h = np.diff(times)
        slope = np.diff(positions, axis=0) / h[:, None]
        if len(h) == 1:
            return np.concatenate([slope, slope])
        span = h[:-1] + h[1:]
        bend = (slope[1:] - slope[:-1]) / span[:, None]
        inner = 3 * (h[1:, None] * slope[:-1] + h[:-1, None] * slope[1:])
        if len(h) == 2:  # the parabola
            ends = slope[0] - h[0] * bend[0], slope[1] + h[1] * bend[0]
            return np.stack([ends[0], slope[0] + h[0] * bend[0], ends[1]])
        # h_1 v_0 + (h_0 + h_1) v_1 = first, so that v_0 falls out of the first inner row.
        first, last = (
            ((a + 2 * (a + b)) * b * of_a + a * a * of_b) / (a + b)
            for a, b, of_a, of_b in (
                (h[0], h[1], slope[0], slope[1]),
                (h[-1], h[-2], slope[-1], slope[-2]),
            )
        )
        diagonal = 2 * span
        diagonal[[0, -1]] = span[[0, -1]]
        inner[0] -= first
        inner[-1] -= last
        solved = _solved(h[2:], diagonal, h[:-2], inner)
        begin = (first - span[0] * solved[0]) / h[1]
        end = (last - span[-1] * solved[-1]) / h[-2]
        return np.concatenate([begin[None], solved, end[None]])


def _solved(below: Array, diagonal: Array, above: Array, right: Array) -> Array:
    """Return x, (n, m), of below_i x_{i−1} + diagonal_i x_i + above_i x_{i+1} = right_i."""
    pivots, factors = diagonal.tolist(), [0.0]
    for i, (low, high) in enumerate(zip(below.tolist(), above.tolist(), strict=True), 1):
        factors.append(low / (pivots[i - 1] or nan))
        pivots[i] -= factors[i] * high
    return np.stack([_axis(pivots, factors, above.tolist(), b.tolist()) for b in right.T], axis=1)


def _axis(
    pivots: Sequence[float], factors: Sequence[float], above: Sequence[float], x: list[float]
) -> Array:
    for i in range(1, len(x)):
        x[i] -= factors[i] * x[i - 1]
    if 0.0 in pivots:
        raise ValueError("two times are too near to one another")
    x[-1] /= pivots[-1]
    for i in range(len(x) - 2, -1, -1):
        x[i] = (x[i] - above[i] * x[i + 1]) / pivots[i]
    return np.array(x)
