"""What is drawn of recordings: figures of panels of curves, like the paper's, for any painter.

A curve belongs to a group, which is shown and hidden as one and has one colour: a robot where one
recording is drawn, a recording where several lie over one another. Of more robots than can be told
apart there is one group, and bands: how the robots are spread at each time.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from nrs_cosim.recordings.report.curves import TARGET, Array, Band, Curve, Figure, Panel, kept
from nrs_cosim.recordings.report.data import Story
from nrs_cosim.recordings.report.envelope_figure import envelope_figure
from nrs_cosim.recordings.report.link_figure import link_figure
from nrs_cosim.recordings.units import on_axis, rate_of, unit_over

Group = tuple[str, int | None]
"""Its name and its colour."""
ALL = "all robots"
INKS = 8
"""Colours; robots that share one have dashes of their own."""
_ROBOT_DASHES = ("solid", "dash", "dot")
_RUN_LOOKS = (("solid", 2.4), ("dash", 1.2), ("dot", 1.6), ("dashdot", 1.2))
"""Of recordings over one another: the first is seen behind the others."""
_SPREADS = " Of many robots: from the least to the largest (pale), the middle half, the median."


def groups(stories: Sequence[Story]) -> list[Group]:
    """Return the names of the groups and their colours, as a legend lists them."""
    names = dict.fromkeys(
        name for at in range(len(stories)) for name in groups_of_robots(stories, at)
    )
    return [*((name, ink) for ink, name in enumerate(names)), (TARGET, None)]


def groups_of_robots(stories: Sequence[Story], at: int) -> list[str]:
    """Return the group of each robot that is drawn of one of the recordings."""
    story = stories[at]
    if len(stories) > 1:
        return [run_names(stories)[at]] * len(story.drawn)
    return [ALL if story.spreads else f"robot {robot}" for robot in story.drawn.tolist()]


def run_names(stories: Sequence[Story]) -> list[str]:
    """Return a name for each recording: its own, or its file's, or numbered where both recur."""
    names = [story.name for story in stories]
    files = [story.file for story in stories]
    if len({*names}) < len(names):
        names = [a if names.count(a) == 1 else b for a, b in zip(names, files, strict=True)]
    return [
        name if names.count(name) == 1 else f"{name} ({names[: at + 1].count(name)})"
        for at, name in enumerate(names)
    ]


def figures(stories: Sequence[Story]) -> list[Figure]:
    """Return all that is drawn over time; what nothing was recorded for has no panel."""
    names = run_names(stories)
    drawn = (
        _estimates(stories),
        _agent_states(stories),
        _tracking(stories),
        envelope_figure(stories, names),
        link_figure(stories, names),
    )
    return [figure for figure in drawn if figure.panels]


def _estimates(stories: Sequence[Story]) -> Figure:
    return Figure(
        "estimates",
        "Estimates",
        "Each robot’s estimate of the target’s position ε_i and velocity υ_i, and the target "
        "itself (dashed). Estimates jump at the sampling times, and only there."
        + _SPREADS
        * any(story.spreads for story in stories),
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
                joint = number if field.by_joint else None
                called = "" if joint is None else stories[0].subject.joints[joint]
                yield Panel(label, tuple(curves), joint, joint_name=called)


def _by_robot(stories: Sequence[Story], at: int, t: Array, y: Array) -> list[Curve]:
    """Return a curve a robot of one of the recordings: y is (rows, robots)."""
    said, several = run_names(stories)[at], len(stories) > 1
    curves = []
    of_groups = groups_of_robots(stories, at)
    for row, (robot, group) in enumerate(zip(stories[at].drawn.tolist(), of_groups, strict=True)):
        who = f"robot {robot}"
        ink, dash, width = row, _ROBOT_DASHES[row // INKS % len(_ROBOT_DASHES)], 1.0
        if several:
            ink, (dash, width) = at, _RUN_LOOKS[at % len(_RUN_LOOKS)]
        elif group == ALL:
            ink, dash = 0, "solid"
        points = kept(y[:, row], last=stories[at].close(t))
        name = f"{said}, {who}" if several else who
        curves.append(Curve(name, group, t[points], y[points, row], ink, dash, width))
    return curves


def _spread(stories: Sequence[Story], at: int, spread: Array) -> tuple[list[Band], Curve]:
    """Return the bands and the median of all robots of a recording: spread is (rows, 5)."""
    t, (group, *_) = stories[at].t, groups_of_robots(stories, at)
    least, low, median, high, most = spread.T
    close = stories[at].close(t)
    bands = []
    for name, below, above, opacity in (
        ("least to largest", least, most, 0.16),
        ("middle half", low, high, 0.32),
    ):
        points = np.union1d(kept(below, last=close), kept(above, last=close))
        bands.append(Band(name, group, t[points], below[points], above[points], at, opacity))
    points = kept(median, last=close)
    dash, width = _RUN_LOOKS[at % len(_RUN_LOOKS)] if len(stories) > 1 else ("solid", 1.2)
    return bands, Curve("median", group, t[points], median[points], at, dash, width)


def _tracking(stories: Sequence[Story]) -> Figure:
    return Figure(
        "tracking",
        "How the robots follow",
        "The tracking errors e_i = q_i − ε_0 and ė_i = q̇_i − υ_0 of each robot’s joints."
        + _SPREADS * any(story.spreads for story in stories),
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
        bands: list[Band] = []
        for at, story in enumerate(stories):
            if joint >= story.m or not len(story.t):
                continue
            target = story.target[quantity][:, joint]
            off = target[:, None] if name == quantity else 0.0
            if name in story.spreads:
                of_all, median = _spread(stories, at, story.spreads[name][:, joint] - off)
                bands += of_all
                curves.append(median)
            else:
                curves += _by_robot(stories, at, story.t, story.vectors[name][:, :, joint] - off)
            if name != quantity:
                points = kept(target, last=story.close(story.t))
                line = Curve(TARGET, TARGET, story.t[points], target[points], None, "dash", 1.3)
                if not any(_same(line, other) for other in curves):
                    curves.append(line)
        if curves:
            subjects = [story.subject for story in stories if joint < story.m]
            unit = unit_over([subject.units[joint] for subject in subjects])
            called = subjects[0].joints[joint]
            of = rate_of(unit) if quantity == "velocity" else unit
            label = on_axis(f"{symbol}, {called}", of)
            yield Panel(label, tuple(curves), joint, bands=tuple(bands), joint_name=called)


def _same(one: Curve, other: Curve) -> bool:
    return np.array_equal(one.x, other.x) and np.array_equal(one.y, other.y, equal_nan=True)
