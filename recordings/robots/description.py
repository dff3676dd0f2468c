"""A robot as its URDF describes it to who draws it: the tree of its links, and what they look like.

A recording has the URDF, so it may be anybody's: what is no tree of links is refused by name, and
no mesh is looked for. A link of which only meshes are known, or nothing, looks like rods from its
origin to the joints that it carries; one that is welded on and carries none is a mere frame.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import atan2, hypot, isfinite
from typing import Any

from lxml import etree

from nrs_cosim.bus.text import quoted
from nrs_cosim.recordings.errors import UnreadableError

Three = tuple[float, float, float]
TURNING = ("revolute", "continuous")
MOVING = (*TURNING, "prismatic")
ZERO: Three = (0.0, 0.0, 0.0)
_ALONG_X: Three = (1.0, 0.0, 0.0)
_SIZES = {"box": {"size": 3}, "cylinder": {"radius": 1, "length": 1}, "sphere": {"radius": 1}}
_STUB: Three = (0.0, 0.0, 0.05)
"""m: a link that carries no joint."""
_SLENDER, _THINNEST = 0.04, 0.01
"""A rod's radius over its length, and the least that it is, m."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A box (x, y, z), a cylinder (radius, length) along z, or a sphere (radius), in m."""

    kind: str
    size: tuple[float, ...]
    xyz: Three = ZERO
    """Where its middle is in the frame of its link."""
    rpy: Three = ZERO


@dataclass(frozen=True, slots=True)
class Mimic:
    """A coordinate that is `multiplier` times another joint's, and `offset`."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True)
class TreeJoint:
    """A joint from a parent link to a child link; `axis` has length 1."""

    name: str
    kind: str
    parent: str
    child: str
    xyz: Three
    rpy: Three
    axis: Three
    mimic: Mimic | None = None


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """A base, the joints, each after the one that carries its parent link, and links' shapes."""

    name: str
    base: str
    joints: tuple[TreeJoint, ...]
    shapes: Mapping[str, tuple[Shape, ...]] = field(default_factory=dict)
    """Of each link."""

    @property
    def links(self) -> tuple[str, ...]:
        """All links, the base first."""
        return (self.base, *(joint.child for joint in self.joints))

    @property
    def reach(self) -> float:
        """How far from its first turning joint a robot may come, m; 0 where none turns."""
        far: dict[str, float] = {}
        for joint in self.joints:
            if joint.parent in far:
                far[joint.child] = far[joint.parent] + hypot(*joint.xyz)
            elif joint.kind in TURNING:
                far[joint.child] = 0.0
        return max((at + _extent(self.shapes[link]) for link, at in far.items()), default=0.0)


def parse_urdf(urdf: bytes, origin: str) -> RobotDescription:
    """Read a URDF; `UnreadableError` begins with its origin, and names what is wrong."""
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True
    )
    try:
        root = etree.fromstring(urdf, parser)
        return _read(root)
    except (etree.XMLSyntaxError, _WrongError) as error:
        raise UnreadableError(f"{origin}: is no URDF that can be drawn: {error}") from None


class _WrongError(Exception):
    """What is wrong of a URDF."""


def _read(root: Any) -> RobotDescription:
    if root.tag != "robot":
        raise _WrongError(f"its root is <{root.tag}>, expected <robot>")
    joints = [_joint(element) for element in root.findall("joint")]
    links = [_name(element) for element in root.findall("link")]
    ordered = _from_the_base(links, joints)
    base = next(link for link in links if link not in {joint.child for joint in joints})
    carried: dict[str, list[Three]] = {link: [] for link in links}
    for joint in joints:
        carried[joint.parent].append(joint.xyz)
    frames = {joint.child for joint in joints if joint.kind == "fixed" and not carried[joint.child]}
    shapes = {
        link: tuple(_shapes(element)) or (() if link in frames else tuple(_rods(carried[link])))
        for link, element in zip(links, root.findall("link"), strict=True)
    }
    return RobotDescription(root.get("name", "robot"), base, ordered, shapes)


def _from_the_base(links: Sequence[str], joints: Sequence[TreeJoint]) -> tuple[TreeJoint, ...]:
    """Return the joints of a tree, each after the one that carries its parent link."""
    above = {joint.child: joint for joint in joints}
    known = {*links}
    if len(known) < len(links) or len({joint.name for joint in joints}) < len(joints):
        raise _WrongError("two links or two joints have one name")
    if unknown := {end for j in joints for end in (j.parent, j.child)} - known:
        raise _WrongError(f"there is no link {quoted(min(unknown))}")
    below: dict[str, list[TreeJoint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    to_visit = [link for link in links if link not in above]
    bases, ordered = len(to_visit), []
    while to_visit:
        for joint in below.get(to_visit.pop(), ()):
            ordered.append(joint)
            to_visit.append(joint.child)
    if bases != 1 or len(ordered) != len(joints) or len(above) < len(joints):
        raise _WrongError("its links are not one tree")
    names = {joint.name for joint in joints if joint.kind in MOVING and joint.mimic is None}
    for joint in joints:
        if joint.mimic and joint.mimic.joint not in names:
            raise _WrongError(f"joint {quoted(joint.name)} mimics none that moves by itself")
    return tuple(ordered)


def _joint(element: Any) -> TreeJoint:
    kind = element.get("type", "")
    if kind not in (*MOVING, "fixed"):
        raise _WrongError(f"joint {quoted(_name(element))}: type: got {quoted(kind)}")
    parent, child = (_child(element, tag).get("link", "") for tag in ("parent", "child"))
    x, y, z = _three(element.find("axis"), "xyz", _ALONG_X)
    length = hypot(x, y, z)
    if kind in MOVING and not length:
        raise _WrongError(f"joint {quoted(_name(element))}: its axis has no direction")
    origin, mimic = element.find("origin"), element.find("mimic")
    return TreeJoint(
        _name(element),
        kind,
        parent,
        child,
        _three(origin, "xyz"),
        _three(origin, "rpy"),
        (x / length, y / length, z / length) if length else ZERO,
        None
        if mimic is None or kind == "fixed"
        else Mimic(
            mimic.get("joint", ""),
            *_numbers(mimic, "multiplier", (1.0,)),
            *_numbers(mimic, "offset", (0.0,)),
        ),
    )


def _shapes(link: Any) -> Iterator[Shape]:
    """Yield what a link looks like, or what collides of it where its looks are meshes alone."""
    for tag in ("visual", "collision"):
        found = []
        for part in link.findall(tag):
            geometry, origin = part.find("geometry"), part.find("origin")
            for shape in () if geometry is None else geometry:
                if shape.tag in _SIZES:
                    size = [
                        number
                        for key, count in _SIZES[shape.tag].items()
                        for number in _numbers(shape, key, (0.0,) * count)
                    ]
                    place = _three(origin, "xyz"), _three(origin, "rpy")
                    found.append(Shape(shape.tag, tuple(size), *place))
        if found:
            yield from found
            return


def _rods(ends: Sequence[Three]) -> Iterator[Shape]:
    """Yield a rod from a link's origin to each end that is apart from it, and a ball there."""
    thickest = 0.0
    for x, y, z in ends or [_STUB]:
        length = hypot(x, y, z)
        if length <= _THINNEST:
            continue
        radius = max(_SLENDER * length, _THINNEST)
        thickest = max(thickest, radius)
        turned = (0.0, atan2(hypot(x, y), z), atan2(y, x))
        yield Shape("cylinder", (radius, length), (x / 2, y / 2, z / 2), turned)
    yield Shape("sphere", (1.3 * (thickest or _THINNEST),))


def _extent(shapes: Sequence[Shape]) -> float:
    """Return how far from a link's origin its shapes come, or may, m."""
    half = {"box": 0.5, "cylinder": 0.5, "sphere": 1.0}
    found = (
        hypot(*shape.xyz)
        + half[shape.kind] * (hypot(*shape.size) if shape.kind == "box" else shape.size[-1])
        for shape in shapes
    )
    return max(found, default=0.0)


def _name(element: Any) -> str:
    name = str(element.get("name", "")).strip()
    if not name:
        raise _WrongError(f"a <{element.tag}> has no name")
    return name


def _child(element: Any, tag: str) -> Any:
    found = element.find(tag)
    if found is None:
        raise _WrongError(f"joint {quoted(_name(element))}: has no <{tag}>")
    return found


def _three(element: Any, key: str, otherwise: Three = ZERO) -> Three:
    x, y, z = otherwise if element is None else _numbers(element, key, otherwise)
    return x, y, z


def _numbers(element: Any, key: str, otherwise: Sequence[float]) -> Sequence[float]:
    text = element.get(key)
    if text is None:
        return otherwise
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != len(otherwise) or not all(map(isfinite, numbers)):
        raise _WrongError(f"<{element.tag}> {key}: got {quoted(text)}")
    return numbers
