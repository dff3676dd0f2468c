"""ρ over any two axes of a scenario, from theory alone: nothing is run, no plant is opened.

Over links that are late or lose samples it is what the errors are multiplied by over these, of the
root of their mean square where samples are lost. There e^λ of almost every run is simulated from
that boundary on, as far as it is below 1 (statement L4).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError
from nrs_cosim.estimator_agents.theory.aperiodic import RadiusBounds
from nrs_cosim.orchestrator.analysis.link_faults import link_faults_of
from nrs_cosim.orchestrator.analysis.link_recursions import growth_over, radius_over
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.study.axes import StudyAxis, axis_of, grid_points, with_draw
from nrs_cosim.orchestrator.study.points import PointReader

Array = NDArray[np.float64]
_MARKS = {"proven": ".", "almost": "o", "refuted": "#", "not decided": "~", "unknown": "?"}


@dataclass(frozen=True, slots=True, eq=False)
class RadiusMap:
    """ρ on a grid, by bounds that mostly are one number; not a number where nothing is known."""

    axes: tuple[StudyAxis, StudyAxis]
    """x and y."""
    lower: Array
    """(y, x)"""
    upper: Array
    growth: tuple[Array, Array] | None = None
    """e^λ at least and at most, where it was looked for; None where no samples are lost."""

    def values(self) -> tuple[list[Any], list[Any]]:
        """Return the values of the first keys of x and y."""
        x, y = ([value[0] for value in axis.values] for axis in self.axes)
        return x, y

    def as_json(self) -> dict[str, Any]:
        """Return the map for JSON: rows of y, null where nothing is known."""
        names = zip("xy", self.axes, self.values(), strict=True)
        axes = {name: {"keys": list(a.keys), "values": values} for name, a, values in names}
        grids = {"lower": self.lower, "upper": self.upper}
        if self.growth:
            grids |= dict(zip(("almost_sure_lower", "almost_sure"), self.growth, strict=True))
        known = {
            name: [[v if np.isfinite(v) else None for v in row] for row in grid.tolist()]
            for name, grid in grids.items()
        }
        return {**axes, **known}

    def _statuses(self) -> list[list[str]]:
        """Return what is known of each place, (y, x)."""
        almost = self.growth[1] < 1 if self.growth else np.zeros(self.upper.shape, bool)
        return [
            [
                "almost" if status == "refuted" and sure else status
                for status, sure in zip(map(_status, *ends), row, strict=True)
            ]
            for *ends, row in zip(self.lower, self.upper, almost.tolist(), strict=True)
        ]

    def lines(self) -> dict[str, str]:
        """Return what is told of it, and rows of marks, the last y first."""
        x, y = self.values()
        marks = ["".join(map(_MARKS.__getitem__, row)) for row in self._statuses()]
        names = {mark: name for name, mark in _MARKS.items()}
        said = {"proven": "ρ < 1", "refuted": "ρ >= 1"}
        said["almost"] = "ρ >= 1, and almost every run converges, by simulation"
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
    grid = [*grid_points(axes)]
    found = [radius_over(points.at(values).experiment) for values in grid]
    shape = tuple(len(axis.values) for axis in axes)
    lower, upper = (
        np.array([getattr(one, end) for one in found]).reshape(shape).T
        for end in ("lower", "upper")
    )
    growth = None
    if _loses(experiment, axes):

        def growth_at(place: tuple[int, int]) -> tuple[float, float]:
            found = growth_over(points.at(grid[place[1] * shape[1] + place[0]]).experiment)
            return found.lower, found.upper

        growth = _growth_beyond(upper, growth_at)
    return RadiusMap((axes[0], axes[1]), lower, upper, growth)


def _loses(experiment: Experiment, axes: Sequence[StudyAxis]) -> bool:
    """Return whether links lose samples somewhere on a map."""
    losses = any(key.endswith(".loss") for axis in axes for key in axis.keys)
    return losses or bool(experiment.impaired and link_faults_of(experiment).loss.any())


def _growth_beyond(
    radius: Array, growth_at: Callable[[tuple[int, int]], tuple[float, float]]
) -> tuple[Array, Array]:
    """Return e^λ, (y, x), on both sides of the line where it is 1, beyond that where ρ is 1.

    From places where ρ >= 1 beside others where it is not, all is looked at that is connected, and
    their neighbours. Where ρ is below 1 nowhere that is all there is.
    """
    converges, (rows, columns) = radius < 1, radius.shape

    def beside(place: tuple[int, int]) -> list[tuple[int, int]]:
        y, x = place
        around = [(y + up, x + right) for up in (-1, 0, 1) for right in (-1, 0, 1)]
        return [(y, x) for y, x in around if 0 <= y < rows and 0 <= x < columns]

    waiting = [
        place
        for place in np.ndindex(rows, columns)
        if not converges[place]
        and (not converges.any() or any(converges[near] for near in beside(place)))
    ]
    lower, upper, seen = np.full_like(radius, np.nan), np.full_like(radius, np.nan), {*waiting}
    for place in waiting:
        lower[place], upper[place] = growth_at(place)
        if not converges[place]:
            inside = (lower[place] + upper[place]) / 2 < 1
            near = [at for at in beside(place) if at not in seen and converges[at] != inside]
            waiting += near
            seen.update(near)
    return lower, upper
