"""Robots drawn at random, as URDF: trees of all kinds of joints, frames, axes and inertias.

Each property of a joint is drawn by itself, so that all their combinations come up.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

KINDS = ("revolute", "continuous", "prismatic", "fixed")
MOST_JOINTS = 7


@dataclass(frozen=True)
class DrawnJoint:
    """What was drawn of a joint, to be counted."""

    name: str
    kind: str
    rotated: bool
    oblique: bool
    damped: bool
    on: str
    """What is between its parent link and the base: nothing, a welded link, or a moving one."""
    branches: bool
    """Whether its parent link had a child already."""
    damping: float


@dataclass(frozen=True)
class RandomRobot:
    """A URDF, and what was drawn of its joints in the file's order."""

    urdf: str
    joints: tuple[DrawnJoint, ...]

    @property
    def moving(self) -> list[DrawnJoint]:
        return [joint for joint in self.joints if joint.kind != "fixed"]


def random_robot(seed: int) -> RandomRobot:
    """Draw a tree of up to MOST_JOINTS joints, of which at least one moves."""
    random = np.random.default_rng((2024, seed))
    links, joints = ['<link name="base"/>'], []
    elements, place, parents = [], {"base": "base"}, []
    count = random.integers(1, MOST_JOINTS + 1)
    for k in range(count):
        last_chance = k == count - 1 and all(joint.kind == "fixed" for joint in joints)
        kind = str(random.choice(KINDS[:-1] if last_chance else KINDS))
        near = random.random() < 0.3  # the newest link: chains, not only bushes
        parent = list(place)[-1] if near else str(random.choice(list(place)))
        rotated, oblique, damped = (bool(b) for b in random.random(3) < (0.5, 0.5, 0.5))
        damping = random.uniform(0.1, 2.0) if damped and kind != "fixed" else 0.0
        name, child = f"joint {k}", f"link {k}"
        joints.append(
            DrawnJoint(
                name, kind, rotated, oblique, damped, place[parent], parent in parents, damping
            )
        )
        parents.append(parent)
        if kind != "fixed":
            place[child] = "moving"
        else:
            place[child] = "moving" if place[parent] == "moving" else "welded"
        axis = random.normal(size=3) if oblique else random.choice([-1, 1]) * np.eye(3)[k % 3]
        rpy = random.uniform(-3, 3, 3) if rotated else np.zeros(3)
        elements.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{words(random.uniform(-0.7, 0.7, 3))}" rpy="{words(rpy)}"/>'
            f'<axis xyz="{words(axis)}"/><dynamics damping="{damping!r}"/>'
            '<limit lower="-9" upper="9" effort="9" velocity="9"/></joint>'
        )
        # A joint that moves has a link with mass; of links that are fixed, some are mere frames.
        frame = kind == "fixed" and random.random() < 0.5
        links.append(f'<link name="{child}">{"" if frame else inertial(random)}</link>')
    order = random.permutation(len(elements))
    text = "".join(links) + "".join(elements[i] for i in order)
    return RandomRobot(f'<robot name="drawn">{text}</robot>', tuple(joints[i] for i in order))


def inertial(random: np.random.Generator) -> str:
    """Six masses on three axes: their moments are those of a body that can be."""
    mass, arms = random.uniform(0.5, 3.0), random.uniform(0.05, 0.4, 3) ** 2
    moments = mass * np.diag(arms.sum() - arms)
    if random.random() < 0.5:
        turned = Rotation.random(random_state=random).as_matrix()
        moments = turned @ moments @ turned.T
    rpy = random.uniform(-3, 3, 3) if random.random() < 0.5 else np.zeros(3)
    entries = " ".join(
        f'i{"xyz"[i]}{"xyz"[j]}="{float(moments[i, j])!r}"' for i in range(3) for j in range(i, 3)
    )
    return (
        f'<inertial><origin xyz="{words(random.uniform(-0.4, 0.4, 3))}" rpy="{words(rpy)}"/>'
        f'<mass value="{mass!r}"/><inertia {entries}/></inertial>'
    )


def words(numbers: np.ndarray) -> str:
    return " ".join(repr(float(number)) for number in numbers)
