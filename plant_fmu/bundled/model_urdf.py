"""A bundled model has a URDF of its own: its joints, and lengths from its parameters.

The world has x ahead and z up. An arm moves in the plane of x and z, by its first angle from x
towards z and by every other one from the link before; a point moves along x, y and z. Masses are
left out: the dynamics are the model's.
"""

from collections.abc import Mapping, Sequence
from math import pi
from typing import Any

import numpy as np
from lxml import etree

from nrs_cosim.plant_fmu.bundled.declaration import declaration

_TOWARDS_Z = "0 -1 0"
"""About it x turns towards z."""
_ALONG = ("1 0 0", "0 1 0", "0 0 1")
_TIP = "tip"
"""The link, without looks, at the end of an arm."""
_POINT = 0.15
"""m: the radius of what has no lengths."""
_SLENDER = 0.03
"""The radius of an arm's links over the longest one."""


def model_urdf(name: str, parameters: Mapping[str, Any], joints: Sequence[str]) -> str:
    """Return the URDF of a bundled model with parameters, its joints by their names.

    Nothing where its joints turn, and nothing says how long its links are.
    """
    model, m = declaration(name), len(joints)
    robot = etree.Element("robot", name=name)
    etree.SubElement(robot, "link", name="base")
    if model.variable("q").unit == "m":
        for at, joint in enumerate(joints):
            _link(robot, at, _POINT * (at == m - 1))
            _joint(robot, joint, "prismatic", at, _ALONG[at % 3])
        return _text(robot)
    values = {v.name: v.start for v in model.of_kind("parameter")} | dict(parameters)
    by_link = [f"r{at + 1}" for at in range(m)]
    if "r" in values:
        lengths = np.broadcast_to(np.asarray(values["r"], float).ravel(), m).tolist()
    elif values.keys() >= {*by_link}:
        lengths = [float(values[link]) for link in by_link]
    else:
        return ""
    radius = _SLENDER * max(lengths)
    for at, (joint, length) in enumerate(zip(joints, lengths, strict=True)):
        link = _link(robot, at, 1.5 * radius)
        _shape(link, "cylinder", f"{length / 2!r} 0 0", radius=radius, length=length)
        link[-1][0].set("rpy", f"0 {pi / 2!r} 0")
        _joint(robot, joint, "continuous", at, _TOWARDS_Z, lengths[at - 1] if at else 0.0)
    etree.SubElement(robot, "link", name=_TIP)
    _joint(robot, _TIP, "fixed", m, _TOWARDS_Z, lengths[-1])
    robot[-1].find("child").set("link", _TIP)
    return _text(robot)


def _link(robot: Any, at: int, ball: float) -> Any:
    link = etree.SubElement(robot, "link", name=f"link_{at + 1}")
    if ball:
        _shape(link, "sphere", "0 0 0", radius=ball)
    return link


def _shape(link: Any, kind: str, xyz: str, **size: float) -> None:
    visual = etree.SubElement(link, "visual")
    etree.SubElement(visual, "origin", xyz=xyz)
    geometry = etree.SubElement(visual, "geometry")
    etree.SubElement(geometry, kind, {key: repr(value) for key, value in size.items()})


def _joint(robot: Any, name: str, kind: str, at: int, axis: str, ahead: float = 0.0) -> None:
    joint = etree.SubElement(robot, "joint", name=name, type=kind)
    etree.SubElement(joint, "origin", xyz=f"{ahead!r} 0 0")
    etree.SubElement(joint, "parent", link=f"link_{at}" if at else "base")
    etree.SubElement(joint, "child", link=f"link_{at + 1}")
    etree.SubElement(joint, "axis", xyz=axis)
    if kind == "prismatic":
        etree.SubElement(joint, "limit", lower="-1e6", upper="1e6", effort="1e6", velocity="1e6")


def _text(robot: Any) -> str:
    etree.indent(robot)
    text: str = etree.tostring(robot, encoding="unicode")
    return text
