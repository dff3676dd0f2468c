"""What is kept of a URDF in its FMU: links, joints, and what they look like.

Nothing else is: no plug-ins of simulators, no comments, and of meshes those alone that are of a ROS
package, for any other name is that of a file of whoever made the robot. A joint is of the kind that
the dynamics have it.
"""

from collections.abc import Mapping, Sequence

from lxml import etree

from nrs_cosim.plant_fmu.bundled.urdf_robot import UrdfJoint
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


def kept_text(root: Element, name: str, joints: Sequence[UrdfJoint]) -> bytes:
    """Return the URDF of a robot of that name, with these joints, as a file of UTF-8."""
    kept = etree.Element("robot", name=name)
    _keep(root, kept)
    kinds = {joint.name: joint.kind for joint in joints}
    for joint in kept.findall("joint"):
        joint.set("type", kinds.get(joint.get("name"), joint.get("type")))
        if joint.get("type") == "fixed":
            for mimic in joint.findall("mimic"):
                joint.remove(mimic)
    etree.indent(kept)
    text: bytes = etree.tostring(kept, xml_declaration=True, encoding="UTF-8")
    return text


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
