"""Of the seeds of a cell: the share that converged, and the errors, each with its uncertainty.

The share k of n lies, with confidence 95 %, in Wilson's interval, of (p + z²/2n ± z √(p(1 − p)/n +
z²/4n²)) / (1 + z²/n) with z = 1.96; it is right for a few seeds, and for all or none of them. Of an
error the median stands with its interval by the bootstrap, percentiles of medians of `RESAMPLES`
draws of the runs with replacement, from a seed of its own, so that it is the same each time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from nrs_cosim.orchestrator.study.rows import QUANTITIES
from nrs_cosim.orchestrator.study.table import Cell, StudyTable

Z = 1.959963984540054
"""Of 95 %, two-sided."""
RESAMPLES = 1000


@dataclass(frozen=True, slots=True)
class Estimated:
    """A number with its interval of confidence; all three may be unknown."""

    value: float | None
    low: float | None
    high: float | None


UNKNOWN_NUMBER = Estimated(None, None, None)


def wilson(k: int, n: int) -> Estimated:
    """Return the share k / n with Wilson's interval; unknown of none."""
    if n == 0:
        return UNKNOWN_NUMBER
    p, z2 = k / n, Z * Z
    middle, half = (p + z2 / (2 * n)), Z * sqrt(p * (1 - p) / n + z2 / (4 * n * n))
    low, high = (middle - half) / (1 + z2 / n), (middle + half) / (1 + z2 / n)
    return Estimated(p, 0.0 if k == 0 else low, 1.0 if k == n else high)


def median_of(values: Sequence[float]) -> Estimated:
    """Return the median with its interval by the bootstrap; of one value no interval."""
    if not values:
        return UNKNOWN_NUMBER
    found = np.sort(np.asarray(values, float))
    middle = float(np.median(found))
    if len(found) == 1:
        return Estimated(middle, None, None)
    draws = np.random.default_rng(len(found)).integers(len(found), size=(RESAMPLES, len(found)))
    low, high = np.percentile(np.median(found[draws], axis=1), [2.5, 97.5])
    return Estimated(middle, float(low), float(high))


@dataclass(frozen=True, slots=True)
class CellStatistics:
    """Of the runs of a cell."""

    cell: Cell
    runs: int
    results: int
    converged: Estimated
    """The share of those with a result."""
    errors: dict[str, Estimated]
    """By quantity, of the runs that converged."""


def statistics_of(
    table: StudyTable, quantities: Sequence[str] = QUANTITIES
) -> list[CellStatistics]:
    """Return the statistics of each cell, in the order of the axes' values."""
    statuses = table.columns["status"]
    found = []
    for cell, places in table.cells.items():
        converged, results = table.share_converged(places)
        good = [place for place in places if statuses[place] == "converged"]
        errors = {
            name: median_of([v for p in good if (v := table.columns[name][p]) is not None])
            for name in quantities
        }
        found.append(CellStatistics(cell, len(places), results, wilson(converged, results), errors))
    return found
