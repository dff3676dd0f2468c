"""A robot of a URDF file by Newton and Euler, in numpy and in world axes, against its FMU."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nrs_cosim.plant_fmu.bundled.urdf_fmu import GRAVITY

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Moved:
    """A frame in the world: rotation, origin, angular velocity and rate, acceleration of origin."""

    R: Array
    p: Array
    w: Array
    wd: Array
    a: Array


class Oracle:
    """Newton and Euler for each link of a URDF; joint forces by virtual power."""

    def __init__(self, path: Path) -> None:
        root = ElementTree.parse(path).getroot()
        self.joints = root.findall("joint")
        self.axes = [j.get("name") for j in self.joints if j.get("type") != "fixed"]
        self.links = {link.get("name"): link for link in root.findall("link")}
        self.damping = np.array(
            [
                0.0 if (d := j.find("dynamics")) is None else float(d.get("damping", "0"))
                for j in self.joints
                if j.get("type") != "fixed"
            ]
        )

    def force(self, q: Array, qd: Array, qdd: Array, gravity: Sequence[float] = GRAVITY) -> Array:
        """The joint forces without damping that give qdd: recursive Newton-Euler."""
        frames = self._frames(q, qd, qdd, gravity)
        force = np.zeros(len(self.axes))
        for link in self.links:
            moved = frames[link]
            mass, c, inertia = self._inertial(link, moved.R)
            if mass == 0.0:
                continue
            f = mass * (moved.a + cross(moved.wd, c) + cross(moved.w, cross(moved.w, c)))
            n = inertia @ moved.wd + cross(moved.w, inertia @ moved.w)
            for joint in self._towards_the_base(link):
                if joint.get("type") == "fixed":
                    continue
                at = frames[joint.find("child").get("link")]
                z = at.R @ unit(joint.find("axis").get("xyz"))
                slides = joint.get("type") == "prismatic"
                i = self.axes.index(joint.get("name"))
                force[i] += z @ (f if slides else n + cross(moved.p + c - at.p, f))
        return force

    def mass_matrix(self, q: Array) -> Array:
        zero = np.zeros(len(q))
        return np.column_stack([self.force(q, zero, e, (0, 0, 0)) for e in np.eye(len(q))])

    def acceleration(self, q: Array, qd: Array, tau: Array, gravity: Any = GRAVITY) -> Array:
        bias = self.force(q, qd, np.zeros(len(q)), gravity)
        return np.linalg.solve(self.mass_matrix(q), tau - self.damping * qd - bias)

    def energy(self, q: Array, qd: Array) -> float:
        zero = np.zeros(len(q))
        frames = self._frames(q, zero, zero, (0, 0, 0))
        potential = 0.0
        for link in self.links:
            mass, c, _ = self._inertial(link, frames[link].R)
            potential -= mass * np.array(GRAVITY) @ (frames[link].p + c)
        return float(qd @ self.mass_matrix(q) @ qd / 2 + potential)

    def _towards_the_base(self, link: str | None) -> Iterator[Any]:
        while joint := next((j for j in self.joints if j.find("child").get("link") == link), None):
            yield joint
            link = joint.find("parent").get("link")

    def _frames(self, q: Array, qd: Array, qdd: Array, gravity: Any) -> dict[Any, Moved]:
        still = Moved(np.eye(3), *np.zeros((3, 3)), -np.array(gravity, float))

        @cache
        def frame(link: str) -> Moved:
            joint = next(self._towards_the_base(link), None)
            if joint is None:
                return still
            up = frame(joint.find("parent").get("link"))
            R0, p0 = pose(joint.find("origin"))
            R, r = up.R @ R0, up.R @ p0
            turn, slide, w, wd, extra = np.eye(3), np.zeros(3), up.w, up.wd, np.zeros(3)
            if joint.get("type") != "fixed":
                i, axis = self.axes.index(joint.get("name")), unit(joint.find("axis").get("xyz"))
                z = R @ axis
                if joint.get("type") == "prismatic":
                    slide = q[i] * z
                    extra = 2 * cross(up.w, z * qd[i]) + z * qdd[i]
                else:
                    turn = Rotation.from_rotvec(q[i] * axis).as_matrix()
                    w = up.w + z * qd[i]
                    wd = up.wd + cross(up.w, z * qd[i]) + z * qdd[i]
            r = r + slide
            a = up.a + cross(up.wd, r) + cross(up.w, cross(up.w, r)) + extra
            return Moved(R @ turn, up.p + r, w, wd, a)

        return {link: frame(link) for link in self.links}

    def _inertial(self, link: Any, R: Array) -> tuple[float, Array, Array]:
        inertial = self.links[link].find("inertial")
        if inertial is None:
            return 0.0, np.zeros(3), np.zeros((3, 3))
        i = {key: float(value) for key, value in inertial.find("inertia").items()}
        about = np.array(
            [
                [i["ixx"], i["ixy"], i["ixz"]],
                [i["ixy"], i["iyy"], i["iyz"]],
                [i["ixz"], i["iyz"], i["izz"]],
            ]
        )
        R0, c = pose(inertial.find("origin"))
        return (
            float(inertial.find("mass").get("value")),
            R @ c,
            R @ R0 @ about @ R0.T @ R.T,
        )


def cross(a: Array, b: Array) -> Array:
    return np.cross(a, b)


def numbers(text: str) -> Array:
    return np.array(text.split(), float)


def unit(text: str) -> Array:
    return numbers(text) / np.linalg.norm(numbers(text))


def pose(origin: Any) -> tuple[Array, Array]:
    if origin is None:
        return np.eye(3), np.zeros(3)
    roll, pitch, yaw = numbers(origin.get("rpy", "0 0 0"))
    turns = Rotation.from_rotvec([[0, 0, yaw], [0, pitch, 0], [roll, 0, 0]]).as_matrix()
    return turns[0] @ turns[1] @ turns[2], numbers(origin.get("xyz", "0 0 0"))
