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
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from typing import Any

from nrs_cosim.bus.errors import MissingExtraError
from nrs_cosim.recordings.report import network, text
from nrs_cosim.recordings.report.arrays import Arrays
from nrs_cosim.recordings.report.data import Story
from nrs_cosim.recordings.report.figures import Curve, Figure, Panel, figures, groups, run_names
from nrs_cosim.recordings.report.motion import motion


def page(stories: Sequence[Story]) -> str:
    """Return the page of some recordings."""
    return _filled(json.dumps(page_data(stories), allow_nan=False), "'none'")


@cache
def live_page() -> str:
    """Return the page that asks its server for what it shows, again and again."""
    return _filled("null", "'self'")


def page_data(stories: Sequence[Story]) -> dict[str, Any]:
    """Return all that a page shows, for JSON."""
    arrays = Arrays()
    return {
        "runs": [
            {
                "name": name,
                "status": story.status,
                "damage": list(story.damage),
                "lead": text.lead(story),
                "measured": list(text.measured(story)),
                "conditions": text.condition_rows(story),
                "spectral_radius": story.subject.spectral_radius,
                "counted": text.counted(story),
                "particulars": text.particulars(story),
                "network": network.drawn(story),
                "robots": story.drawn.tolist(),
                "unit": story.subject.unit,
                "motion": motion(story, arrays) if len(story.t) else None,
            }
            for story, name in zip(stories, run_names(stories), strict=True)
        ],
        "groups": [{"name": name, "ink": ink} for name, ink in groups(stories)],
        "figures": [_figure(figure, arrays) for figure in figures(stories)],
        "arrays": arrays.encoded,
    }


def _figure(figure: Figure, arrays: Arrays) -> dict[str, Any]:
    return {
        "name": figure.name,
        "title": figure.title,
        "about": figure.about,
        "columns": figure.columns,
        "panels": [_panel(panel, arrays) for panel in figure.panels],
    }


def _panel(panel: Panel, arrays: Arrays) -> dict[str, Any]:
    return {
        "label": panel.label,
        "joint": panel.joint,
        "logarithmic": panel.logarithmic,
        "legend": panel.legend,
        "rows": list(panel.rows),
        "curves": [_curve(curve, arrays) for curve in panel.curves],
    }


def _curve(curve: Curve, arrays: Arrays) -> dict[str, Any]:
    return {
        "name": curve.name,
        "group": curve.group,
        "ink": curve.ink,
        "dash": curve.dash,
        "width": curve.width,
        "marks": curve.marks,
        "x": arrays.put(curve.x),
        "y": arrays.put(curve.y),
    }


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
