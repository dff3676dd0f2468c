"""The joints of a URDF as one tree from the base, and the mass matrix of what they carry.

M(q) = sum over links of J^T diag(m, m, m, I) J, with J the Jacobian of the link's centre of mass in
the axes of the base.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import Array, Link, UrdfJoint

DEEPEST = 500
"""Joints between a link and the base: adam goes down the tree by recursion, of which Python has an
end at about twice as many."""


def from_the_base(
    links: Mapping[str, Link], joints: Sequence[UrdfJoint], faults: Remarks
) -> tuple[UrdfJoint, ...] | None:
    """Return the joints, whose ends are links, each after that of its parent link.

    None where they are not one tree, which is a fault.
    """
    looped = False
    above: dict[str, UrdfJoint] = {}
    below: dict[str, list[UrdfJoint]] = {name: [] for name in links}
    for joint in joints:
        if joint.child in above:
            faults.add(
                f"joints {quoted(above[joint.child].name)} and {quoted(joint.name)} both lead to "
                "it: a closed "
                "loop; expected an open chain or tree",
                "link",
                joint.child,
            )
            looped = True
            continue
        above[joint.child] = joint
        below[joint.parent].append(joint)
    bases = [name for name in links if name not in above]
    if len(bases) > 1:
        for name in bases:
            faults.add("without a joint that leads there; expected one base link", "link", name)
    order, to_visit, unreached = [], list(bases), links.keys() - set(bases)
    depth = dict.fromkeys(bases, 0)
    while to_visit:
        link = to_visit.pop()
        for joint in below[link]:
            order.append(joint)
            to_visit.append(joint.child)
            unreached -= {joint.child}
            depth[joint.child] = depth[link] + 1
    if (deepest := max(depth.values(), default=0)) > DEEPEST:
        last = next(joint for joint in order if depth[joint.child] == DEEPEST + 1)
        faults.add(
            f"is the first of {deepest - DEEPEST} that lie deeper than {DEEPEST} joints from the "
            "base; expected a robot, or make one link of those that fixed joints hold together",
            "joint",
            last.name,
        )
    for name in sorted(unreached):
        faults.add("in a closed loop of joints; expected an open chain or tree", "link", name)
    return None if looped or len(bases) != 1 or unreached else tuple(order)


def moving_links(order: Sequence[UrdfJoint]) -> dict[str, tuple[UrdfJoint, Array, Array]]:
    """Return the links that move: the joint of each, and R (3, 3) and p (3,) in its frame, m."""
    moving: dict[str, tuple[UrdfJoint, Array, Array]] = {}
    for joint in order:
        if joint.kind != "fixed":
            moving[joint.child] = joint, np.eye(3), np.zeros(3)
        elif joint.parent in moving:
            mover, R, p = moving[joint.parent]
            moving[joint.child] = mover, R @ joint.origin.rotation, p + R @ joint.origin.xyz
    return moving


def mass_matrix(
    links: Mapping[str, Link], order: Sequence[UrdfJoint], axes: Sequence[UrdfJoint], q: Array
) -> tuple[Array, Array]:
    """Return M(q), (m, m), and for each of its diagonal the largest that any axis could give, (m,).

    `axes` are the joints that move, in the order of q (m,), rad or m.
    """
    m = len(axes)
    number = {joint.name: k for k, joint in enumerate(axes)}
    mass, largest = np.zeros((m, m)), np.zeros(m)
    for name, R, p, movers in _frames(order, number, q):
        inertial = links[name].inertial
        turned = R @ inertial.origin.rotation
        inertia = turned @ np.array(inertial.inertia) @ turned.T
        centre = p + R @ inertial.origin.xyz
        slides, turns = np.zeros((3, m)), np.zeros((3, m))
        for joint, axis, at in movers:
            k, arm = number[joint.name], centre - at
            if joint.kind == "prismatic":
                slides[:, k] = axis
                largest[k] += inertial.mass
            else:
                slides[:, k], turns[:, k] = np.cross(axis, arm), axis
                largest[k] += np.abs(np.trace(inertia)) + inertial.mass * (arm @ arm)
        mass += inertial.mass * slides.T @ slides + turns.T @ inertia @ turns
    return mass, largest


def _frames(
    order: Sequence[UrdfJoint], number: Mapping[str, int], q: Array
) -> Iterator[tuple[str, Array, Array, tuple[tuple[UrdfJoint, Array, Array], ...]]]:
    """Yield each link below the base: R, p, and the joints that move it with their axes."""
    none: tuple[tuple[UrdfJoint, Array, Array], ...] = ()
    at: dict[str, tuple[Array, Array, tuple[tuple[UrdfJoint, Array, Array], ...]]] = {}
    for joint in order:
        R, p, movers = at.get(joint.parent, (np.eye(3), np.zeros(3), none))
        p = p + R @ joint.origin.xyz
        R = R @ joint.origin.rotation
        if joint.kind != "fixed":
            axis, coordinate = R @ joint.axis, q[number[joint.name]]
            movers = (*movers, (joint, axis, p))
            if joint.kind == "prismatic":
                p = p + coordinate * axis
            else:
                R = R @ Rotation.from_rotvec(coordinate * np.array(joint.axis)).as_matrix()
        at[joint.child] = R, p, movers
        yield joint.child, R, p, movers
