"""Whether the errors of a run's estimates grow, from what was recorded alone.

It is asked where theory has no motion to hold them against: of links that lose samples, of
algorithms that are not linear, of estimates that diverge; and where a plant gave up, which may have
followed estimates beyond all bounds. With s(a, b) the largest ‖ε̄_i(t_k)‖∞ and
‖ῡ_i(t_k)‖∞ over honest robots and the ticks from part a to part b of the run, the rate is

    (s(¾, 1) / s(½, ¾)) ^ (4 / ticks),

by what errors are multiplied at a sampling time. They have grown when each of the last two quarters
has more than `GROWN` times the errors of the quarter before it: what grows does so again and again,
while noise, losses and a target that turns make single quarters unequal.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import inf

import numpy as np

from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import errors_by_tick

GROWN = 1.5
_FEWEST = 8
"""Ticks of a run whose quarters say anything."""
_BEFORE_A_FAILURE = 4
"""The same where a plant gave up, which needs an explanation."""


@dataclass(frozen=True, slots=True)
class Growth:
    """The largest errors of the second, third and fourth quarter of so many ticks."""

    earlier: float
    before: float
    after: float
    ticks: int

    @property
    def rate(self) -> float | None:
        """By what errors are multiplied at a sampling time; None where a quarter has none."""
        if not (0 < self.before < inf and 0 < self.after < inf):
            return None
        return float((self.after / self.before) ** (4 / self.ticks))

    @property
    def has_grown(self) -> bool:
        """Whether they grow by more than chance."""
        return self.after > GROWN * self.before > GROWN**2 * self.earlier


def growth_before(reader: Reader, experiment: Experiment) -> Growth | None:
    """Return how errors had grown when a plant gave up; None where they had not."""
    growth = growth_of(reader, experiment, _BEFORE_A_FAILURE)
    return growth if growth and growth.has_grown else None


def growth_of(reader: Reader, experiment: Experiment, fewest: int = _FEWEST) -> Growth | None:
    """Return how the errors of a recording grow; None where too few ticks say anything."""
    liars = np.array(experiment.byzantine, int) - 1
    sizes = [
        size
        for _, errors in errors_by_tick(reader, experiment.target_at)
        for size in np.abs(np.delete(errors, liars, axis=2)).max(axis=(1, 2, 3)).tolist()
    ]
    n = len(sizes)
    if n < fewest:
        return None
    cuts = n // 4, n // 2, n - n // 4, n
    earlier, before, after = (max(sizes[a:b]) for a, b in pairwise(cuts))
    return Growth(earlier, before, after, n)
