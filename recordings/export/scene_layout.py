"""A layout for Foxglove: arms, errors and link events of a scene, each in its panel from the start.

It is what Foxglove imports and exports as a layout: the configuration of each panel by its name,
which begins with its type, and a tree that divides the window in two, again and again.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from nrs_cosim.bus.keys import node_name
from nrs_cosim.recordings.export.scene import ERRORS, EVENTS, SCENE
from nrs_cosim.recordings.robots.placed import COLOURS, WORLD

_MOST = 24
"""Curves in a plot."""


def scene_layout(numbers: Sequence[int], reach: float, *, events: bool) -> dict[str, Any]:
    """Return the layout of a scene of some robots, whose farthest is so far from the origin, m."""
    panels: dict[str, Mapping[str, Any]] = {
        "3D!robots": {
            "cameraState": {
                "distance": 2 * reach,
                "perspective": True,
                "phi": 60.0,
                "thetaOffset": 90.0,
                "target": [0.0, 0.0, 0.0],
                "targetOffset": [0.0, reach / 2, 0.0],
                "targetOrientation": [0.0, 0.0, 0.0, 1.0],
                "fovy": 45.0,
                "near": 0.1,
                "far": max(5000.0, 10 * reach),
            },
            "followTf": WORLD,
            "topics": {SCENE: {"visible": True}},
        },
        "Plot!tracking": _plot("How far robots are from the target", "position_tracking", numbers),
        "Plot!estimates": _plot("How far estimates are off", "position_estimate", numbers),
        "RosOut!events": {"topicToRender": EVENTS, "minLogLevel": 1, "searchTerms": []},
    }
    plots = _divided("column", "Plot!tracking", "Plot!estimates")
    right = _divided("column", plots, "RosOut!events", 70) if events else plots
    if not events:
        del panels["RosOut!events"]
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _divided("row", "3D!robots", right, 55),
    }


def _plot(title: str, field: str, numbers: Sequence[int]) -> Mapping[str, Any]:
    shown = numbers[:: -(-len(numbers) // _MOST)]
    return {
        "foxglovePanelTitle": title,
        "paths": [
            {
                "value": f"{ERRORS}.{field}[{number - 1}]",
                "enabled": True,
                "timestampMethod": "receiveTime",
                "label": node_name(number).replace("_", " "),
                "color": _hexadecimal(COLOURS[number % len(COLOURS)]),
            }
            for number in shown
        ],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "isSynced": True,
        "xAxisVal": "timestamp",
    }


def _hexadecimal(colour: Sequence[float]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour)


def _divided(direction: str, first: Any, second: Any, percentage: float = 50) -> dict[str, Any]:
    return {
        "direction": direction,
        "first": first,
        "second": second,
        "splitPercentage": percentage,
    }
