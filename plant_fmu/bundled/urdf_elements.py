"""The elements of a URDF as values. What is wrong of one does not keep the others from being read.

A number or a link that cannot be read is a fault, and stands as 0 or as none until all faults are
told. Of a link's `<inertial>` the faults are kept apart: only some links' inertias are used.
"""

from collections.abc import Iterator, Sequence
from math import inf
from typing import cast, get_args

import numpy as np

from nrs_cosim.bus.numerals import decimal
from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.bundled.rotations import length
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import (
    BOUNDLESS,
    ZERO,
    Following,
    Inertial,
    Kind,
    Limits,
    Link,
    Pose,
    Three,
    UrdfJoint,
)
from nrs_cosim.plant_fmu.bundled.urdf_selection import FREE
from nrs_cosim.plant_fmu.bundled.urdf_xml import Element

_DEFAULT_AXIS: Three = (1.0, 0.0, 0.0)
LARGEST = 1e30
"""Beyond what is of any robot; masses, and squares of lengths and rates, stay finite together."""


def named_elements(root: Element, tag: str, faults: Remarks) -> Iterator[tuple[str, Element]]:
    """Yield the robot's links or joints with their names, no two of one name."""
    seen: set[str] = set()
    for element in root.findall(tag):
        name = element.get("name", "").strip()
        if not name:
            faults.add(f"a <{tag}> has no name; give it one")
            continue
        if not writable(name):
            faults.add("a name is made of printable characters other than *", tag, name)
        if name in seen:
            faults.add(f"there are two {tag}s of this name; give one of them another", tag, name)
            continue
        seen.add(name)
        yield name, element


def writable(name: str) -> bool:
    """Whether a name can go into comments of C code, of which it must not end one."""
    return "*" not in name and name.isprintable()


def read_link(name: str, element: Element) -> tuple[Link, Remarks]:
    """Return a link, and what is wrong of its `<inertial>`."""
    faults = Remarks()
    inertial = element.find("inertial")
    if inertial is None:
        return Link(name, Inertial()), faults
    read = _Reading("link", name, faults, "<inertial> ")
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    for tag, part in (("mass", mass), ("inertia", inertia)):
        if part is None:
            read.fault(f"has no <{tag}>; add it")
    if mass is None or inertia is None:
        return Link(name, Inertial()), faults
    xx, xy, xz, yy, yz, zz = (
        read.number(inertia, key, "<inertia> ")
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    kilograms = read.number(mass, "value", "<mass> ")
    if kilograms < 0.0:
        read.fault(f"<mass> value: expected 0 or more, got {kilograms:g}")
    tensor = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    return Link(name, Inertial(read.pose(inertial), kilograms, tensor)), faults


def read_joint(
    name: str, element: Element, links: dict[str, Link], faults: Remarks, warnings: Remarks
) -> UrdfJoint:
    """Return a joint, as a fixed one where there is no such kind."""
    read = _Reading("joint", name, faults)
    kind = element.get("type", "")
    parent, child = (_end(element, tag, read, links) for tag in ("parent", "child"))
    if kind in FREE or kind == "fixed":
        return UrdfJoint(name, kind, parent, child, read.pose(element))
    if kind not in get_args(Kind):
        expected = "revolute, continuous, prismatic or fixed"
        read.fault(f"type: expected {expected}, got {quoted(kind)}")
        return UrdfJoint(name, "fixed", parent, child, read.pose(element))
    damping, friction, mimic = 0.0, 0.0, None
    dynamics, follows = element.find("dynamics"), element.find("mimic")
    if dynamics is not None:
        damping, friction = (
            read.number(dynamics, key, "<dynamics> ", "0") for key in ("damping", "friction")
        )
    if damping < 0.0:
        read.fault(f"<dynamics> damping: expected 0 or more, got {damping:g}")
    if friction < 0.0:
        warnings.add(f"its negative dry friction of {friction:g} is left out", "joint", name)
        friction = 0.0
    if follows is not None:
        factor = read.number(follows, "multiplier", "<mimic> ", "1")
        offset = read.number(follows, "offset", "<mimic> ", "0")
        mimic = Following(follows.get("joint", "").strip(), factor, offset)
    return UrdfJoint(
        name,
        cast("Kind", kind),
        parent,
        child,
        read.pose(element),
        _axis(element, read, warnings),
        damping,
        friction,
        _limits(element, kind, read),
        mimic=mimic,
    )


def _limits(element: Element, kind: str, read: "_Reading") -> Limits:
    """What is given of them; what is no number is none, for the dynamics do not depend on it."""
    limit = element.find("limit")
    if limit is None:
        return BOUNDLESS

    def given(key: str, default: str, instead: float) -> float:
        try:
            return decimal(limit.get(key, default))
        except ValueError:
            return instead

    lower, upper = given("lower", "0", -inf), given("upper", "0", inf)
    if kind == "continuous":
        lower, upper = -inf, inf
    elif lower > upper:
        read.fault(f"<limit>: expected a lower of at most upper, got {lower:g} and {upper:g}")
    return Limits(lower, upper, given("effort", "", inf))


class _Reading:
    """The attributes of one link or joint, and where what is wrong of them is said."""

    def __init__(self, what: str, name: str, faults: Remarks, within: str = "") -> None:
        self.what, self.name, self._faults, self._within = what, name, faults, within

    def fault(self, text: str) -> None:
        self._faults.add(f"{self._within}{text}", self.what, self.name)

    def number(self, element: Element, key: str, where: str, default: str = "") -> float:
        return self._numbers(element, key, where, default, (0.0,))[0]

    def three(
        self, element: Element, key: str, where: str, default: str = "", instead: Three = ZERO
    ) -> Three:
        x, y, z = self._numbers(element, key, where, default, instead)
        return x, y, z

    def pose(self, element: Element) -> Pose:
        origin = element.find("origin")
        if origin is None:
            return Pose()
        xyz, rpy = (self.three(origin, key, "<origin> ", "0 0 0") for key in ("xyz", "rpy"))
        return Pose(xyz, rpy)

    def _numbers(
        self, element: Element, key: str, where: str, default: str, instead: Sequence[float]
    ) -> Sequence[float]:
        """Return the finite numbers of an attribute, as many as stand for it where it is faulty."""
        text = element.get(key, default)
        if wrong := wrong_numbers(text, len(instead)):
            self.fault(f"{where}{key}: {wrong}")
            return instead
        return [float(word) for word in text.split()]


def wrong_numbers(text: str, n: int, least: float = -inf) -> str:
    """Return what is expected of a text that is not n finite numbers, and what it is instead."""
    expected = "a number" if n == 1 else f"{n} numbers"
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    # As in XML: Python takes 1_0 and digits of all scripts as well.
    plain = text.isascii() and "_" not in text
    if len(numbers) != n or not np.isfinite(numbers).all() or not plain:
        return f"expected {expected}, got {quoted(text)}"
    if max(map(abs, numbers)) > LARGEST:
        return f"expected {expected} up to {LARGEST:g}, got {quoted(text)}"
    if min(numbers) < least:
        return f"expected {expected} from {least:g}, got {quoted(text)}"
    return ""


def _end(element: Element, tag: str, read: _Reading, links: dict[str, Link]) -> str:
    end = element.find(tag)
    link = "" if end is None else str(end.get("link", "")).strip()
    if link not in links:
        read.fault(f"<{tag}>: there is no link {quoted(link)}")
    return link


def _axis(element: Element, read: _Reading, warnings: Remarks) -> Three:
    axis = element.find("axis")
    if axis is None:
        warnings.add("has no <axis>; URDF's default of 1 0 0 is taken", read.what, read.name)
        return _DEFAULT_AXIS
    direction = np.array(read.three(axis, "xyz", "<axis> ", instead=_DEFAULT_AXIS))
    if not direction.any():
        read.fault("<axis> xyz: expected a direction, got 0 0 0")
        return _DEFAULT_AXIS
    direction /= np.abs(direction).max()  # no square of it is too large or too small
    x, y, z = map(float, direction / length(direction))
    return x, y, z
