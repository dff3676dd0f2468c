"""A robot as its URDF describes it: links, joints, and the tree that they form, its base fixed."""

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.plant_fmu.bundled.rotations import multiplied, rotation, rotation_of, rpy_of

Array = NDArray[np.float64]
Three = tuple[float, float, float]
Kind = Literal["revolute", "continuous", "prismatic", "fixed"]
"""What a joint may be; `floating` and `planar` ones are read, and refused unless they are locked.

A locked joint is a fixed one, whose origin is where it was locked.
"""

ZERO: Three = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a frame is in another: translation in m, and roll, pitch, yaw in rad."""

    xyz: Three = ZERO
    rpy: Three = ZERO

    @property
    def rotation(self) -> Array:
        """R = Rz(yaw) Ry(pitch) Rx(roll), (3, 3)."""
        return rotation_of(self.rpy)

    def turned(self, about: Array) -> "Pose":
        """Return the frame after a rotation by a vector (3,), rad, in its own axes."""
        return Pose(self.xyz, rpy_of(multiplied(self.rotation, rotation(about))))


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


class Following(NamedTuple):
    """q = multiplier * (q of the joint `leader`) + offset, in rad or m."""

    leader: str
    multiplier: float
    offset: float


class Limits(NamedTuple):
    """What `<limit>` says, in rad or m, and N m or N; infinite what it does not."""

    lower: float = -np.inf
    upper: float = np.inf
    effort: float = np.inf


BOUNDLESS = Limits()


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint from a parent link to a child link; `axis` has length 1, and 0 for a fixed joint.

    `damping` is in N m s/rad or N s/m, dry `friction` in N m or N. `rotor` is the inertia of the
    motor's rotor as the joint feels it, in kg m2 or kg, and `stop` the stiffness of the soft stops
    at its limits in N m/rad or N/m, 0 for none.
    """

    name: str
    kind: Kind | Literal["floating", "planar"]
    parent: str
    child: str
    origin: Pose
    axis: Three = ZERO
    damping: float = 0.0
    friction: float = 0.0
    limits: Limits = BOUNDLESS
    rotor: float = 0.0
    mimic: Following | None = None
    stop: float = 0.0

    @property
    def rest(self) -> float:
        """What is nearest to 0 within its limits, rad or m."""
        return min(max(0.0, self.limits.lower), self.limits.upper)


@dataclass(frozen=True, slots=True)
class UrdfRobot:
    """An open chain or tree of links, the joints in the file's order."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[UrdfJoint, ...]
    friction_speed: float = 0.0
    """rad/s or m/s, over which dry friction changes its sign; 0 where there is none."""
    warnings: tuple[str, ...] = ()
    """What of the file was read otherwise than it is written, or is left out of the dynamics."""
    text: bytes = field(default=b"", repr=False, compare=False)
    """What is kept of the file; see `urdf_text`."""

    @property
    def axes(self) -> tuple[UrdfJoint, ...]:
        """The joints that move by themselves: entry i of q belongs to the i-th."""
        return tuple(joint for joint in self.joints if joint.kind != "fixed" and not joint.mimic)
