"""A URDF file as values: links, joints, and the tree that they form, with a fixed base.

A moving joint k carries a body: its child link and all that is fixed to it. With S_k the joint's
axis and I_k the body's inertia, S_k^T I_k S_k > 0 for every k makes the mass matrix positive
definite at every q: the outermost joint that moves first gives its body kinetic energy. So this is
what is asked of the inertias, and links without any may be fixed to others.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast, get_args
from xml.etree.ElementTree import Element, ParseError, parse

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from plant_fmu.errors import FmuError

Array = NDArray[np.float64]
Three = tuple[float, float, float]
Kind = Literal["revolute", "continuous", "prismatic", "fixed"]

_XACRO = re.compile(r"\{http://(www\.)?(ros\.org/wiki|wiki\.ros\.org)/xacro")
_ZERO: Three = (0.0, 0.0, 0.0)
_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a frame is in another: translation in m, and roll, pitch, yaw in rad."""

    xyz: Three = _ZERO
    rpy: Three = _ZERO

    @property
    def rotation(self) -> Array:
        """R = Rz(yaw) Ry(pitch) Rx(roll), (3, 3)."""
        matrix: Array = Rotation.from_euler("xyz", self.rpy).as_matrix()
        return matrix


@dataclass(frozen=True, slots=True)
class Inertial:
    """A link's mass in kg, and its inertia in kg m2 about the centre of mass, in axes `origin`."""

    origin: Pose = Pose()
    mass: float = 0.0
    inertia: tuple[Three, Three, Three] = (_ZERO, _ZERO, _ZERO)


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid link; one without mass is only a frame."""

    name: str
    inertial: Inertial


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint from a parent link to a child link; `axis` has length 1, and 0 for a fixed joint.

    `damping` is in N m s/rad or N s/m; `friction`, in N m or N, is dry friction.
    """

    name: str
    kind: Kind
    parent: str
    child: str
    origin: Pose
    axis: Three
    damping: float
    friction: float


@dataclass(frozen=True, slots=True)
class Robot:
    """An open chain or tree of links, the joints in the file's order."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]

    @property
    def axes(self) -> tuple[Joint, ...]:
        """The joints that move: entry i of q belongs to the i-th."""
        return tuple(joint for joint in self.joints if joint.kind != "fixed")

    def warnings(self) -> tuple[str, ...]:
        """What of the file is left out of the dynamics."""
        return tuple(
            f"joint {joint.name!r}: its dry friction of {joint.friction:g} is left out"
            for joint in self.axes
            if joint.friction
        )


def read_urdf(path: Path) -> Robot:
    """Read and check a URDF file; `FmuError` names the file, the element and what to do."""
    try:
        root = parse(path).getroot()
    except OSError as error:
        raise FmuError(f"{path}: cannot be read: {error.strerror}") from None
    except (ParseError, ValueError) as error:
        raise FmuError(f"{path}: is no XML: {error}") from None
    try:
        return _robot(root)
    except FmuError as error:
        raise FmuError(f"{path}: {error}") from None


def _robot(root: Element) -> Robot:
    if root.tag != "robot":
        raise FmuError(f"has no <robot>: its root is <{root.tag}>")
    if any(_XACRO.match(element.tag) for element in root.iter()):
        raise FmuError("is a xacro file; expand it first: xacro robot.urdf.xacro > robot.urdf")
    links = {link.name: link for link in map(_link, _distinct(root, "link"))}
    joints = tuple(_joint(element, links) for element in _distinct(root, "joint"))
    robot = Robot(_name(root, "robot"), tuple(links.values()), joints)
    if not robot.axes:
        raise FmuError("has no moving joint; expected a revolute, continuous or prismatic one")
    _check_inertias(robot, links)
    return robot


# Elements


def _distinct(root: Element, tag: str) -> Iterator[Element]:
    """The elements `tag` of the robot, no two of one name."""
    seen: set[str] = set()
    for element in root.findall(tag):
        name = _name(element, tag)
        if name in seen:
            raise FmuError(f"has two {tag}s named {name!r}; give one of them another name")
        seen.add(name)
        yield element


def _name(element: Element, tag: str) -> str:
    """The element's name, which goes into comments of C code: it must not end one."""
    name = element.get("name", "").strip()
    if not name:
        raise FmuError(f"a <{tag}> has no name; give it one")
    if "*" in name or not name.isprintable():
        raise FmuError(f"{tag} {name!r}: a name is made of printable characters other than *")
    return name


def _link(element: Element) -> Link:
    name = _name(element, "link")
    inertial = element.find("inertial")
    if inertial is None:
        return Link(name, Inertial())
    where = f"link {name!r}: <inertial>"
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        raise FmuError(f"{where} has no <{'mass' if mass is None else 'inertia'}>; add it")
    xx, xy, xz, yy, yz, zz = (
        _numbers(inertia, key, 1, f"{where} <inertia>")[0]
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    return Link(
        name,
        Inertial(
            _pose(inertial, where),
            _numbers(mass, "value", 1, f"{where} <mass>")[0],
            ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)),
        ),
    )


def _joint(element: Element, links: dict[str, Link]) -> Joint:
    name = _name(element, "joint")
    where = f"joint {name!r}:"
    kind = element.get("type", "")
    if kind not in get_args(Kind):
        expected = "revolute, continuous, prismatic or fixed"
        raise FmuError(f"{where} type: expected {expected}, got {kind!r}")
    if element.find("mimic") is not None:
        raise FmuError(f"{where} <mimic> is not supported; remove it, or make the joint fixed")
    dynamics = element.find("dynamics")
    damping, friction = (
        0.0 if dynamics is None else _numbers(dynamics, key, 1, f"{where} <dynamics>", "0")[0]
        for key in ("damping", "friction")
    )
    if damping < 0.0:
        raise FmuError(f"{where} <dynamics> damping: expected 0 or more, got {damping:g}")
    return Joint(
        name,
        cast("Kind", kind),
        _end(element, "parent", where, links),
        _end(element, "child", where, links),
        _pose(element, where),
        _ZERO if kind == "fixed" else _axis(element, where),
        damping,
        friction,
    )


def _end(element: Element, tag: str, where: str, links: dict[str, Link]) -> str:
    end = element.find(tag)
    link = "" if end is None else end.get("link", "").strip()
    if link not in links:
        raise FmuError(f"{where} <{tag}>: there is no link {link!r}")
    return link


def _axis(element: Element, where: str) -> Three:
    axis = element.find("axis")
    if axis is None:
        raise FmuError(f'{where} has no <axis>; the default of URDF is <axis xyz="1 0 0"/>')
    direction = _three(axis, "xyz", f"{where} <axis>")
    length = float(np.linalg.norm(direction))
    if length == 0.0:
        raise FmuError(f"{where} <axis> xyz: expected a direction, got 0 0 0")
    x, y, z = (component / length for component in direction)
    return x, y, z


def _pose(element: Element, where: str) -> Pose:
    origin = element.find("origin")
    if origin is None:
        return Pose()
    where = f"{where} <origin>"
    return Pose(_three(origin, "xyz", where, "0 0 0"), _three(origin, "rpy", where, "0 0 0"))


def _three(element: Element, key: str, where: str, default: str = "") -> Three:
    x, y, z = _numbers(element, key, 3, where, default)
    return x, y, z


def _numbers(element: Element, key: str, n: int, where: str, default: str = "") -> Sequence[float]:
    """The `n` finite numbers of an attribute."""
    text = element.get(key, default)
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != n or not np.isfinite(numbers).all():
        expected = "a number" if n == 1 else f"{n} numbers"
        raise FmuError(f"{where} {key}: expected {expected}, got {text!r}")
    return numbers


# The tree


def _from_the_base(robot: Robot) -> Iterator[Joint]:
    """The joints, each after that of its parent link; `FmuError` unless they are one tree."""
    above: dict[str, Joint] = {}
    below: dict[str, list[Joint]] = {link.name: [] for link in robot.links}
    for joint in robot.joints:
        if joint.child in above:
            raise FmuError(
                f"link {joint.child!r}: joints {above[joint.child].name!r} and {joint.name!r} both "
                "lead to it: a closed loop; expected an open chain or tree"
            )
        above[joint.child] = joint
        below[joint.parent].append(joint)
    bases = [name for name in below if name not in above]
    if len(bases) > 1:
        raise FmuError(
            f"links {', '.join(map(repr, bases))}: no joint leads to them; expected one base link"
        )
    to_visit, unreached = bases, below.keys() - set(bases)
    while to_visit:
        for joint in below[to_visit.pop()]:
            yield joint
            to_visit.append(joint.child)
            unreached -= {joint.child}
    if unreached:
        raise FmuError(
            f"links {', '.join(map(repr, sorted(unreached)))}: their joints are a closed loop; "
            "expected an open chain or tree"
        )


def _check_inertias(robot: Robot, links: dict[str, Link]) -> None:
    """S^T I S > 0 for each moving joint and its body, whose links have physical inertias."""
    bodies: dict[str, tuple[Joint, Array, Array]] = {}  # link: moving joint; R and p in its frame
    for joint in _from_the_base(robot):
        if joint.kind != "fixed":
            bodies[joint.child] = joint, np.eye(3), np.zeros(3)
        elif joint.parent in bodies:
            mover, R, p = bodies[joint.parent]
            bodies[joint.child] = mover, R @ joint.origin.rotation, p + R @ joint.origin.xyz
    for name in bodies:
        _check_inertial(links[name])
    for joint in robot.axes:
        about, largest = np.sum(
            [
                _about_axis(links[name].inertial, joint, R, p)
                for name, (mover, R, p) in bodies.items()
                if mover is joint
            ],
            axis=0,
        )
        if about <= _ROUNDING * largest:
            raise FmuError(
                f"joint {joint.name!r}: link {joint.child!r} and what is fixed to it have no "
                f"{'mass' if joint.kind == 'prismatic' else 'inertia about its axis'}; give "
                f"link {joint.child!r} an <inertial> with a positive mass and inertia"
            )


def _check_inertial(link: Link) -> None:
    where = f"link {link.name!r}: <inertial>"
    if link.inertial.mass < 0.0:
        raise FmuError(f"{where} <mass> value: expected 0 or more, got {link.inertial.mass:g}")
    least, *_, largest = np.linalg.eigvalsh(link.inertial.inertia)
    if least < -_ROUNDING * abs(largest):
        raise FmuError(
            f"{where} <inertia>: expected no negative principal moment, got {least:g} kg m2"
        )


def _about_axis(inertial: Inertial, joint: Joint, R: Array, p: Array) -> tuple[float, float]:
    """S^T I S of a link at R, p in the joint's frame, and the largest that any axis could give."""
    if joint.kind == "prismatic":
        return inertial.mass, inertial.mass
    centre = p + R @ inertial.origin.xyz
    axis = (R @ inertial.origin.rotation).T @ joint.axis
    steiner = inertial.mass * np.sum(np.cross(joint.axis, centre) ** 2)
    largest = np.trace(inertial.inertia) + inertial.mass * centre @ centre
    return float(axis @ inertial.inertia @ axis + steiner), float(largest)
