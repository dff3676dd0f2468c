"""What is kept of a URDF in its FMU: links, joints, and what they look like.

Nothing else is: no plug-ins of simulators, no comments, and of meshes those alone that are of a ROS
package, for any other name is that of a file of whoever made the robot. Joints are as the dynamics
have them: of that kind, following one that moves by itself, or locked. A number that is none would
keep the robot from being drawn: it is left out, and of a look the whole look, with a warning.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from math import inf

import numpy as np
from lxml import etree

from nrs_cosim.plant_fmu.bundled.urdf_couplings import Couplings, couplings
from nrs_cosim.plant_fmu.bundled.urdf_elements import LARGEST, wrong_numbers
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import Following, UrdfJoint, UrdfRobot
from nrs_cosim.plant_fmu.bundled.urdf_xml import Element

PACKAGE = "package://"
_SHAPE = {"origin": ("xyz", "rpy"), "geometry": (), "material": ("name",)}
_KEPT: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "robot": {"material": ("name",), "link": ("name",), "joint": ("name", "type")},
    "link": {"inertial": (), "visual": ("name",), "collision": ("name",)},
    "inertial": {
        "origin": ("xyz", "rpy"),
        "mass": ("value",),
        "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    },
    "visual": _SHAPE,
    "collision": _SHAPE,
    "geometry": {
        "box": ("size",),
        "cylinder": ("radius", "length"),
        "sphere": ("radius",),
        "mesh": ("filename", "scale"),
    },
    "material": {"color": ("rgba",)},
    "joint": {
        "origin": ("xyz", "rpy"),
        "parent": ("link",),
        "child": ("link",),
        "axis": ("xyz",),
        "limit": ("lower", "upper", "effort", "velocity"),
        "dynamics": ("damping", "friction"),
        "mimic": ("joint", "multiplier", "offset"),
    },
}
"""Of each element, the elements in it, with their attributes."""


_WORDS = {"name", "type", "filename", "link", "joint"}
_COUNTS = {"xyz": 3, "rpy": 3, "size": 3, "scale": 3, "rgba": 4}
"""Of other attributes than words; the others are one number."""
_LENGTHS = {"size", "radius", "length"}
_ENDLESS = {"lower": f"-{LARGEST:g}", "upper": f"{LARGEST:g}"}
_INFINITE = {"inf", "infinity"}
"""A limit that is none; without the attribute it would be one, 0."""


def kept_text(root: Element, robot: UrdfRobot, warnings: Remarks) -> bytes:
    """Return the URDF of a robot that was read from a root, as a file of UTF-8."""
    kept = etree.Element("robot", name=robot.name)
    coupled = couplings(robot.joints)
    leads = dict(
        zip((joint.name for joint in coupled.moving), _leaders(robot, coupled), strict=True)
    )
    links, joints = {link.name for link in robot.links}, {j.name: j for j in robot.joints}
    for element in root.iterchildren(*_KEPT["robot"]):
        name = str(element.get("name", "")).strip()
        if (name in links) if element.tag == "link" else (name in joints or element.tag != "joint"):
            _keep(element, kept, partial(warnings.add, what=element.tag, name=name))
    for element in kept.findall("joint"):
        name = element.get("name")
        _as_it_moves(element, joints[name], leads.get(name))
    etree.indent(kept)
    text: bytes = etree.tostring(kept, xml_declaration=True, encoding="UTF-8")
    return text


def _leaders(robot: UrdfRobot, coupled: Couplings) -> Iterator[Following]:
    """Yield of each joint that moves which one that moves by itself it follows, and how."""
    for row, offset in zip(coupled.G, coupled.offset, strict=True):
        k = int(np.abs(row).argmax())
        yield Following(robot.axes[k].name, float(row[k]), float(offset))


def _as_it_moves(element: Element, joint: UrdfJoint, leader: Following | None) -> None:
    """Say of a joint what the dynamics have: its kind, whom it follows, where it is locked."""
    locked = joint.kind == "fixed" != element.get("type")
    element.set("type", joint.kind)
    for mimic in element.findall("mimic"):
        element.remove(mimic)
    if joint.mimic is not None and leader is not None:
        multiplier, offset = map(repr, leader[1:])
        etree.SubElement(
            element, "mimic", joint=leader.leader, multiplier=multiplier, offset=offset
        )
    if locked:
        for origin in element.findall("origin"):
            element.remove(origin)
        xyz, rpy = (" ".join(map(repr, three)) for three in (joint.origin.xyz, joint.origin.rpy))
        etree.SubElement(element, "origin", xyz=xyz, rpy=rpy)


def _keep(child: Element, into: Element, warn: Callable[[str], None]) -> None:
    """Put an element that is kept, with what of it is kept, into another one."""
    if child.tag == "mesh" and not child.get("filename", "").strip().startswith(PACKAGE):
        return
    is_look = child.tag in {"visual", "collision"}
    if is_look and (wrong := _wrong_look(child)):
        warn(f"<{child.tag}> {wrong}; this look is left out")
        return
    attributes = {}
    for key in _KEPT[into.tag][child.tag]:
        text = child.get(key, "").strip()
        wrong = "" if key in _WORDS or not text else wrong_numbers(text, _COUNTS.get(key, 1))
        if wrong and text.lstrip("+-").lower() not in _INFINITE:
            warn(f"<{child.tag}> {key}: {wrong}; it is left out")
        if text := _ENDLESS.get(key, "") if wrong else text:
            attributes[key] = text
    kept = etree.SubElement(into, child.tag, attributes)
    known = _KEPT.get(child.tag)
    for part in child.iterchildren(*known) if known else ():
        _keep(part, kept, warn)
    if is_look and kept.find("geometry/*") is None:
        into.remove(kept)


def _wrong_look(look: Element) -> str:
    """Return what is wrong of where a look is or of what shape; empty where nothing is."""
    for part in [*look.findall("origin"), *look.findall("geometry/*")]:
        for key in _SHAPE.get(part.tag, _KEPT["geometry"].get(part.tag, ())):
            text = part.get(key)
            if key in _WORDS or (text is None and key not in _LENGTHS):
                continue
            least = 0.0 if key in _LENGTHS else -inf
            if wrong := wrong_numbers(text or "", _COUNTS.get(key, 1), least):
                return f"<{part.tag}> {key}: {wrong}"
    return ""
