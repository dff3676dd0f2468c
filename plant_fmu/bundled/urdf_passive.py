"""Dry friction and soft stops at the joints' limits: off, for they make a robot stiff.

Friction f that changes its sign over a speed v is damping f/v about rest, whose rates are the
eigenvalues of M⁻¹ Gᵀ diag(f/v) G. A stop's stiffness k is such that its joint, all others free,
swings on it with a given frequency at most: k (G M⁻¹ Gᵀ)_jj ≤ (2π frequency)². Both M are looked at
in postures drawn at random. Of k twelve digits are taken, which what libraries round differently
seldom reaches. The forces are in `rigid_body`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from nrs_cosim.plant_fmu.bundled.urdf_couplings import couplings
from nrs_cosim.plant_fmu.bundled.urdf_inertia import postures
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import Link, UrdfJoint
from nrs_cosim.plant_fmu.bundled.urdf_selection import Selection
from nrs_cosim.plant_fmu.bundled.urdf_tree import mass_matrix


def with_passive_forces(
    chosen: Selection,
    links: Mapping[str, Link],
    order: Sequence[UrdfJoint],
    joints: Sequence[UrdfJoint],
    warnings: Remarks,
) -> tuple[UrdfJoint, ...]:
    """Return the joints with the stops that are wanted, and say what friction costs or is missed.

    `order` is that of `urdf_tree.from_the_base`.
    """
    coupled = couplings(joints)
    rough = [joint for joint in coupled.moving if joint.friction]
    if not chosen.friction_speed:
        for joint in rough:
            text = f"its dry friction of {joint.friction:g} is left out (--friction)"
            warnings.add(text, "joint", joint.name)
    if not (chosen.stop_frequency or (chosen.friction_speed and rough)):
        return tuple(joints)
    masses = [mass_matrix(links, order, coupled, q)[0] for q in postures(coupled)]
    inverses = [np.linalg.pinv(mass, hermitian=True) for mass in masses]
    if chosen.friction_speed and rough:
        slopes = [joint.friction / chosen.friction_speed for joint in coupled.moving]
        damping = coupled.G.T @ np.diag(slopes) @ coupled.G
        rate = max(np.abs(np.linalg.eigvals(inverse @ damping)).max() for inverse in inverses)
        warnings.add(
            f"dry friction over {chosen.friction_speed:g} rad/s or m/s damps what nearly rests at "
            f"up to {rate:.2g} per s, and what follows that takes as short steps"
        )
    if not chosen.stop_frequency:
        return tuple(joints)
    mobility = np.max([np.diag(coupled.G @ inverse @ coupled.G.T) for inverse in inverses], axis=0)
    stiffness = {}
    for joint, ease in zip(coupled.moving, mobility, strict=True):
        ends = joint.limits.lower, joint.limits.upper
        if ends[0] == ends[1] or (np.isinf(ends).all() and joint.kind != "continuous"):
            warnings.add("has no limits that differ, and so no stops", "joint", joint.name)
        elif np.isfinite(ends).any() and ease > 0.0:
            own = (2 * np.pi * chosen.stop_frequency) ** 2 / ease
            stiffness[joint.name] = float(f"{own:.12g}")
    return tuple(replace(joint, stop=stiffness.get(joint.name, 0.0)) for joint in joints)
