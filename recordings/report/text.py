"""A run in words and numbers: what a reader of the report must know before any figure."""

import json
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from nrs_cosim.bus.plurals import count_of, numbered
from nrs_cosim.recordings.measurement import saturation_in_words
from nrs_cosim.recordings.metadata import LINKS, MEASURED, SAMPLES, SPENT
from nrs_cosim.recordings.report.data import MOST_DRAWN, Story

_MEASURED = {
    "position_estimate": ("estimates of position", "sup ‖ε_i − ε_0‖∞", False),
    "velocity_estimate": ("estimates of velocity", "sup ‖υ_i − υ_0‖∞", True),
    "position_tracking": ("the robots’ position", "sup ‖e_i‖₂", False),
    "velocity_tracking": ("the robots’ velocity", "sup ‖ė_i‖₂", True),
}
_STATUS = {
    "completed": "The run completed.",
    "unfinished": "The recording is unfinished: its writer was killed, or is still at work.",
}

_GOES_ON = "The run goes on."


def lead(story: Story, *, live: bool = False) -> list[str]:
    """Return sentences on a run: who, what, how long, and how it ended."""
    subject, topology = story.subject, story.subject.topology
    pinned = topology.pinned.tolist()
    among = int((topology.source > 0).sum())
    robots, joints = count_of(story.n, "robot"), count_of(story.m, "joint")
    fmus = " and ".join(dict.fromkeys(plant["FMU"] for plant in subject.plants))
    who = numbered("robot", pinned, 8) if pinned else "nobody"
    sentences = [
        f"{robots} with {joints} each{f' ({fmus})' * bool(fmus)} follow a target, from which {who} "
        f"receive{'s' * (len(pinned) == 1)}; their estimates of it spread over "
        f"{count_of(among, 'link')} among the robots.",
        *([subject.phases] if subject.phases else []),
        f"They exchange samples {subject.pace} and estimate by {subject.estimator}.",
        f"{story.ticks:,} of {story.planned:,} sampling times were recorded, {story.seconds:g} s.",
        _GOES_ON
        if live and story.status == "unfinished"
        else _STATUS.get(story.status, f"The run {story.status}: {story.reason}."),
    ]
    if liars := subject.byzantine:
        lie = f"{numbered('robot', liars, 8)} lie{'s' * (len(liars) == 1)}"
        sentences.append(f"{lie[0].upper()}{lie[1:]}: errors and envelopes are of honest robots.")
    if subject.links:
        sentences.append(f"On the links, {subject.links}.")
    if story.saturation:
        said = saturation_in_words(story.saturation, story.subject.joints)
        sentences.append(f"{said[0].upper()}{said[1:]}.")
    if len(story.drawn) < story.n:
        sentences.append(
            f"{len(story.drawn)} of the robots are drawn in motion; bands and envelopes are of all."
        )
    return sentences


def measured(story: Story) -> Iterator[dict[str, Any]]:
    """Yield each steady-state error of the last fifth, with the theory's bounds by name."""
    for field, (what, norm, is_rate) in _MEASURED.items():
        value = getattr(story.steady, field)
        if value is None or not story.ticks:
            continue
        yield {
            "what": what,
            "norm": norm,
            "unit": story.subject.rate if is_rate else story.subject.unit,
            "value": value,
            "status": story.verdicts.get(field, "unproven"),
            "bounds": {
                law: bound
                for law, bound in story.subject.bounds.get(field, {}).items()
                if np.isfinite(bound)
            },
        }


def saturated(story: Story) -> list[list[str]]:
    """Return a row for each robot with a torque at its limit: its number, and parts by joint.

    The first row is that of names; there is none where no torque has a limit.
    """
    rows = sorted(
        ((robot, at) for robot, at in story.saturation.items() if at.any()),
        key=lambda row: -row[1].max(),
    )
    if not rows:
        return []
    parts = [[str(robot), *(f"{100 * part:.3g} %" for part in at)] for robot, at in rows]
    return [["robot", *story.subject.joints], *parts[:MOST_DRAWN]]


def counted(story: Story) -> dict[str, str]:
    """Return how many messages there are of each kind, and what the run said at its end."""
    counts = {
        _spelt(kind.rpartition(".")[2]) + "s": f"{count:,}"
        for kind, count in sorted(story.counts.items())
    }
    return counts | {
        f"{name} (s)" if key == SPENT else name: said
        for key, text in story.ending.items()
        if key not in {SAMPLES, MEASURED, LINKS}  # counted with the target's; said above
        for name, said in _flat(key, text)
    }


def _spelt(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()


def particulars(story: Story) -> dict[str, str]:
    """Return what identifies a run."""
    return {
        "digest": story.digest or "none: this is a part of the run",
        "seed": str(story.seed),
        **({"no theory": story.subject.no_theory} if story.subject.no_theory else {}),
        **story.versions,
    }


def _flat(key: str, text: str) -> Iterator[tuple[str, str]]:
    """Yield names and values of what an end says: the leaves of JSON, or the text itself."""
    try:
        value = json.loads(text)
    except ValueError:
        value = text
    yield from _leaves(key, value)


def _leaves(key: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _leaves(f"{key}, {name}", inner)
    else:
        yield key, f"{value:.4g}" if isinstance(value, float) else str(value)


def differences(stories: Sequence[Story], names: Sequence[str]) -> list[dict[str, str]]:
    """Return a row for each key of the scenarios that is not the same in all of some runs."""
    settings = [story.subject.settings for story in stories]
    keys = dict.fromkeys(key for one in settings for key in one)
    return [
        {"key": key, **{name: one.get(key, "–") for name, one in zip(names, settings, strict=True)}}
        for key in keys
        if len({one.get(key) for one in settings}) > 1
    ]
