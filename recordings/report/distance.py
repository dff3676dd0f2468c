"""How far apart two recordings are over time: a panel a quantity, a curve a robot, log scale."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.recordings.report.decimation import kept
from nrs_cosim.recordings.report.figures import Curve, Figure, Panel
from nrs_cosim.recordings.report.print import write_picture

MOST = 24
"""Robots that are drawn."""

Array = NDArray[np.float64]


def write_distances(
    times: Mapping[int, Array], apart: Mapping[int, Array], names: Sequence[str], path: Path
) -> None:
    """Draw distances into a PNG: of each robot, times in s (t,) and |A − B| (t, quantities)."""
    robots = sorted(times)[:MOST]
    panels = [
        Panel(
            f"|A − B| of {name}",
            tuple(
                _curve(robot, ink, times[robot], apart[robot][:, i])
                for ink, robot in enumerate(robots)
            ),
            logarithmic=True,
        )
        for i, name in enumerate(names)
    ]
    figure = Figure("apart", "How far apart they are", "", tuple(panels))
    write_picture([figure], path, [(f"robot {robot}", ink) for ink, robot in enumerate(robots)])


def _curve(robot: int, ink: int, times: Array, apart: Array) -> Curve:
    """Return one robot's curve; where nothing is apart there is no logarithm, and no point."""
    distances = np.where(apart > 0, apart, np.nan)
    rows = kept(distances)
    return Curve(f"robot {robot}", f"robot {robot}", times[rows], distances[rows], ink)
