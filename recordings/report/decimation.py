"""A curve of many points is drawn by few that look the same: of each bucket the least, the largest.

The buckets are equal stretches of the row of points, about one for each pixel. What is kept are
points of the curve, never means of them, so no extreme is lost, and a gap (NaN) stays a gap.
"""

import numpy as np
from numpy.typing import NDArray

BUCKETS = 900


def kept(y: NDArray[np.float64], buckets: int = BUCKETS) -> NDArray[np.intp]:
    """Return which points of a curve (rows,) are drawn, ascending: all if they are few."""
    rows = len(y)
    if rows <= 2 * buckets:
        return np.arange(rows)
    width = -(-rows // buckets)
    padded = np.full(buckets * width, np.nan)
    padded[:rows] = y
    table = padded.reshape(buckets, width)
    gap = np.isnan(table)
    starts = np.arange(buckets) * width
    found = [
        np.where(gap, np.inf, table).argmin(axis=1) + starts,
        np.where(gap, -np.inf, table).argmax(axis=1) + starts,
        gap.argmax(axis=1) + starts,
        np.array([0, rows - 1]),
    ]
    found[2] = found[2][gap.any(axis=1)]
    all_found = np.unique(np.concatenate(found))
    return all_found[all_found < rows]
