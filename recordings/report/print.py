"""The same figures on paper: matplotlib draws what `figures` says.

Only the extra `report` brings matplotlib: whoever imports this module expects an ImportError.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure as Sheet
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from nrs_cosim.recordings.report.curves import Curve, Figure, Label, Panel, kept
from nrs_cosim.recordings.report.data import Story
from nrs_cosim.recordings.report.figures import Group, figures
from nrs_cosim.recordings.units import quantity_unit

INKS = (
    "#0638c5", "#ba8d10", "#2fa49c", "#6e056e", "#985f3a", "#2d4301", "#9b65fc", "#1d759a",
)  # fmt: skip
"""As the page's on white."""
_INK = "#1b1f24"
_SYMBOL = re.compile(r"(?<![A-Za-z0-9_])([ευeėqt]\u0307?)_([ik\d])(?!\w)")
"""The paper's symbols, with an index; as in the page."""
STYLE: dict[Any, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#9aa2ab",
    "axes.grid": True,
    "axes.labelcolor": _INK,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.dpi": 160,
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "grid.alpha": 0.35,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "lines.linewidth": 1.0,
    "pdf.fonttype": 42,  # TrueType: journals refuse Type 3
    "ps.fonttype": 42,
    "svg.hashsalt": "nrs",
    "xtick.color": "#5a6470",
    "ytick.color": "#5a6470",
}
_WIDTH = 8.0
_BESIDE = 30
"""Characters of a label that stands beside its axis; a longer one is above."""
DPI = 300
"""Of pictures for print."""
METADATA: Mapping[str, Mapping[str, Any]] = {
    "png": {"Software": ""},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}
"""By form: without what would be other bytes tomorrow."""
_DASHES: Mapping[str, Any] = {
    "solid": "-",
    "dash": (0, (5, 3)),
    "dot": (0, (1, 1.6)),
    "dashdot": (0, (6, 2, 1, 2)),
    "longdash": (0, (9, 3)),
}


def write_figures(drawn: Sequence[Figure], legend: Sequence[Group], path: Path, form: str) -> None:
    """Write figures for print.

    `png` and `svg` have them one under another, `pdf` each on its page.
    """
    if form != "pdf":
        write_picture(drawn, path, legend, form=form, dpi=DPI)
        return
    with mpl.rc_context(STYLE):
        write_pages([_sheet([figure], legend) for figure in drawn], path)


def write_pages(sheets: Sequence[Sheet], path: Path) -> None:
    """Write a PDF of a page for each sheet; fonts are as the style says when they are written."""
    with mpl.rc_context(STYLE), PdfPages(path, metadata=METADATA["pdf"]) as pages:
        for sheet in sheets:
            pages.savefig(sheet)


def drawn_of(stories: Sequence[Story]) -> list[Figure]:
    """Return the figures of some recordings, one at least."""
    return figures(stories) or [Figure("nothing", "Nothing was recorded", "", ())]


def write_picture(
    drawn: Sequence[Figure],
    path: Path,
    legend: Sequence[Group],
    until: float | None = None,
    form: str = "png",
    dpi: int | None = None,
) -> None:
    """Write some figures one under another, up to a time in s or whole; the same bytes again."""
    with mpl.rc_context(STYLE):
        sheet = _sheet(drawn, legend, until)
        sheet.savefig(path, format=form, metadata=METADATA[form], dpi=dpi or "figure")


def _sheet(drawn: Sequence[Figure], legend: Sequence[Group], until: float | None = None) -> Sheet:
    heights = [_height(figure, legend) for figure in drawn]
    sheet = Sheet(figsize=(_WIDTH, sum(heights)), layout="constrained")
    parts = sheet.subfigures(len(drawn), 1, squeeze=False, height_ratios=heights)
    for figure, part in zip(drawn, parts[:, 0], strict=True):
        if figure.title:
            part.suptitle(figure.title, x=0.015, ha="left", fontsize=10, fontweight="bold")
        rows = -(-len(figure.panels) // figure.columns)
        if not rows:
            continue
        axes = part.subplots(rows, min(figure.columns, len(figure.panels)), squeeze=False)
        for ax, panel in zip(axes.flat, figure.panels, strict=False):
            _draw(ax, panel, until)
        for ax in axes.flat[len(figure.panels) :]:
            ax.set_axis_off()
        for ax in axes.flat[: len(figure.panels)][-axes.shape[1] :]:  # the last of each column
            ax.set_xlabel("simulated time (s)")
        lines = _legend(figure, legend)
        part.legend(handles=lines, loc="outside lower center", ncols=_columns(lines))
    return sheet


def _height(figure: Figure, legend: Sequence[Group]) -> float:
    """Return the height of a figure in inches."""
    lines = _legend(figure, legend)
    named = 0.16 * -(-len(lines) // _columns(lines))
    if any(panel.rows for panel in figure.panels):
        return 1.0 + named + sum(0.14 * len(panel.rows) for panel in figure.panels)
    rows = -(-len(figure.panels) // figure.columns)
    return 0.7 + named + (2.2 if any(panel.legend for panel in figure.panels) else 1.75) * rows


def _draw(ax: Axes, panel: Panel, until: float | None) -> None:
    for band in panel.bands:
        look: Any = {"color": _colour(band.ink), "alpha": band.opacity, "linewidth": 0}
        ax.fill_between(band.x, band.low, band.high, **look)
    for curve in panel.curves:
        seen = curve.x <= until if until is not None else np.ones(len(curve.x), bool)
        if curve.marks:
            seen |= np.isnan(curve.x)
        ax.plot(
            curve.x[seen],
            curve.y[seen],
            color=_colour(curve.ink),
            linestyle=_DASHES[curve.dash],
            linewidth=curve.width * (0.65 if panel.rows else 1.0),
            marker="o" if curve.marks else "",
            markersize=2.2,
            label=_mathematical(curve.name),
        )
    if panel.rows:
        ax.set_yticks(range(len(panel.rows)), panel.rows)
        ax.set_ylim(len(panel.rows) - 0.4, -0.6)
    if panel.rows or len(panel.label) > _BESIDE:
        ax.set_title(_mathematical(panel.label), loc="left", fontsize=8)
    else:
        ax.set_ylabel(_mathematical(panel.label))
    if panel.logarithmic:
        ax.set_yscale("log")
    if panel.y_range:
        ax.set_ylim(*panel.y_range)
    if panel.logarithmic:
        _mark_powers(ax)
    for label in panel.labels if until is None else ():
        _name(ax, label, panel)
    if until is not None:
        ax.set_xlim(0, until)
    ax.margins(x=0.01)


def _mark_powers(ax: Axes) -> None:
    """Mark 1, 2 and 5 of each of less than two decades, and of less even steps: two at least."""
    low, high = ax.get_ylim()
    if high < 100 * low:
        ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)) if high > 5 * low else MaxNLocator(5))
        ax.yaxis.set_major_formatter("{x:g}")
        ax.yaxis.set_minor_formatter(NullFormatter())


def _name(ax: Axes, label: Label, panel: Panel) -> None:
    """Write a curve's name beside its end, with a line between where it stands apart."""
    assert panel.y_range
    low, high = np.log10(panel.y_range)
    height = (np.log10(label.y) - low) / (high - low) + label.shift
    beside = label.x >= max(one.x for one in panel.labels)
    ax.annotate(
        _mathematical(label.text),
        (label.x, label.y),
        (1.03, height) if beside else (4, 2),
        textcoords="axes fraction" if beside else "offset points",
        color=_colour(label.ink),
        fontsize=6.5,
        va="center",
        arrowprops={"arrowstyle": "-", "color": _colour(label.ink), "lw": 0.5} if beside else None,
        annotation_clip=False,
    )


def _legend(figure: Figure, legend: Sequence[Group]) -> list[Line2D]:
    """Return what is named under a figure: its groups, or its curves where they have names."""
    curves = [curve for panel in figure.panels for curve in panel.curves]
    if any(panel.legend for panel in figure.panels):
        # a bound's number stands beside its line
        looks = {curve.name.partition(" ≤")[0]: (curve.ink, curve.dash) for curve in curves}
    else:
        dashes = {curve.group: curve.dash for curve in curves}
        looks = {name: (ink, dashes[name]) for name, ink in legend if name in dashes}
    return [
        Line2D([], [], color=_colour(ink), linestyle=_DASHES[dash], label=_mathematical(name))
        for name, (ink, dash) in looks.items()
    ]


def _columns(lines: Sequence[Line2D]) -> int:
    """Return how many names fit beside one another."""
    longest = max((len(str(line.get_label())) for line in lines), default=1)
    return max(1, min(len(lines), 110 // (longest + 6)))


def _colour(ink: int | None) -> str:
    return _INK if ink is None else INKS[ink % len(INKS)]


def _mathematical(label: str) -> str:
    return _SYMBOL.sub(r"\1$_{\2}$", label.replace("$", r"\$"))


Array = NDArray[np.float64]


def write_distances(
    apart: Mapping[tuple[int, str], tuple[Array, Array]], path: Path, coordinate: str
) -> None:
    """Draw distances into a PNG, of joints in a unit, as `unit_over` has it."""
    robots = sorted({robot for robot, _ in apart})
    legend = [(f"robot {robot}", ink) for ink, robot in enumerate(robots)]
    write_picture([distance_figure(apart, coordinate)], path, legend)


def distance_figure(
    apart: Mapping[tuple[int, str], tuple[Array, Array]], coordinate: str
) -> Figure:
    """Return distances by robot and quantity: times in s (t,) and |A − B| (t,)."""
    robots = sorted({robot for robot, _ in apart})
    panels = []
    for name in dict.fromkeys(name for _, name in apart):
        unit = quantity_unit(name, coordinate)
        curves = [
            _curve(robot, ink, *apart[robot, name])
            for ink, robot in enumerate(robots)
            if (robot, name) in apart
        ]
        label = f"|A − B| of {name}{f' ({unit})' * bool(unit)}"
        panels.append(Panel(label, tuple(curves), logarithmic=True))
    return Figure("apart", "How far apart they are", "", tuple(panels))


def _curve(robot: int, ink: int, times: Array, apart: Array) -> Curve:
    """Return one robot's curve; where nothing is apart there is no logarithm, and no point."""
    distances = np.where(apart > 0, apart, np.nan)
    rows = kept(distances)
    return Curve(f"robot {robot}", f"robot {robot}", times[rows], distances[rows], ink)
