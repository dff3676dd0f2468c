"""Where a robot's links are, from the base: T_child = T_parent · Trans(xyz) · R(rpy) · motion(q).

A joint turns by its coordinate about its axis, or slides by it along. Frames are (x, y, z) in m and
a unit quaternion (x, y, z, w), for all times at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.recordings.robots.description import MOVING, RobotDescription, TreeJoint

Array = NDArray[np.float64]
FRAME = 7
"""Numbers of a frame: a translation and a quaternion."""


@dataclass(frozen=True, slots=True, eq=False)
class Kinematics:
    """The frames of a robot's joints (j,), as functions of its coordinates (m,)."""

    description: RobotDescription
    rest: Array
    """(j, 7) in the parent links, where all coordinates are 0."""
    axis: Array
    """(j, 3)"""
    turns: NDArray[np.bool_]
    """(j,)"""
    coordinate: NDArray[np.intp]
    """(j,) which coordinate moves each; −1 for none."""
    multiplier: Array
    offset: Array

    @classmethod
    def of(cls, description: RobotDescription, names: Sequence[str]) -> Self:
        """Return those of a robot whose coordinates are of joints of these names.

        A joint that is not among them stays where its coordinate is 0.
        """
        place = {name: at for at, name in enumerate(names)}

        def moved_by(joint: TreeJoint) -> int:
            name = joint.mimic.joint if joint.mimic else joint.name
            return place.get(name, -1) if joint.kind in MOVING else -1

        joints = description.joints
        return cls(
            description,
            np.array([(*joint.xyz, *quaternion(joint.rpy)) for joint in joints]).reshape(-1, FRAME),
            np.array([joint.axis for joint in joints]).reshape(-1, 3),
            np.array([joint.kind != "prismatic" for joint in joints], bool),
            np.array([moved_by(joint) for joint in joints], np.intp),
            np.array([joint.mimic.multiplier if joint.mimic else 1.0 for joint in joints]),
            np.array([joint.mimic.offset if joint.mimic else 0.0 for joint in joints]),
        )

    @property
    def moving(self) -> NDArray[np.bool_]:
        """(j,) which joints move."""
        return self.coordinate >= 0

    def joints(self, q: Array) -> Array:
        """Return each joint's child link in its parent link (times, j, 7), of q (times, m)."""
        moves = self.moving
        values = np.zeros((len(q), len(moves)))
        values[:, moves] = q[:, self.coordinate[moves]]
        values = self.multiplier * values + self.offset * moves
        found = np.broadcast_to(self.rest, (len(q), *self.rest.shape)).copy()
        turning, sliding = moves & self.turns, moves & ~self.turns
        half = values[:, turning, np.newaxis] / 2
        about = np.concatenate([np.sin(half) * self.axis[turning], np.cos(half)], axis=2)
        found[:, turning, 3:] = product(self.rest[turning, 3:], about)
        along = rotated(self.rest[sliding, 3:], self.axis[sliding])
        found[:, sliding, :3] += values[:, sliding, np.newaxis] * along
        return found

    def links(self, q: Array) -> Array:
        """Return each link in the base (times, links, 7), in the order of `description.links`."""
        place = {link: at for at, link in enumerate(self.description.links)}
        found = np.zeros((len(q), len(place), FRAME))
        found[:, 0, 6] = 1.0
        for at, (joint, frame) in enumerate(
            zip(self.description.joints, self.joints(q).swapaxes(0, 1), strict=True), 1
        ):
            parent = found[:, place[joint.parent]]
            found[:, at, :3] = parent[:, :3] + rotated(parent[:, 3:], frame[:, :3])
            found[:, at, 3:] = product(parent[:, 3:], frame[:, 3:])
        return found


def quaternion(rpy: Sequence[float]) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll) as a quaternion (x, y, z, w)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(np.array(rpy) / 2), np.cos(np.array(rpy) / 2)
    return np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


def product(one: Array, other: Array) -> Array:
    """Return the quaternion (…, 4) of first turning by `other`, then by `one`."""
    (a, b, c, w), (x, y, z, v) = np.moveaxis(one, -1, 0), np.moveaxis(other, -1, 0)
    return np.stack(
        [
            w * x + a * v + b * z - c * y,
            w * y - a * z + b * v + c * x,
            w * z + a * y - b * x + c * v,
            w * v - a * x - b * y - c * z,
        ],
        axis=-1,
    )


def rotated(quaternions: Array, vectors: Array) -> Array:
    """Return vectors (…, 3) turned by quaternions (…, 4)."""
    imaginary, real = quaternions[..., :3], quaternions[..., 3:]
    twice = 2.0 * np.cross(imaginary, vectors)
    return vectors + real * twice + np.cross(imaginary, twice)
