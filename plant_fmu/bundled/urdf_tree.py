"""The joints of a URDF as one tree from the base, and the mass matrix of what they carry.

M = sum over links of J^T diag(m, m, m, I) J, with J the Jacobian of the link's centre of mass in
the axes of the base; of the joints that move by themselves, G^T (M + rotors) G (`urdf_couplings`).
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.bundled.urdf_couplings import Couplings
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import Array, Link, UrdfJoint

DEEPEST = 500
"""Joints between a link and the base: the mass matrix of a chain takes code with their square."""


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


def moving_links(order: Sequence[UrdfJoint]) -> set[str]:
    """Return the links that move, of joints that come each after that of its parent link."""
    moving: set[str] = set()
    for joint in order:
        if joint.kind != "fixed" or joint.parent in moving:
            moving.add(joint.child)
    return moving


def mass_matrix(
    links: Mapping[str, Link], order: Sequence[UrdfJoint], coupled: Couplings, q: Array
) -> tuple[Array, Array]:
    """Return M(q), (m, m), and for each of its diagonal the largest that any axis could give, (m,).

    q (m,), rad or m, is of the joints that move by themselves.
    """
    m = len(coupled.moving)
    number = {joint.name: k for k, joint in enumerate(coupled.moving)}
    largest = np.array([joint.rotor for joint in coupled.moving])
    mass = np.diag(largest)
    for name, R, p, movers in _frames(order, number, coupled.G @ q + coupled.offset):
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
    return coupled.G.T @ mass @ coupled.G, (np.abs(coupled.G).T @ np.sqrt(largest)) ** 2


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
