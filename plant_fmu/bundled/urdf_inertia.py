"""Whether the inertias of a URDF give a positive definite mass matrix.

A moving joint k carries a body: its child link and all that is fixed to it. With S_k the joint's
axis and I_k the body's inertia, S_k^T I_k S_k > 0 for every k makes the mass matrix positive
definite at every q: the outermost joint that moves first gives its body kinetic energy. This is
sufficient and not necessary: two joints with a massless link between them may turn the same body,
and a joint that mimics another may turn none.
So where it does not hold, M is looked at where the robot starts and in postures drawn at random.
Links that do not move are in no equation, and their inertias are not looked at.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from nrs_cosim.plant_fmu.bundled.urdf_bodies import RigidBody, bodies
from nrs_cosim.plant_fmu.bundled.urdf_couplings import Couplings
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import Array, Inertial, Link, UrdfJoint
from nrs_cosim.plant_fmu.bundled.urdf_tree import mass_matrix, moving_links

ROUNDING = 1e-12
"""Relative: what a number may be off that tools have computed and written."""
SINGULAR = 1e-9
"""The smallest eigenvalue of M, its diagonal scaled to 1: of double precision 7 digits are left."""
POSTURES, SEED = 8, 1
SOME_INERTIA = Inertial(mass=1.0, inertia=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
"""Stands for one that is wrong, so that the others are judged."""
_GIVE = (
    "give an <inertial> with a positive mass and inertia; CAD data have them, and files of the "
    "robot that are made for simulation"
)


def postures(coupled: Couplings) -> Array:
    """Return the postures that are looked at, (1 + POSTURES, m), rad or m.

    In the first all joints are as near to 0, where a robot starts, as their limits let them.
    """
    random = np.random.Generator(np.random.Philox(SEED))
    drawn = random.uniform(-np.pi, np.pi, (POSTURES, coupled.G.shape[1]))
    return np.vstack([[j.rest for j in coupled.moving if j.mimic is None], drawn])


def judge_inertias(
    links: Mapping[str, Link],
    order: Sequence[UrdfJoint],
    coupled: Couplings,
    faults: Remarks,
    warnings: Remarks,
) -> None:
    """Say which inertias are impossible, and where there are too few."""
    moving, links = moving_links(order), dict(links)
    scale = _scale([links[name].inertial for name in moving], order)
    for name in moving:
        least = float(np.linalg.eigvalsh(links[name].inertial.inertia)[0])
        if least < -ROUNDING * scale:
            faults.add(
                f"<inertial> <inertia>: expected no negative principal moment, got {least:g} kg m2",
                "link",
                name,
            )
            links[name] = replace(links[name], inertial=SOME_INERTIA)
    light = [body.joint for body in bodies(links, order) if not _has_inertia(body)]
    if light:
        _judge_mass(links, order, coupled, light, faults, warnings)


def _scale(inertials: Sequence[Inertial], order: Sequence[UrdfJoint]) -> float:
    """Return the robot's largest moment of inertia: of a link, or a mass times a length squared."""
    lengths = [pose.xyz for pose in (*(j.origin for j in order), *(i.origin for i in inertials))]
    length = max(map(np.linalg.norm, lengths), default=0.0)
    return max(
        (
            max(float(np.abs(np.linalg.eigvalsh(i.inertia)).max()), i.mass * float(length) ** 2)
            for i in inertials
        ),
        default=0.0,
    )


def _has_inertia(body: RigidBody) -> bool:
    """Whether S^T I S > 0 of a joint and its body."""
    if body.joint.rotor > 0.0:
        return True
    if body.joint.kind == "prismatic":
        return body.mass > 0.0
    return bool(body.inertia[2, 2] > ROUNDING * np.abs(np.trace(body.inertia)))


def _judge_mass(
    links: Mapping[str, Link],
    order: Sequence[UrdfJoint],
    coupled: Couplings,
    light: Sequence[UrdfJoint],
    faults: Remarks,
    warnings: Remarks,
) -> None:
    """Say whether M is positive definite at random postures, though some bodies fail."""
    found = [mass_matrix(links, order, coupled, q) for q in postures(coupled)]
    empty = np.all([np.diag(M) <= ROUNDING * largest for M, largest in found], axis=0)
    if empty.any():
        leading = [joint for joint in coupled.moving if joint.mimic is None]
        for joint in (joint for joint, none in zip(leading, empty, strict=True) if none):
            what = "mass" if joint.kind == "prismatic" else "inertia about its joint's axis"
            text = f"no {what}, all that moves with it included; {_GIVE}"
            faults.add(text, "link", joint.child)
        return
    text = "no inertia about its joint's axis of its own, and the mass matrix is "
    if min(_definiteness(M) for M, _ in found) > SINGULAR:
        said = warnings
        text += (
            f"positive definite in the posture of zeros and {POSTURES} random ones; it may be "
            "singular in others"
        )
    else:
        said = faults
        text += f"singular; lock a joint that leads there (--lock), or {_GIVE}"
    for joint in light:
        said.add(text, "link", joint.child)


def _definiteness(mass: Array) -> float:
    """Return the smallest eigenvalue of M with its diagonal scaled to 1; 0 where that cannot be."""
    diagonal = np.diag(mass)
    if not (diagonal > 0).all():
        return 0.0
    root = np.sqrt(diagonal)
    return float(np.linalg.eigvalsh(mass / np.outer(root, root))[0])
