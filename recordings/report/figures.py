"""What is drawn of recordings: figures of panels of curves, like the paper's, for any painter.

A curve belongs to a group, which is shown and hidden as one and has one colour: a robot where one
recording is drawn, a recording where several lie over one another. A curve is a row of points that
was decimated already: of each of some equal stretches, about one a pixel, the least and the largest
are kept. They are points and never means, so no extreme is lost, and a gap (NaN) stays a gap.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.recordings.report.data import KINDS, LinkEvents, Story

Array = NDArray[np.float64]
Group = tuple[str, int | None]
"""Its name and its colour."""
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
    """solid, dash or dot"""
    width: float = 1.0
    marks: bool = False
    """Whether points are marked, so that one alone is seen."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """Panels that belong together."""

    name: str
    title: str
    about: str
    panels: tuple[Panel, ...]
    columns: int = 2


def groups(stories: Sequence[Story]) -> list[Group]:
    """Return the names of the groups and their colours, as a legend lists them."""
    if len(stories) == 1:
        drawn = enumerate(stories[0].drawn)
        return [*((f"robot {robot}", ink) for ink, robot in drawn), (TARGET, None)]
    return [*((name, ink) for ink, name in enumerate(run_names(stories))), (TARGET, None)]


def run_names(stories: Sequence[Story]) -> list[str]:
    """Return a name for each recording, numbered where several share theirs."""
    names = [story.name for story in stories]
    return [
        name if names.count(name) == 1 else f"{name} ({names[: at + 1].count(name)})"
        for at, name in enumerate(names)
    ]


def figures(stories: Sequence[Story]) -> list[Figure]:
    """Return all that is drawn over time; what nothing was recorded for has no panel."""
    kinds = (_estimates, _agent_states, _tracking, _envelopes, _link_events)
    return [figure for draw in kinds if (figure := draw(stories)).panels]


def _estimates(stories: Sequence[Story]) -> Figure:
    return Figure(
        "estimates",
        "Estimates",
        "Each robot’s estimate of the target’s position ε_i and velocity υ_i, and the target "
        "itself (dashed). Estimates jump at the sampling times, and only there.",
        (
            *_by_joint(stories, "reference_position", "ε_i"),
            *_by_joint(stories, "reference_velocity", "υ_i"),
        ),
        _columns(stories),
    )


def _agent_states(stories: Sequence[Story]) -> Figure:
    fields = {name: of.doc for story in stories for name, of in story.agents.items()}
    means = "".join(f" {name}: {doc}." for name, doc in fields.items() if doc != name)
    return Figure(
        "agent_states",
        "What agents keep",
        f"Beside its estimate, each robot’s right after each sampling time t_k.{means}",
        tuple(_agent_panels(stories)),
        _columns(stories),
    )


def _agent_panels(stories: Sequence[Story]) -> Iterator[Panel]:
    """Yield a panel for each number of each field that agents keep."""
    fields = {name: field for story in stories for name, field in story.agents.items()}
    for name, field in fields.items():
        for number, label in enumerate(field.labels):
            curves = []
            for at, story in enumerate(stories):
                kept_there = story.agents.get(name)
                if kept_there and label in kept_there.labels and len(story.t_k):
                    curves += _by_robot(stories, at, story.t_k, kept_there.values[:, :, number])
            if curves:
                yield Panel(label, tuple(curves), number if field.by_joint else None)


def _by_robot(stories: Sequence[Story], at: int, t: Array, y: Array) -> list[Curve]:
    """Return a curve a robot of one of the recordings: y is (rows, robots)."""
    said, several = run_names(stories)[at], len(stories) > 1
    curves = []
    for row, robot in enumerate(stories[at].drawn):
        who = f"robot {robot}"
        group, ink = (said, at) if several else (who, row)
        curves.append(_curve(f"{said}, {who}" if several else who, group, t, y[:, row], ink))
    return curves


def _tracking(stories: Sequence[Story]) -> Figure:
    return Figure(
        "tracking",
        "How the robots follow",
        "The tracking errors e_i = q_i − ε_0 and ė_i = q̇_i − υ_0 of each robot’s joints.",
        (*_by_joint(stories, "position", "e_i"), *_by_joint(stories, "velocity", "ė_i")),
        _columns(stories),
    )


def _columns(stories: Sequence[Story]) -> int:
    """Return how many joints are side by side: all three of them, else two."""
    return 3 if max(story.m for story in stories) == 3 else 2


def _by_joint(stories: Sequence[Story], name: str, symbol: str) -> Iterator[Panel]:
    """Yield a panel a joint: estimates beside the target, or joints less the target."""
    quantity = name.removeprefix("reference_")
    for joint in range(max(story.m for story in stories)):
        curves: list[Curve] = []
        for at, story in enumerate(stories):
            if joint >= story.m or not len(story.t):
                continue
            y = story.vectors[name][:, :, joint]
            if name == quantity:
                y = y - story.target[quantity][:, joint, None]
            curves += _by_robot(stories, at, story.t, y)
            if name != quantity:
                line = _curve(
                    TARGET, TARGET, story.t, story.target[quantity][:, joint], None, "dash"
                )
                if not any(_same(line, other) for other in curves):
                    curves.append(line)
        if curves:
            subject = stories[0].subject
            unit = subject.rate if quantity == "velocity" else subject.unit
            called = next(s.subject.joints[joint] for s in stories if joint < s.m)
            yield Panel(f"{symbol}, {called} ({unit})", tuple(curves), joint)


def _curve(
    name: str, group: str, t: Array, y: Array, ink: int | None, dash: str = "solid"
) -> Curve:
    points = kept(y)
    return Curve(name, group, t[points], y[points], ink, dash, 1.3 if group == TARGET else 1.0)


def _same(one: Curve, other: Curve) -> bool:
    return np.array_equal(one.x, other.x) and np.array_equal(one.y, other.y, equal_nan=True)


_NORMS = (
    ("estimate", "estimates at t_k", "max ‖ε_i − ε_0‖∞", "max ‖υ_i − υ_0‖∞"),
    ("tracking", "robots", "max ‖e_i‖₂", "max ‖ė_i‖₂"),
)


def _envelopes(stories: Sequence[Story]) -> Figure:
    slope = "."
    if any(story.subject.spectral_radius for story in stories):
        slope = (
            ": the slope is that of ρ, the factor that is left of the estimation error after a "
            "sampling period, in steady state."
        )
    return Figure(
        "envelopes",
        "How fast it converges",
        "The largest errors over all robots, and what the theory has beside them" + slope,
        tuple(_envelope_panels(stories)),
    )


def _envelope_panels(stories: Sequence[Story]) -> Iterator[Panel]:
    several = len(stories) > 1
    for kind, whose, *norms in _NORMS:
        curves: list[Curve] = []
        for at, (story, said) in enumerate(zip(stories, run_names(stories), strict=True)):
            of = f"{said}: " if several else ""
            group = said if several else whose
            for number, (name, norm) in enumerate(
                zip(("position", "velocity"), norms, strict=True)
            ):
                field = f"{name}_{kind}"
                envelope = story.envelopes[field]
                if not len(envelope.t):
                    continue
                ink = at if several else number
                dash = "dot" if several and number else "solid"
                curves.append(_curve(f"{of}{norm}", group, envelope.t, envelope.largest, ink, dash))
                ends = envelope.t[[0, -1]]
                curves += [
                    Curve(
                        f"{of}{norm} ≤ {bound:.4g}, {law}",
                        group,
                        ends,
                        np.full(2, bound),
                        ink,
                        "dash",
                    )
                    for law, bound in story.subject.bounds.get(field, {}).items()
                    if 0 < bound < np.inf
                ]
            if kind == "estimate" and story.subject.spectral_radius:
                spectral_radius = story.subject.spectral_radius
                name = f"{of}slope of ρ = {spectral_radius:.4f}"
                curves += _slope(story, spectral_radius, name, group, at if several else None)
        if curves:
            units = dict.fromkeys((stories[0].subject.unit, stories[0].subject.rate))
            yield Panel(
                f"{whose} ({', '.join(units)})", tuple(curves), logarithmic=True, legend=True
            )


def _slope(
    story: Story, spectral_radius: float, name: str, group: str, ink: int | None
) -> list[Curve]:
    """Return the line that falls (or rises) by ρ each period, from the largest error on."""
    envelope = story.envelopes["position_estimate"]
    y = envelope.largest
    if not np.isfinite(y).any():
        return []
    start = int(np.nanargmax(y)) if spectral_radius < 1 else 0
    line = y[start] * spectral_radius ** np.arange(len(y) - start)
    least, most = np.nanmin(y), np.nanmax(y)
    seen = (line >= least) & (line <= most)
    rows = np.flatnonzero(seen)[[0, -1]] if seen.any() else np.empty(0, int)
    return [Curve(name, group, envelope.t[start:][rows], line[rows], ink, "dash")]


_LOOKS = {
    "altered": ("noisy, rounded or a lie", 7, 1.0),
    "duplicated": ("duplicated", 3, 5.0),
    "late": ("late", 0, 5.0),
    "lost": ("lost", 5, 5.0),
    "outage": ("in an outage", 1, 5.0),
}
"""Of each of `KINDS` its label, colour and width; what may hide another is drawn first."""


def _link_events(stories: Sequence[Story]) -> Figure:
    several = len(stories) > 1
    panels = []
    for story, said in zip(stories, run_names(stories), strict=True):
        if len(story.link_events.k):
            label = f"{said}: " if several else ""
            panels.append(_fault_panel(story, f"{label}robot ← whom it receives from"))
    return Figure(
        "link_events",
        "Link events",
        "A line a link, at the sampling times at which the link lost, delayed, duplicated or "
        "altered a sample.",
        tuple(panels),
        columns=1,
    )


def _fault_panel(story: Story, label: str) -> Panel:
    """Return a row a link, or a robot that was silent itself, and a stretch of events."""
    met = story.link_events
    links = np.unique(np.stack([met.robot, met.source]), axis=1).T
    row_of = {(int(i), int(j)): row for row, (i, j) in enumerate(links)}
    rows = tuple(_link(int(i), int(j)) for i, j in links)
    curves = []
    for kind, (name, ink, width) in _LOOKS.items():
        x: list[float] = []
        y: list[float] = []
        for i, j, first, last in _stretches(met, KINDS.index(kind)):
            row = row_of[i, j]
            x += [*story.t_k[[first - 1, last - 1]], np.nan]
            y += [row, row, np.nan]
        if x:
            at, rows_of = np.array(x), np.array(y)
            curves.append(Curve(name, name, at, rows_of, ink, width=width, marks=width > 1))
    return Panel(label, tuple(curves), legend=True, rows=rows)


def _link(robot: int, source: int) -> str:
    if robot == source:
        return f"{robot} silent"
    return f"{robot} ← {source or TARGET}"


def _stretches(met: LinkEvents, kind: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield robot, source, first and last k of each unbroken row of events of a kind."""
    those = met.kind == kind
    k, source, robot = met.k[those], met.source[those], met.robot[those]
    order = np.lexsort((k, source, robot))
    k, source, robot = k[order], source[order], robot[order]
    breaks = (np.diff(k) != 1) | (np.diff(source) != 0) | (np.diff(robot) != 0)
    starts = np.flatnonzero(np.r_[True, breaks]) if len(k) else np.empty(0, int)
    ends = np.r_[starts[1:], len(k)] - 1
    for first, last in zip(starts, ends, strict=False):
        yield int(robot[first]), int(source[first]), int(k[first]), int(k[last])


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
