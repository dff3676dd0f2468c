"""ρ over any two axes of a scenario, from theory alone: nothing is run, no plant is opened.

Over links that are late or lose samples it is what the errors are multiplied by over these, of the
root of their mean square where samples are lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError
from nrs_cosim.estimator_agents.theory.aperiodic import RadiusBounds
from nrs_cosim.orchestrator.analysis.link_recursions import radius_over
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.study.axes import StudyAxis, axis_of, grid_points, with_draw
from nrs_cosim.orchestrator.study.points import PointReader

Array = NDArray[np.float64]
_MARKS = {"proven": ".", "refuted": "#", "not decided": "~", "unknown": "?"}


@dataclass(frozen=True, slots=True, eq=False)
class RadiusMap:
    """ρ on a grid, by bounds that mostly are one number; not a number where nothing is known."""

    axes: tuple[StudyAxis, StudyAxis]
    """x and y."""
    lower: Array
    """(y, x)"""
    upper: Array

    def values(self) -> tuple[list[Any], list[Any]]:
        """Return the values of the first keys of x and y."""
        x, y = ([value[0] for value in axis.values] for axis in self.axes)
        return x, y

    def as_json(self) -> dict[str, Any]:
        """Return the map for JSON: rows of y, null where nothing is known."""
        names = zip("xy", self.axes, self.values(), strict=True)
        axes = {name: {"keys": list(a.keys), "values": values} for name, a, values in names}
        grids = {"lower": self.lower, "upper": self.upper}
        known = {
            name: [[v if np.isfinite(v) else None for v in row] for row in grid.tolist()]
            for name, grid in grids.items()
        }
        return {**axes, **known}

    def lines(self) -> dict[str, str]:
        """Return what is told of it, and rows of marks, the last y first."""
        x, y = self.values()
        marks = [
            "".join(_MARKS[_status(*at)] for at in zip(*row, strict=True))
            for row in zip(self.lower, self.upper, strict=True)
        ]
        names = {mark: name for name, mark in _MARKS.items()}
        said = {"proven": "ρ < 1", "refuted": "ρ >= 1"}
        seen = {
            mark: said.get(name, name) for mark, name in names.items() if mark in "".join(marks)
        }
        width = max(len(str(value)) for value in y)
        rows = {f"{value!s:>{width}}": row for value, row in zip(y[::-1], marks[::-1], strict=True)}
        found = {
            "x": f"{self.axes[0].keys[0]}, {x[0]} to {x[-1]}",
            "y": self.axes[1].keys[0],
            **rows,
        }
        if np.isfinite(self.upper).any():
            row, column = np.unravel_index(np.nanargmin(self.upper), self.upper.shape)
            at = f"x = {x[column]}, y = {y[row]}"
            found["least"] = f"ρ = {self.upper[row, column]:.6g} at {at}"
        return {**found, "marks": ", ".join(f"{mark} {name}" for mark, name in seen.items())}


def _status(lower: float, upper: float) -> str:
    return RadiusBounds(lower, upper).status if np.isfinite(upper) else "unknown"


def radius_map(experiment: Experiment, over: Sequence[str]) -> RadiusMap:
    """Return ρ over two axes, as `nrs sweep` reads them; `InputError` says what is wrong."""
    axes = with_draw([axis_of("--over", text) for text in over], None)
    if len(axes) != 2:
        raise InputError(f"--over: a map is over two axes, got {len(axes)}")
    points = PointReader({experiment.name: experiment})
    found = [radius_over(points.at(values).experiment) for values in grid_points(axes)]
    shape = tuple(len(axis.values) for axis in axes)
    lower, upper = (
        np.array([getattr(one, end) for one in found]).reshape(shape).T
        for end in ("lower", "upper")
    )
    return RadiusMap((axes[0], axes[1]), lower, upper)
