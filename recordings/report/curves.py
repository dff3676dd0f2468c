"""What a figure is made of: panels of curves, for any painter.

A curve is a row of points that was decimated already: of each of some equal stretches, about one a
pixel, the least and the largest are kept. They are points and never means, so no extreme is lost,
and a gap (NaN) stays a gap.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TARGET = "target"
"""The group of the target's curves and of the theory's: in the colour of ink."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Points (rows,) of x in s and y; `ink` is the colour's number, None that of the text."""

    name: str
    group: str
    x: Array
    y: Array
    ink: int | None
    dash: str = "solid"
    """One of `DASHES`."""
    width: float = 1.0
    marks: bool = False
    """Whether points are marked, so that one alone is seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """What is between two curves over the same x, (rows,) each."""

    name: str
    group: str
    x: Array
    low: Array
    high: Array
    ink: int | None
    opacity: float


DASHES = ("solid", "dash", "dot", "dashdot", "longdash")


@dataclass(frozen=True, slots=True, eq=False)
class Label:
    """What stands beside the end of a curve, in its colour."""

    text: str
    x: float
    y: float
    """Where the curve ends."""
    shift: float
    """How much higher the text is, in heights of the axes, so that no two lie on one another."""
    ink: int | None


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """Curves in one pair of axes. `_i` in a label is an index."""

    label: str
    curves: tuple[Curve, ...]
    joint: int | None = None
    logarithmic: bool = False
    legend: bool = False
    """Whether its curves have names of their own, and not only their groups'."""
    rows: tuple[str, ...] = ()
    """Names of y = 0, 1, … from the top, where y is no number."""
    labels: tuple[Label, ...] = ()
    y_range: tuple[float, float] | None = None
    """What labels were placed for."""
    bands: tuple[Band, ...] = ()
    """Drawn behind the curves."""
    joint_name: str = ""
    """What the joint is called."""


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """Panels that belong together."""

    name: str
    title: str
    about: str
    panels: tuple[Panel, ...]
    columns: int = 2


BUCKETS = 900


def kept(y: Array, buckets: int = BUCKETS, last: int = 0) -> NDArray[np.intp]:
    """Return which points of a curve (rows,) are drawn, ascending: all if they are few.

    So many rows at the end are drawn as finely as all together.
    """
    if last:
        return np.union1d(kept(y, buckets), kept(y[-last:], buckets) + len(y) - last)
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


MOST_LABELS = 12
_GAP = 1 / MOST_LABELS
"""Between two labels, in heights of the axes."""


def logarithmic_panel(label: str, curves: Sequence[Curve], texts: Sequence[str]) -> Panel:
    """Return a panel of positive numbers, each curve with a text at its end; an empty one has none.

    More texts than there is room for are left to the legend.
    """
    ends = [np.flatnonzero(np.isfinite(curve.y) & (curve.y > 0)) for curve in curves]
    seen = [curve.y[at] for curve, at in zip(curves, ends, strict=True)]
    values = np.log10(np.concatenate([*seen, np.empty(0)]))
    if not len(values):
        return Panel(label, tuple(curves), logarithmic=True, legend=True)
    margin = 0.05 * max(float(np.ptp(values)), 0.5)
    low, high = float(values.min()) - margin, float(values.max()) + margin
    wanted = [n for n, text in enumerate(texts) if text and len(ends[n])]
    places = np.array([(np.log10(seen[n][-1]) - low) / (high - low) for n in wanted])
    end = max(float(curves[n].x[ends[n][-1]]) for n in wanted) if wanted else 0.0
    labels = tuple(
        Label(
            texts[n],
            min(float(curves[n].x[ends[n][-1]]), end),
            float(seen[n][-1]),
            float(at - place),
            curves[n].ink,
        )
        for n, place, at in zip(wanted, places, spread(places, _GAP), strict=True)
    )
    return Panel(
        label,
        tuple(curves),
        logarithmic=True,
        legend=True,
        labels=labels if len(labels) <= MOST_LABELS else (),
        y_range=(10**low, 10**high),
    )


def spread(places: Array, gap: float) -> Array:
    """Return the places in [0, 1] that are nearest to some (n,), no two nearer than a gap.

    With z_i = place_i − i·gap in ascending order this is isotonic regression: neighbours out of
    order are pooled at their mean.
    """
    order = np.argsort(places, kind="stable")
    pools: list[list[float]] = []
    for number, place in enumerate(places[order].tolist()):
        pools.append([place - number * gap, 1])
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            (one, few), (other, more) = pools[-2], pools.pop()
            pools[-1] = [(one * few + other * more) / (few + more), few + more]
    pooled = np.repeat([mean for mean, _ in pools], [int(count) for _, count in pools])
    found = np.empty(len(places))
    most = max(1 - gap * (len(places) - 1), 0.0)
    found[order] = np.clip(pooled, 0.0, most) + gap * np.arange(len(places))
    return found
