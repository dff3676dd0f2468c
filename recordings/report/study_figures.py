"""What is drawn of a study: maps over two axes, and slices along one, on paper or for a page.

A map has in each cell the share of runs that converged, or the median error of those that did; over
it lies what theory says without a run: where ρ = 1, and where the smallest margin of the conditions
is 0. Where links draw what they lose, ρ is of mean squares, and the line up to which almost every
run converges is beside it. Cells of refined axes are drawn up to the next value; points drawn at
random are dots.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure as Sheet
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from nrs_cosim.recordings.report.print import INKS, METADATA, STYLE, write_pages

Array = NDArray[np.float64]
_RADIUS, _MARGIN, _ALMOST = "#c2255c", "#1b1f24", "#7048e8"
_ALMOST_NAME, _MEAN_SQUARE = "e^λ = 1, almost surely (by simulation)", "mean-square radius"
_NONE = "#d5d9de"
_OUTLINED = [withStroke(linewidth=2.5, foreground="white")]
"""So that a mark is seen on each colour of a map."""


@dataclass(frozen=True, slots=True, eq=False)
class StudyMap:
    """Cells over two axes of numbers; arrays are (cells,), NaN where nothing is known."""

    title: str
    x_name: str
    y_name: str
    x: Array
    y: Array
    share: Array
    """Of runs with a result, those that converged."""
    error: Array
    """The median of those."""
    failed: NDArray[np.bool_]
    """Whether a run of the cell has no result."""
    radius: Array
    """Where theory has ρ = 1, (places, 2)."""
    margin: Array
    """Where the smallest margin of the conditions is 0, (places, 2)."""
    impaired: bool = False
    """Whether links have faults, which ρ is of and the conditions are not."""
    almost_sure: Array | None = None
    """Where e^λ = 1, (places, 2); None where links draw nothing, so that it is ρ."""


@dataclass(frozen=True, slots=True, eq=False)
class StudyLine:
    """Values along an axis; all arrays are (values,), NaN where nothing is known."""

    name: str
    x: Array
    share: tuple[Array, Array, Array]
    """With Wilson's interval."""
    error: tuple[Array, Array, Array]
    """The median, and the quantiles of 10 % and 90 % over the seeds."""
    bounds: Mapping[str, Array]
    """On that error, by name."""
    rate: Array
    radius: Array
    growth: Array | None = None
    """e^λ; None where links draw nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class StudySlice:
    """Lines along one axis, one for each combination of the others."""

    x_name: str
    lines: Sequence[StudyLine]


def write_study_figures(
    maps: Sequence[StudyMap], slices: Sequence[StudySlice], path: Path, form: str
) -> None:
    """Write all figures: `png` and `svg` one under another, `pdf` each on its page."""
    if form == "pdf":
        write_pages(study_sheets(maps, slices), path)
        return
    with mpl.rc_context(STYLE):
        _together(maps, slices).savefig(path, format=form, dpi=160, metadata=METADATA[form])


def study_sheets(maps: Sequence[StudyMap], slices: Sequence[StudySlice]) -> list[Sheet]:
    """Return each figure by itself."""
    with mpl.rc_context(STYLE):
        sheets = []
        for one in maps:
            sheet = Sheet(figsize=(9.0, 3.7), layout="constrained")
            _draw_map(sheet, one)
            sheets.append(sheet)
        for one_slice in slices:
            sheet = Sheet(figsize=(9.0, _height(one_slice)), layout="constrained")
            _draw_slice(sheet, one_slice)
            sheets.append(sheet)
        return sheets


def study_svgs(maps: Sequence[StudyMap], slices: Sequence[StudySlice]) -> list[str]:
    """Return each figure as text in SVG, to stand in a page."""
    found = []
    for sheet in study_sheets(maps, slices):
        buffer = BytesIO()
        with mpl.rc_context(STYLE):
            sheet.savefig(buffer, format="svg", metadata=METADATA["svg"])
        text = buffer.getvalue().decode()
        found.append(text[text.index("<svg") :])
    return found


def _together(maps: Sequence[StudyMap], slices: Sequence[StudySlice]) -> Sheet:
    with mpl.rc_context(STYLE):
        heights = [3.7] * len(maps) + [_height(one) for one in slices]
        sheet = Sheet(figsize=(9.0, sum(heights) or 1.0), layout="constrained")
        if not heights:
            sheet.text(0.5, 0.5, "no axis has two numbers", ha="center", va="center")
            return sheet
        parts: Any = sheet.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
        for part, one in zip(parts[:, 0], maps, strict=False):
            _draw_map(part, one)
        for part, one_slice in zip(parts[len(maps) :, 0], slices, strict=True):
            _draw_slice(part, one_slice)
        return sheet


def _draw_map(sheet: Any, one: StudyMap) -> None:
    left, right = sheet.subplots(1, 2, sharex=True, sharey=True)
    sheet.suptitle(one.title, fontsize=9)
    _cells(left, one, one.share, {"cmap": "RdYlBu", "vmin": 0.0, "vmax": 1.0}, "share converged")
    known = one.error[np.isfinite(one.error) & (one.error > 0)]
    norm = LogNorm(known.min(), max(known.max(), known.min() * 1.01)) if len(known) else None
    _cells(
        right, one, one.error, {"cmap": "viridis", "norm": norm}, "median sup |eps - eps_0|, rad"
    )
    for axes in (left, right):
        handles = _marks(axes, one)
        axes.set_xlabel(one.x_name)
        axes.grid(visible=False)
        for name, values, scale in (("x", one.x, axes.set_xscale), ("y", one.y, axes.set_yscale)):
            if _is_logarithmic(values):
                scale("log")
            getattr(axes, f"set_{name}lim")(*_limits(values))
    left.set_ylabel(one.y_name)
    if handles:
        sheet.legend(handles=handles, loc="outside lower center", ncols=len(handles))


def _cells(axes: Axes, one: StudyMap, values: Array, look: Mapping[str, Any], name: str) -> None:
    axes.set_facecolor(_NONE)
    xs, ys = np.unique(one.x), np.unique(one.y)
    if max(len(xs), len(ys)) < len(one.x):
        grid = np.full((len(ys), len(xs)), np.nan)
        seen = np.zeros(grid.shape, bool)
        at = np.searchsorted(ys, one.y), np.searchsorted(xs, one.x)
        grid[at], seen[at] = values, True
        drawn: Any = axes.pcolormesh(
            _edges(xs), _edges(ys), _next_to(grid, seen), shading="flat", rasterized=True, **look
        )
    else:
        drawn = axes.scatter(
            one.x, one.y, c=values, s=22, edgecolors="#5a6470", linewidths=0.3, **look
        )
    bar = axes.figure.colorbar(drawn, ax=axes, pad=0.02)
    bar.outline.set_visible(False)
    axes.set_title(name, fontsize=8)


def _next_to(grid: Array, seen: NDArray[np.bool_]) -> Array:
    """Fill cells that were not run from the nearest on their line: of the axis that was refined."""
    along = 1 if seen.any(axis=1).all() and len(grid) <= grid.shape[1] else 0
    filled = grid if along else grid.T.copy()
    mask = seen if along else seen.T
    for row, there in zip(filled, mask, strict=True):
        places = np.flatnonzero(there)
        if len(places):
            nearest = places[np.abs(np.arange(len(row))[:, None] - places).argmin(axis=1)]
            row[:] = row[nearest]
    return filled if along else filled.T


def _marks(axes: Axes, one: StudyMap) -> list[Any]:
    """Draw where theory has its boundaries, and runs failed; return what the legend says of it."""
    failed = np.stack([one.x, one.y], axis=1)[one.failed]
    handles, of = [], ", of links without faults" * one.impaired
    draws = one.almost_sure is not None
    almost = np.empty((0, 2)) if one.almost_sure is None else one.almost_sure
    for places, marker, size, colour, name in (
        (failed, "s", 7, "none", "a run failed"),
        (one.margin, "x", 6, _MARGIN, f"conditions{of}: margin 0"),
        (one.radius, ".", 6, _RADIUS, f"theory: {_MEAN_SQUARE if draws else 'ρ'} = 1"),
        (almost, "^", 4, _ALMOST, f"theory: {_ALMOST_NAME}"),
    ):
        if len(places):
            look: Any = {"ls": "", "ms": size, "marker": marker, "color": colour, "label": name}
            look |= {"mec": _MARGIN} if colour == "none" else {}
            handles += axes.plot(places[:, 0], places[:, 1], path_effects=_OUTLINED, **look)
    return handles


def _draw_slice(sheet: Any, one: StudySlice) -> None:
    share, error, rate = sheet.subplots(1, 3)
    for number, line in enumerate(one.lines):
        colour = INKS[number % len(INKS)]
        middle, low, high = line.share
        share.plot(line.x, middle, ".-", color=colour, label=line.name)
        share.fill_between(line.x, low, high, color=colour, alpha=0.15, lw=0)
        middle, low, high = line.error
        error.plot(line.x, middle, ".-", color=colour)
        error.fill_between(line.x, low, high, color=colour, alpha=0.2, lw=0)
        for (name, bound), style in zip(line.bounds.items(), ("--", ":", "-."), strict=False):
            error.plot(line.x, bound, style, color=colour, label=name if number == 0 else None)
        rate.plot(line.x, line.rate, ".", color=colour, label="measured" if number == 0 else None)
        name = f"theory: {'ρ' if line.growth is None else _MEAN_SQUARE}"
        rate.plot(line.x, line.radius, "-", color=colour, label=name if number == 0 else None)
        if line.growth is not None:
            name = "theory: e^λ, almost surely"
            rate.plot(line.x, line.growth, "--", color=colour, label=name if number == 0 else None)
    rate.axhline(1.0, color="#9aa2ab", lw=0.8)
    share.set_ylim(-0.03, 1.03)
    for axes, title in (
        (share, "share converged, 95 %"),
        (error, "sup |eps - eps_0|, rad, 10 to 90 %"),
        (rate, "factor a sampling time"),
    ):
        axes.set_title(title, fontsize=8)
        axes.set_xlabel(one.x_name)
        if _is_logarithmic(np.concatenate([line.x for line in one.lines])):
            axes.set_xscale("log")
    lows = [v for line in one.lines for v in line.error[0] if np.isfinite(v) and v > 0]
    if lows:
        error.set_yscale("log")
    for axes in (error, rate):
        if axes.get_legend_handles_labels()[0]:
            axes.legend(frameon=True, edgecolor="none")
    if len(one.lines) > 1:
        handles, _ = share.get_legend_handles_labels()
        sheet.legend(handles=handles, loc="outside lower center", ncols=_columns(one))


def _columns(one: StudySlice) -> int:
    """Return how many names of lines stand beside one another below a slice."""
    return max(1, min(len(one.lines), 150 // (8 + max(len(line.name) for line in one.lines))))


def _height(one: StudySlice) -> float:
    """Return how high a slice is with the names of its lines, inches."""
    return 3.2 + 0.16 * -(-len(one.lines) // _columns(one)) * (len(one.lines) > 1)


def _edges(values: Array) -> Array:
    """Return the edges of cells around values, half-way between them."""
    if len(values) == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    if _is_logarithmic(values):
        return np.exp(_edges(np.log(values)))
    middle = (values[1:] + values[:-1]) / 2
    return np.array([2 * values[0] - middle[0], *middle, 2 * values[-1] - middle[-1]])


def _limits(values: Array) -> tuple[float, float]:
    edges = _edges(np.unique(values))
    return float(edges[0]), float(edges[-1])


def _is_logarithmic(values: Array) -> bool:
    """Return whether values lie evenly by factors rather than by differences."""
    found = np.unique(values)
    if len(found) < 4 or found[0] <= 0 or found[-1] < 10 * found[0]:
        return False
    return bool(np.median(np.diff(found)) < 0.3 * (found[-1] - found[0]) / (len(found) - 1))


def write_radius_map(
    names: tuple[str, str],
    values: tuple[Array, Array],
    radius: Array,
    growth: Array | None,
    path: Path,
    form: str,
) -> None:
    """Write ρ, (y, x), over two axes of numbers, with the line where it is 1.

    And that where e^λ is 1, where samples are lost; ρ is of the mean square there.
    """
    (x, y), name = values, "ρ" if growth is None else _MEAN_SQUARE
    with mpl.rc_context(STYLE):
        sheet = Sheet(figsize=(5.4, 4.0), layout="constrained")
        axes = sheet.subplots()
        axes.set_facecolor(_NONE)
        shown = np.clip(radius, 0.0, 2.0)
        drawn = axes.pcolormesh(
            _edges(x), _edges(y), shown, cmap="RdYlBu_r", vmin=0.0, vmax=2.0, rasterized=True
        )
        handles = []
        for grid, colour, line in (
            (shown, _RADIUS, f"{name} = 1"),
            (growth, _ALMOST, _ALMOST_NAME),
        ):
            known = np.empty(0) if grid is None else grid[np.isfinite(grid)]
            if min(len(x), len(y)) > 1 and len(known) and known.min() < 1 < known.max():
                axes.contour(x, y, grid, levels=[1.0], colors=[colour])
                handles += axes.plot([], [], color=colour, label=line)
        axes.set(xlabel=names[0], ylabel=names[1], title=f"theory: {name} of the estimates")
        if growth is not None and handles:
            sheet.legend(handles=handles, loc="outside lower center", ncols=2)
        for ticks, scale in ((x, axes.set_xscale), (y, axes.set_yscale)):
            if _is_logarithmic(ticks):
                scale("log")
        axes.grid(visible=False)
        sheet.colorbar(drawn, ax=axes, label=f"{name}, up to 2")
        sheet.savefig(path, format=form, dpi=160, metadata=METADATA[form])
