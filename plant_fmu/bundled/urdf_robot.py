"""A robot as its URDF describes it: links, joints, and the tree that they form, its base fixed."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
Three = tuple[float, float, float]
Kind = Literal["revolute", "continuous", "prismatic", "fixed"]

ZERO: Three = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a frame is in another: translation in m, and roll, pitch, yaw in rad."""

    xyz: Three = ZERO
    rpy: Three = ZERO

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
    inertia: tuple[Three, Three, Three] = (ZERO, ZERO, ZERO)


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid link; one without mass is only a frame, and so is one that never moves."""

    name: str
    inertial: Inertial


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint from a parent link to a child link; `axis` has length 1, and 0 for a fixed joint.

    `damping` is in N m s/rad or N s/m; dry friction is left out.
    """

    name: str
    kind: Kind
    parent: str
    child: str
    origin: Pose
    axis: Three
    damping: float


@dataclass(frozen=True, slots=True)
class UrdfRobot:
    """An open chain or tree of links, the joints in the file's order."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[UrdfJoint, ...]
    warnings: tuple[str, ...] = ()
    """What of the file was read otherwise than it is written, or is left out of the dynamics."""
    text: bytes = field(default=b"", repr=False, compare=False)
    """What is kept of the file; see `urdf_text`."""

    @property
    def axes(self) -> tuple[UrdfJoint, ...]:
        """The joints that move: entry i of q belongs to the i-th."""
        return tuple(joint for joint in self.joints if joint.kind != "fixed")
