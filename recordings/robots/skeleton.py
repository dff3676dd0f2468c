"""A robot on paper: a point a link, a line from each to the link that carries it.

The picture is seen along y, x to the right and z up; what lies behind is drawn up and to the right
(an oblique projection), so that arms in a plane of x and z are drawn as they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.robots.description import ZERO, RobotDescription, Shape, TreeJoint
from nrs_cosim.recordings.robots.kinematics import Kinematics
from nrs_cosim.recordings.robots.placed import placed_robots

Array = NDArray[np.float64]
_SEEN = np.array([[1.0, 0.0], [0.35, 0.2], [0.0, 1.0]])
"""(3, 2): where x, y and z go."""


@dataclass(frozen=True, slots=True, eq=False)
class Skeleton:
    """How a robot is drawn; one of which nothing turns is a point in the plane of its joints."""

    kinematics: Kinematics
    known: bool
    """Whether its URDF is: one that has none is a chain of links of 1 m in a plane."""

    @property
    def parents(self) -> tuple[int, ...]:
        """Of each point after the first, that of the link that carries it; none of a point."""
        description = self.kinematics.description
        if not description.reach:
            return ()
        place = {link: at for at, link in enumerate(description.links)}
        return tuple(place[joint.parent] for joint in description.joints)

    def points(self, q: Array) -> Array:
        """Return (times, points, 2) in m, of positions (times, m)."""
        seen: Array = self.kinematics.links(q)[:, :, :3] @ _SEEN
        return seen


def skeletons(reader: Reader, robots: Sequence[int], m: int) -> tuple[Skeleton, ...]:
    """Return those of some robots, each of m joints; `UnreadableError` as `placed_robots`."""
    placed = {robot.number: robot.kinematics for robot in placed_robots(reader, {*robots})}
    unknown = Skeleton(_unit_chain(m), known=False)
    return tuple(
        Skeleton(placed[robot], known=True) if robot in placed else unknown for robot in robots
    )


def _unit_chain(m: int) -> Kinematics:
    """Return m joints that turn in a plane, each 1 m from the one before, and the end."""
    joints = tuple(
        TreeJoint(
            name=str(k),
            kind="continuous" if k < m else "fixed",
            parent=str(k),
            child=str(k + 1),
            xyz=(1.0, 0.0, 0.0) if k else ZERO,
            rpy=ZERO,
            axis=(0.0, -1.0, 0.0),
        )
        for k in range(m + 1)
    )
    shapes: dict[str, tuple[Shape, ...]] = dict.fromkeys(map(str, range(m + 2)), ())
    return Kinematics.of(RobotDescription("chain", "0", joints, shapes), [*shapes][:m])
