"""What each moving joint carries: its child link and all that is fixed to it, as one rigid body.

A body's axes are turned so that its joint's axis is z, and its origin is the joint's. With mass m,
first moment h = m c and inertia I about that origin, links i that are fixed together add up:
m = Σ m_i, h = Σ m_i c_i, I = Σ (R_i I_i R_iᵀ − m_i [c_i]× [c_i]×).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from nrs_cosim.plant_fmu.bundled.rotations import cross_matrix, length, multiplied
from nrs_cosim.plant_fmu.bundled.urdf_robot import Array, Link, UrdfJoint

_ROUNDED = 1e-15
"""Relative: what is taken for rounding of a 0, which has no code."""


@dataclass(slots=True)
class RigidBody:
    """A joint, where it is on the body below, and what it carries; m, kg, kg m and kg m2."""

    joint: UrdfJoint
    below: int
    """Which body it is on, -1 for the base."""
    R: Array
    p: Array
    mass: float = 0.0
    moment: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))


def bodies(links: Mapping[str, Link], order: Sequence[UrdfJoint]) -> list[RigidBody]:
    """Return the bodies of joints that come each after that of its parent link, in their order."""
    at: dict[str, tuple[int, Array, Array]] = {}
    found: list[RigidBody] = []
    for joint in order:
        below, R, p = at.get(joint.parent, (-1, np.eye(3), np.zeros(3)))
        p = p + multiplied(R, np.array(joint.origin.xyz))
        R = multiplied(R, joint.origin.rotation)
        if joint.kind != "fixed":
            upright = _upright(np.array(joint.axis))
            found.append(
                RigidBody(joint, below, _whole(multiplied(R, upright)), _without_rounding(p))
            )
            below, R, p = len(found) - 1, upright.T, np.zeros(3)
        at[joint.child] = below, R, p
        if below >= 0:
            _add(found[below], links[joint.child], R, p)
    for body in found:
        body.moment = _without_rounding(body.moment)
        body.inertia = _without_rounding((body.inertia + body.inertia.T) / 2)
    return found


def _add(body: RigidBody, link: Link, R: Array, p: Array) -> None:
    inertial = link.inertial
    centre = p + multiplied(R, np.array(inertial.origin.xyz))
    turned, across = multiplied(R, inertial.origin.rotation), cross_matrix(centre)
    body.mass += inertial.mass
    body.moment = body.moment + inertial.mass * centre
    about = multiplied(multiplied(turned, np.array(inertial.inertia)), turned.T)
    body.inertia = body.inertia + about - inertial.mass * multiplied(across, across)


def _upright(axis: Array) -> Array:
    """Return a rotation whose third column is an axis of length 1; of 0 and ±1 if it can be."""
    k = int(np.argmax(np.abs(axis)))
    if np.count_nonzero(axis) == 1:
        turned = np.roll(np.eye(3), 2 - k, axis=1)
        return turned if axis[k] > 0 else turned * [1.0, -1.0, -1.0]
    x = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    x /= length(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def _whole(rotation: Array) -> Array:
    """cos(pi/2) is 0 and not 6e-17, which halves the code of most arms."""
    whole = np.round(rotation)
    return np.where(np.abs(rotation - whole) < _ROUNDED, whole, rotation)


def _without_rounding(numbers: Array) -> Array:
    return np.where(np.abs(numbers) < _ROUNDED * np.abs(numbers).max(), 0.0, numbers)
