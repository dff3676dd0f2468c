"""Where theory has its boundaries on a map, between its points: where ρ = 1, where a margin is 0.

ρ is of the links of each place, of the root of the mean square where they lose samples: there
almost every run converges up to e^λ = 1, which simulation finds (statement L4). Conditions are of
links without faults. On each line of the map, along either axis, neighbours on two sides of
a boundary are bisected by theory alone, which runs nothing. Of many such pairs some are taken,
evenly, so that it is a matter of seconds.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import isfinite, isnan, sqrt
from typing import Any

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.orchestrator.analysis.conditions import conditions_of
from nrs_cosim.orchestrator.analysis.link_recursions import growth_over, radius_over
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.study.axes import rounded
from nrs_cosim.orchestrator.study.point_run import smallest_margin
from nrs_cosim.orchestrator.study.points import PointReader

MOST, HALVINGS = 32, 6
MOST_SIMULATED, HALVINGS_SIMULATED = 12, 3
"""Where a place takes a fifth of a second, and is within a hundredth or so of λ."""
Place = tuple[float, float]
Distance = Callable[[Experiment], float]


def theory_boundary(
    bases: Mapping[str, Experiment],
    others: Mapping[str, Any],
    keys: tuple[str, str],
    values: Mapping[Place, float | None],
    distance: Distance,
    most: int = MOST,
    halvings: int = HALVINGS,
) -> list[Place]:
    """Return places (x, y) on a boundary among cells with such values.

    Values are those of the cells, less than 0 on one side of the boundary, and `distance` has them
    elsewhere. Where a place between is no scenario, or nothing is known, nothing is returned.
    """
    found, reader = [], PointReader(bases)
    pairs = [*_pairs(values, 0), *_pairs(values, 1)]
    step = max(len(pairs) / most, 1)

    def value_at(place: Place) -> float:
        at = {**others, **dict(zip(keys, place, strict=True))}
        return distance(reader.at(at).experiment)

    for number in range(min(len(pairs), most)):
        axis, low, high = pairs[int(number * step)]
        try:
            first = values[low] or 0.0
            place = _bisected(value_at, keys[axis], axis, (low, high), first, halvings)
        except CosimError:
            continue
        found += [place] if place else []
    return found


def below_one(experiment: Experiment) -> float:
    """Return how far ρ is below 1, of bounds the upper; not a number where it is not known."""
    return 1.0 - radius_over(experiment).upper


def almost_surely_below_one(experiment: Experiment) -> float:
    """Return how far e^λ is below 1, of its confidence's middle; nan where it is not known."""
    found = growth_over(experiment)
    return 1.0 - (found.lower + found.upper) / 2


def least_margin(experiment: Experiment) -> float:
    """Return the smallest margin of the conditions; 0 without any."""
    margin = smallest_margin(conditions_of(experiment))
    return 0.0 if margin is None else margin


def _pairs(values: Mapping[Place, float | None], axis: int) -> list[tuple[int, Place, Place]]:
    """Return neighbours along an axis with a boundary between them."""
    lines: dict[float, list[Place]] = {}
    for place, value in values.items():
        if value is not None and isfinite(value):
            lines.setdefault(place[1 - axis], []).append(place)
    found = []
    for line in lines.values():
        line.sort()
        for low, high in pairwise(line):
            if ((values[low] or 0.0) < 0) != ((values[high] or 0.0) < 0):
                found.append((axis, low, high))
    return found


def _bisected(
    value_at: Callable[[Place], float],
    key: str,
    axis: int,
    pair: Sequence[Place],
    first: float,
    halvings: int,
) -> Place | None:
    low, high = pair
    far = low[axis] > 0 and high[axis] > 4 * low[axis]
    for _ in range(halvings):
        a, b = low[axis], high[axis]
        middle = rounded(key, sqrt(a * b) if far else (a + b) / 2)
        place = (middle, low[1]) if axis == 0 else (low[0], middle)
        value = value_at(place)
        if isnan(value):
            return None
        if (value < 0) == (first < 0):
            low = place
        else:
            high = place
    return (low[0] + high[0]) / 2, (low[1] + high[1]) / 2
