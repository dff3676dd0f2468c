"""How large a sum of sines comes: f(t) = c + Σ Im z_j e^{jω_j t} on m axes, over all t.

Frequencies in ratios of small whole numbers have a common period, and over it f is searched: a cell
of length d is left when the larger of its ends and d²/8 Σ ω_j² |z_j| (what a chord can miss) are
less than what was found elsewhere. Groups of frequencies without such ratios come as near as one
likes to any phases at once (Kronecker), so that their suprema add up. Ratios are those of numbers
as they are rounded: 0.3 is three times 0.1.
"""

from collections.abc import Iterator
from fractions import Fraction
from math import lcm

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

HARMONICS = 1000
"""The largest whole multiple of a fundamental that is searched; beyond, phases count as free."""
ROUNDING = 1e-15
"""Relative: within it a ratio is that of whole numbers."""
CELLS, PARTS, ROUNDS = 16, 8, 8
"""Cells of one period of the fastest sine, of each that is left in a next round; rounds at most."""
NEAR = 1e-13
"""Relative: how near to the supremum the search comes."""
TINY = 1e-290
"""Sizes below are not divided by: the quotients may overflow."""
MOST_SQUARED = 8
"""Frequencies of which all sums and differences are looked at."""
MOST_CELLS = 100_000
"""Cells that a round may have; where there are more, what is known by then is the answer."""


@np.errstate(over="ignore", invalid="ignore")
def supremum(constant: float, omega: Array, z: Complex) -> float:
    """Return sup |c + Σ Im z_j e^{jω_j t}| for ω, (w,), ≥ 0 and all different, and z, (w,).

    It is never below, and above by 1e-13 at most unless frequencies need more than 1000 multiples.
    """
    still = omega == 0
    constant += float(z[still].imag.sum())
    omega, z = omega[~still & (z != 0)], z[~still & (z != 0)]
    simple = abs(constant) + float(np.abs(z).sum())
    if not np.isfinite(simple):
        return simple
    groups = list(_groups(omega))
    up, down = (sum(_highest(n, sign * z[of]) for of, n in groups) for sign in (1, -1))
    found = max(up + constant, down - constant)
    return simple if found >= simple * (1 - NEAR) else found


@np.errstate(over="ignore", invalid="ignore")
def norm_supremum(constant: Array, omega: Array, z: Complex) -> float:
    """Return sup ‖c + Σ Im z_j e^{jω_j t}‖₂ at most, for c, (m,), ω ≥ 0, (w,), and z, (w, m).

    Its square is such a sum of the sums and differences of frequencies; of too many, and where it
    is less, the norm of the axes' own suprema is returned.
    """
    each = zip(constant.tolist(), z.T, strict=True)
    simple = float(np.linalg.norm([supremum(c, omega, own) for c, own in each]))
    if len(omega) > MOST_SQUARED or not np.isfinite(simple):
        return simple
    frequency = np.concatenate([[0.0], omega, -omega])
    weight = np.concatenate([constant[None], z / 2j, -z.conj() / 2j])
    squares = (weight @ weight.T).ravel()
    sums, place = np.unique((frequency[:, None] + frequency).ravel(), return_inverse=True)
    total = np.zeros(len(sums), complex)
    np.add.at(total, place, squares)
    up = sums > 0
    most = supremum(float(total[sums == 0].real.sum()), sums[up], 2j * total[up])
    return min(simple, float(np.sqrt(most)))


def _groups(omega: Array) -> Iterator[tuple[NDArray[np.intp], Array]]:
    """Yield which frequencies are whole multiples of one fundamental, and the multiples."""
    left = list(range(len(omega)))
    while left:
        first, members, ratios = left[0], [left[0]], [Fraction(1)]
        for j in left[1:]:
            ratio = omega[j] / omega[first]
            if not ratio <= HARMONICS:
                continue
            near = Fraction(float(ratio)).limit_denominator(HARMONICS)
            if not abs(float(near) - ratio) <= ROUNDING * ratio:
                continue
            shared = lcm(*(part.denominator for part in (*ratios, near)))
            if max(part * shared for part in (*ratios, near)) <= HARMONICS:
                members.append(j)
                ratios.append(near)
        shared = lcm(*(part.denominator for part in ratios))
        yield np.array(members), np.array([float(part * shared) for part in ratios])
        left = [j for j in left if j not in members]


def _highest(n: Array, z: Complex) -> float:
    """Return sup Σ Im z_j e^{j n_j τ} of whole n: no less, and hardly more."""
    size = float(np.abs(z).sum())
    if len(n) == 1 or size < TINY:
        return size
    z = z / size  # squares of multiples then have room
    bend = float((n**2 * np.abs(z)).sum()) / 8

    def at(tau: Array) -> Array:
        height: Array = (np.exp(1j * tau[..., None] * n) @ z).imag
        return height

    length = 2 * np.pi / (CELLS * n.max())
    start = np.arange(CELLS * n.max()) * length
    best, above = -np.inf, 1.0
    for _ in range(ROUNDS):
        ends = np.maximum(at(start), at(start + length))
        best = max(best, float(ends.max()))
        above = best + bend * length**2
        start = start[ends + bend * length**2 >= best]
        if above - best <= NEAR or len(start) * PARTS > MOST_CELLS:
            break
        length /= PARTS
        start = (start[:, None] + length * np.arange(PARTS)).ravel()
    return size * min(above + NEAR, 1.0)
