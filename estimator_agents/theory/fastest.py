"""The gains for which errors of estimates shrink fastest, and the robots to pin (G1 to G4).

Each mode of `dcea1` is |1 − α z|, z = 1 − s: convex in α, so that the largest of them has one
minimum; of real z it is 2/(z_min + z_max). Of `dcea2` two modes have the product 1 − β z, so that
no ρ is below r = max |1 − β z|^½, and α h = β (1 − r²)/(1 + r²) attains it. Of other gains that act
together nothing is convex, and the best of a grid is looked at ever more closely.
"""

from collections.abc import Callable, Sequence
from itertools import combinations, product
from math import comb

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.algorithm import Spectrum

Array = NDArray[np.float64]

CLOSER = 200
"""Thirds by which an interval is shortened."""
COARSE, FINE, ZOOMS = 24, 7, 24
"""Values of each gain at first, and then around the best, and how often the grid is made closer."""
SETS = 3000
"""Sets of robots that are all tried."""


def fastest_alone(spectrum: Spectrum) -> float:
    """Return the gain of least max |1 − α (1 − s_i)|."""
    z = 1 - spectrum
    if not np.abs(z.imag).max() > 1e-12 * np.abs(z).max():
        return float(2 / (z.real.min() + z.real.max()))
    low, high = 0.0, 2 / float(z.real.max())

    def largest(alpha: float) -> float:
        return float(np.abs(1 - alpha * z).max())

    for _ in range(CLOSER):
        third = (high - low) / 3
        if largest(low + third) < largest(high - third):
            high -= third
        else:
            low += third
    return (low + high) / 2


def fastest_together(
    spectrum: Spectrum, h: float, beta: float | None = None
) -> tuple[float, float]:
    """Return α and β of least ρ(Γ); α at a β below θ where that is given."""
    if beta is None:
        beta = fastest_alone(spectrum)
    squared = float(np.abs(1 - beta * (1 - spectrum)).max())
    return beta * (1 - squared) / ((1 + squared) * h), beta


def least(
    radius: Callable[[Array], float],
    low: Array,
    high: Array,
    coarse: int = COARSE,
    zooms: int = ZOOMS,
) -> Array:
    """Return the gains, (g,), of the least radius that a search between two bounds finds."""
    axes = [np.geomspace(*ends, coarse) for ends in zip(low, high, strict=True)]
    best = min((np.array(point) for point in product(*axes)), key=radius)
    width = (high / low) ** (1 / (coarse - 1))
    for _ in range(zooms):
        steps = np.linspace(-1, 1, FINE)
        around = [best * width ** np.array(step) for step in product(steps, repeat=len(best))]
        best = min([best, *(np.clip(point, low, high) for point in around)], key=radius)
        width = width**0.6
    return best


def best_pins(
    n: int, count: int, cost: Callable[[Sequence[int]], tuple[float, ...]]
) -> tuple[tuple[int, ...], tuple[int, ...] | None]:
    """Return robots whose pinning costs least: taken one by one, and of all sets if they are few.

    Of those taken one by one, each is then exchanged for another as long as that costs less.
    """
    chosen: list[int] = []
    robots = range(1, n + 1)
    for _ in range(count):
        left = [robot for robot in robots if robot not in chosen]
        chosen.append(min(left, key=lambda robot: cost([*chosen, robot])))
    while True:
        others = [
            [*chosen[:i], robot, *chosen[i + 1 :]]
            for i in range(count)
            for robot in robots
            if robot not in chosen
        ]
        better = min(others, key=cost, default=chosen) if len(others) <= SETS else chosen
        if not cost(better) < cost(chosen):
            break
        chosen = better
    best = None
    if comb(n, count) <= SETS:
        best = min(combinations(robots, count), key=cost)
    return tuple(sorted(chosen)), best
