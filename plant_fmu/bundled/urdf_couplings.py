"""Joints that mimic others: with q those that move by themselves, all that move are at G q + o.

So are their rates at G q̇, and what the joints feel reaches q by Gᵀ (virtual power).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nrs_cosim.bus.text import nearest, quoted
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import Array, UrdfJoint


@dataclass(frozen=True, slots=True)
class Couplings:
    """The moving joints in the file's order, and of what they are functions."""

    moving: tuple[UrdfJoint, ...]
    G: Array
    """(joints that move, joints that move by themselves)"""
    offset: Array
    """(joints that move,) rad or m"""


def couplings(joints: Sequence[UrdfJoint]) -> Couplings:
    """Return how joints move whose mimics `judge_mimics` has found nothing wrong of."""
    moving = tuple(joint for joint in joints if joint.kind != "fixed")
    number = {joint.name: k for k, joint in enumerate(j for j in moving if j.mimic is None)}
    by_name = {joint.name: joint for joint in moving}
    G, offset = np.zeros((len(moving), len(number))), np.zeros(len(moving))
    for k, joint in enumerate(moving):
        factor, leader = 1.0, joint
        while leader.mimic is not None:
            offset[k] += factor * leader.mimic.offset
            factor *= leader.mimic.multiplier
            leader = by_name[leader.mimic.leader]
        G[k, number[leader.name]] = factor
    return Couplings(moving, G, offset)


def judge_mimics(joints: Sequence[UrdfJoint], faults: Remarks) -> bool:
    """Say which joints mimic none that there is, or themselves in the end; whether all is well.

    It is not where one is left that mimics a fixed joint, for that one was at fault itself.
    """
    by_name = {joint.name: joint for joint in joints}
    well = True
    for joint in joints:
        if joint.mimic is None:
            continue
        if joint.mimic.leader not in by_name:
            leader = joint.mimic.leader
            text = f"<mimic>: there is no joint {quoted(leader)}{nearest(leader, list(by_name))}"
            faults.add(text, "joint", joint.name)
            well = False
        elif by_name[joint.mimic.leader].kind == "fixed":
            well = False
        elif _circles(joint, by_name):
            faults.add(
                "<mimic>: it follows itself; expected one joint that leads", "joint", joint.name
            )
            well = False
    return well


def _circles(joint: UrdfJoint, by_name: Mapping[str, UrdfJoint]) -> bool:
    seen: set[str] = set()
    at: UrdfJoint | None = joint
    while at is not None and at.mimic is not None:
        if at.name in seen:
            return True
        seen.add(at.name)
        at = by_name.get(at.mimic.leader)
    return False
