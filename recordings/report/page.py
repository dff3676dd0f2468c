"""The page: one file that needs nothing else, no network and no server.

    skeleton, style and script    as they stand in `web/`
    what is drawn                 JSON, with arrays in base64
    plotly.js                     gzip in base64, inflated by the browser

The page's own policy forbids it to load anything; of a page that is served while its run goes on,
anything but its own server's.
"""

import gzip
import json
import re
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import MissingExtraError
from nrs_cosim.recordings.report import network, text
from nrs_cosim.recordings.report.curves import Band, Curve, Figure, Label, Panel
from nrs_cosim.recordings.report.data import Story
from nrs_cosim.recordings.report.figures import figures, groups, groups_of_robots, run_names
from nrs_cosim.recordings.report.stability import stability


class Arrays:
    """The arrays of a page by number; `encoded` is what the page decodes them from."""

    def __init__(self) -> None:
        self.encoded: list[dict[str, str]] = []
        self._known: dict[tuple[str, bytes], int] = {}

    def put(self, array: NDArray[Any]) -> int:
        """Return the number of an array of floats, of any shape; doubles are kept bit by bit."""
        kind = "f4" if array.dtype == np.float32 else "f8"
        data = np.ascontiguousarray(array, f"<{kind}").tobytes()
        if (kind, data) not in self._known:
            self._known[kind, data] = len(self.encoded)
            self.encoded.append({"kind": kind, "data": b64encode(data).decode("ascii")})
        return self._known[kind, data]


def page(stories: Sequence[Story]) -> str:
    """Return the page of some recordings."""
    return _filled(json.dumps(page_data(stories), allow_nan=False), "'none'")


@cache
def live_page() -> str:
    """Return the page that asks its server for what it shows, again and again."""
    return _filled("null", "'self'")


def page_data(stories: Sequence[Story], *, live: bool = False) -> dict[str, Any]:
    """Return all that a page shows, for JSON, of runs that are over, or that may go on."""
    arrays, names = Arrays(), run_names(stories)
    return {
        "live": live,
        "runs": [
            {
                "name": name,
                "status": story.status,
                "damage": list(story.damage),
                "file": story.file,
                "lead": text.lead(story, live=live),
                "measured": list(text.measured(story)),
                "conditions": list(story.subject.conditions),
                "spectral_radius": story.subject.spectral_radius,
                "gains": stability(story.subject.gains),
                "saturated": text.saturated(story),
                "counted": text.counted(story),
                "particulars": text.particulars(story),
                "network": network.drawn(story),
                "phases": len(story.subject.topologies.exchanges),
                "turns": network.turns(story),
                "plants": list(story.subject.plants),
                "robots": story.drawn.tolist(),
                "groups": groups_of_robots(stories, at),
                "ticks": story.ticks,
                "planned": story.planned,
                "seconds": story.seconds,
                "planned_seconds": story.subject.times.t(story.planned) / 1e9,
                "unit": story.subject.unit,
                "motion": motion(story, arrays) if len(story.t) else None,
            }
            for at, (story, name) in enumerate(zip(stories, names, strict=True))
        ],
        "differences": text.differences(stories, names),
        "groups": [{"name": name, "ink": ink} for name, ink in groups(stories)],
        "figures": [_plain(figure, arrays) for figure in figures(stories)],
        "arrays": arrays.encoded,
    }


def _plain(drawn: Any, arrays: Arrays) -> Any:
    """Return a figure, or a part of one, as JSON has it."""
    match drawn:
        case Figure() | Panel() | Curve() | Band() | Label():
            return {of.name: _plain(getattr(drawn, of.name), arrays) for of in fields(drawn)}
        case tuple():
            return [_plain(part, arrays) for part in drawn]
        case np.ndarray():
            return arrays.put(drawn)
    return drawn


def _filled(data: str, connect: str) -> str:
    parts = {
        "connect": connect,
        "style": _part("page.css"),
        "script": "\n".join(map(_part, ("page.js", "plots.js", "motion.js"))),
        "data": data.replace("<", "\\u003c"),
        "plotly": _plotly(),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], _part("page.html"))


def _part(name: str) -> str:
    return files("nrs_cosim.recordings.report").joinpath("web", name).read_text("utf-8")


def expect_plotly() -> None:
    """Raise MissingExtraError without plotly."""
    if find_spec("plotly") is None:
        raise MissingExtraError("a page needs plotly", "report")


def _plotly() -> str:
    """Return plotly.js, gzip in base64."""
    expect_plotly()
    from plotly.offline import get_plotlyjs  # noqa: PLC0415, an extra that may be missing

    return b64encode(gzip.compress(get_plotlyjs().encode(), 9, mtime=0)).decode("ascii")


MOST_FRAMES = 900
MOST_NUMBERS = 2**21
"""Of all frames' points: a robot of many links moves in fewer of them."""


def motion(story: Story, arrays: Arrays) -> dict[str, Any]:
    """Return the frames of a story for the page, in single precision.

    Joint space is (frames, robots, m); a robot's points are (frames, points, 2), and so are those
    of the target, which is drawn as the first robot that is no mere point.
    """
    drawn = [skeleton for skeleton in story.skeletons if skeleton.parents]
    points = 2 * sum(len(skeleton.parents) + 1 for skeleton in drawn)
    most = min(len(story.t), MOST_FRAMES, max(MOST_NUMBERS // max(points, 1), 2))
    rows = np.unique(np.linspace(0, len(story.t) - 1, most).astype(np.intp))
    q = story.vectors["position"][rows]
    target = story.target["position"][rows]

    def put(values: NDArray[np.float64]) -> int:
        return arrays.put(values.astype(np.float32))

    return {
        "t": arrays.put(story.t[rows]),
        "q": put(q),
        "estimates": put(story.vectors["reference_position"][rows]),
        "target": put(target),
        "parents": [list(skeleton.parents) for skeleton in story.skeletons],
        "points": [
            put(skeleton.points(q[:, at])) if skeleton.parents else None
            for at, skeleton in enumerate(story.skeletons)
        ],
        "target_parents": list(drawn[0].parents) if drawn else [],
        "target_points": put(drawn[0].points(target)) if drawn else None,
        "known": all(skeleton.known for skeleton in story.skeletons),
    }
