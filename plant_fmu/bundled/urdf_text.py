"""What is kept of a URDF in its FMU: links, joints, and what they look like.

Nothing else is: no plug-ins of simulators, no comments, and of meshes those alone that are of a ROS
package, for any other name is that of a file of whoever made the robot. Joints are as the dynamics
have them: of that kind, following one that moves by itself, or locked.
"""

from collections.abc import Iterator, Mapping

import numpy as np
from lxml import etree

from nrs_cosim.plant_fmu.bundled.urdf_couplings import Couplings, couplings
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


def kept_text(root: Element, robot: UrdfRobot) -> bytes:
    """Return the URDF of a robot that was read from a root, as a file of UTF-8."""
    kept = etree.Element("robot", name=robot.name)
    _keep(root, kept)
    coupled = couplings(robot.joints)
    leads = dict(
        zip((joint.name for joint in coupled.moving), _leaders(robot, coupled), strict=True)
    )
    links, joints = {link.name for link in robot.links}, {j.name: j for j in robot.joints}
    for element in [*kept.findall("link"), *kept.findall("joint")]:
        name = element.get("name")
        if name not in (links if element.tag == "link" else joints):
            kept.remove(element)
        elif element.tag == "joint":
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


def _keep(one: Element, into: Element) -> None:
    """Put the children of an element that are kept into another one."""
    known = _KEPT.get(into.tag, {})
    for child in one.iterchildren(*known) if known else ():
        if child.tag == "mesh" and not child.get("filename", "").strip().startswith(PACKAGE):
            continue
        attributes = {key: child.get(key).strip() for key in known[child.tag] if child.get(key)}
        _keep(child, etree.SubElement(into, child.tag, attributes))
        if child.tag in {"visual", "collision"} and into[-1].find("geometry/*") is None:
            into.remove(into[-1])
