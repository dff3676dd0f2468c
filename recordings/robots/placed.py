"""The robots of a recording in one world: x ahead, z up, one beside the other along y.

Frames are `robot_3/<link>`, so that robots of one URDF are told apart; the target is a pale figure
like the first robot that has one, in the place of number 0. Robots of which nothing turns move in
one plane, and are not set apart.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from nrs_cosim.bus.keys import node_name
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import URDFS
from nrs_cosim.recordings.robots.description import (
    ZERO,
    RobotDescription,
    Shape,
    TreeJoint,
    parse_urdf,
)
from nrs_cosim.recordings.robots.kinematics import Kinematics
from nrs_cosim.recordings.schemas import about

Array = NDArray[np.float64]
WORLD = "world"
COLOURS = (
    (0.12, 0.47, 0.71),
    (1.0, 0.5, 0.05),
    (0.17, 0.63, 0.17),
    (0.84, 0.15, 0.16),
    (0.58, 0.4, 0.74),
    (0.55, 0.34, 0.29),
)
_PALE = (0.6, 0.6, 0.6, 0.4)


@dataclass(frozen=True, slots=True, eq=False)
class PlacedRobot:
    """A robot, or the target as one, and where its base is."""

    number: int
    urdf: bytes
    kinematics: Kinematics
    y: float
    """m"""

    @property
    def name(self) -> str:
        """Its name, and the folder of its topics and frames."""
        return node_name(self.number)

    @property
    def description(self) -> RobotDescription:
        """What it is made of."""
        return self.kinematics.description

    @property
    def colour(self) -> tuple[float, float, float, float]:
        """Red, green, blue and opacity."""
        return (*COLOURS[self.number % len(COLOURS)], 1.0) if self.number else _PALE

    def frame(self, link: str) -> str:
        """Return the frame of a link."""
        return f"{self.name}/{link}"

    @property
    def moving(self) -> list[tuple[str, str]]:
        """The parent and child frames of the joints that move."""
        return self._frames(self.kinematics.moving)

    @property
    def still(self) -> tuple[list[tuple[str, str]], Array]:
        """Those that never move, the base in the world first, and where they are (…, 7)."""
        stays = ~self.kinematics.moving
        base = [0.0, self.y, 0.0, 0.0, 0.0, 0.0, 1.0]
        frames = [(WORLD, self.frame(self.description.base)), *self._frames(stays)]
        return frames, np.concatenate([[base], self.kinematics.rest[stays]])

    def _frames(self, of: NDArray[np.bool_]) -> list[tuple[str, str]]:
        return [
            (self.frame(joint.parent), self.frame(joint.child))
            for joint, taken in zip(self.description.joints, of.tolist(), strict=True)
            if taken
        ]


def placed_robots(reader: Reader, robots: Collection[int] | None = None) -> list[PlacedRobot]:
    """Return the target and the robots, all or some, that have a URDF, by their numbers.

    `UnreadableError` names a URDF that is none. Robots of one URDF share their kinematics.
    """
    said = about(reader)
    wanted = {i: urdf for i, urdf in sorted(said.urdfs.items()) if robots is None or i in robots}
    if not wanted:
        return []
    attached = {urdf: name for name in reader.metadata[URDFS] for urdf in [_content(reader, name)]}
    names = {
        i: names for group in said.run.plants for names in [_names(group)] for i in group.robots
    }
    known: dict[tuple[bytes, tuple[str, ...]], Kinematics] = {}
    for i, urdf in wanted.items():
        if (urdf, names[i]) not in known:
            description = parse_urdf(urdf, f"{reader.path}: {attached[urdf]}")
            known[urdf, names[i]] = Kinematics.of(description, names[i])
    first = min(wanted)
    apart = max(one.description.reach for one in known.values())
    return [
        PlacedRobot(i, wanted[like], known[wanted[like], names[like]], apart * i)
        for i, like in [(0, first), *((i, i) for i in wanted)]
    ]


def shown_robots(reader: Reader) -> list[PlacedRobot]:
    """Return the target and all robots: by their URDFs, or as points where none is known."""
    placed, run = placed_robots(reader), about(reader).run
    known = {robot.number for robot in placed}
    point = Kinematics.of(*_point(run.joints))
    numbers = range(1 if placed else 0, run.robots + 1)
    return [*placed, *(PlacedRobot(i, b"", point, 0.0) for i in numbers if i not in known)]


_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _point(m: int) -> tuple[RobotDescription, list[str]]:
    """Return a ball whose place is the first three joints', each 1 m a unit, and their names."""
    names = [f"joint_{at}" for at in range(1, min(m, len(_AXES)) + 1)]
    links = ["origin", *names[:-1], "point"]
    joints = tuple(
        TreeJoint(name, "prismatic", parent, child, ZERO, ZERO, axis)
        for name, parent, child, axis in zip(names, links, links[1:], _AXES, strict=False)
    )
    shapes: dict[str, tuple[Shape, ...]] = {
        **dict.fromkeys(links, ()),
        "point": (Shape("sphere", (_BALL,)),),
    }
    return RobotDescription("point", "origin", joints, shapes), names


_BALL = 0.1
"""m"""


def _content(reader: Reader, name: str) -> bytes:
    return reader.attachments[name][1]


def _names(group: Any) -> tuple[str, ...]:
    return tuple(joint.name for joint in group.joints)


def own_urdf(robot: PlacedRobot) -> str:
    """Return a robot's URDF as of one among others: links by their frames, looks in its colour.

    Looks are shapes alone, for whoever opens a recording has no meshes.
    """
    root = etree.fromstring(robot.urdf, etree.XMLParser(resolve_entities=False, no_network=True))
    root.set("name", robot.name)
    for material in root.findall("material"):
        root.remove(material)
    for link in root.findall("link"):
        shapes = robot.description.shapes[link.get("name")]
        for looks in (*link.findall("visual"), *link.findall("collision")):
            link.remove(looks)
        link.set("name", robot.frame(link.get("name")))
        for shape in shapes:
            _add_visual(link, shape.kind, shape.size, (shape.xyz, shape.rpy), robot)
    for end in root.iterfind("joint/*[@link]"):
        end.set("link", robot.frame(end.get("link")))
    text: str = etree.tostring(root, encoding="unicode")
    return text


def _add_visual(
    link: Any,
    kind: str,
    size: Sequence[float],
    pose: Sequence[Sequence[float]],
    robot: PlacedRobot,
) -> None:
    visual = etree.SubElement(link, "visual")
    etree.SubElement(visual, "origin", xyz=_words(pose[0]), rpy=_words(pose[1]))
    keys = {"box": ["size"], "cylinder": ["radius", "length"], "sphere": ["radius"]}[kind]
    values = [_words(size)] if kind == "box" else [_words([number]) for number in size]
    geometry = etree.SubElement(visual, "geometry")
    etree.SubElement(geometry, kind, dict(zip(keys, values, strict=True)))
    material = etree.SubElement(visual, "material", name=robot.name)
    etree.SubElement(material, "color", rgba=_words(robot.colour))


def _words(numbers: Sequence[float]) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
