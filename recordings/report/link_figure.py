"""What links did to samples, drawn: a row a link, a stretch of events on it."""

from collections.abc import Iterator, Sequence

import numpy as np

from nrs_cosim.recordings.link_counts import KINDS
from nrs_cosim.recordings.report.curves import TARGET, Curve, Figure, Panel
from nrs_cosim.recordings.report.data import LinkEvents, Story

_LOOKS = {
    "altered": ("noisy, rounded or a lie", 7, 1.0),
    "duplicated": ("duplicated", 3, 5.0),
    "late": ("late", 0, 5.0),
    "lost": ("lost", 5, 5.0),
    "outage": ("in an outage", 1, 5.0),
}
"""Of each of `KINDS` its label, colour and width; what may hide another is drawn first."""


def link_figure(stories: Sequence[Story], names: Sequence[str]) -> Figure:
    """Return the figure of link events; recordings are called by names."""
    several = len(stories) > 1
    panels = []
    for story, said in zip(stories, names, strict=True):
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
