"""M(q) qdd + h(q, qd) = force + passive(q, qd) of a tree of joints, as C that gives qdd.

M is that of composite rigid bodies and h (Coriolis, centrifugal, gravity) of recursive Newton and
Euler (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapters 5 and 6), each in the axes of
`urdf_bodies`, whose joints turn or slide about z. CasADi factors M = L E L^T symbolically, E
diagonal, outer joints first, so that L has no more entries than M, and writes qdd as straight-line
code without state, tables or branches.

All joints that move are at Q = G q + o (`urdf_couplings`): with Mm and hm of Q,
M = G^T (Mm + rotors) G and h = G^T hm. What acts on joints by itself is G^T of

    -damping Q' - friction Q' / sqrt(Q'^2 + friction_speed^2)
    -stop max(Q - upper, 0) max(1 + Q'/REBOUND, 0) + stop max(lower - Q, 0) max(1 - Q'/REBOUND, 0),

of which the stops are Hunt and Crossley's (J. Appl. Mech. 42, 1975): a joint leaves one more slowly
than REBOUND, and is never held by it.
"""

from collections.abc import Sequence

import casadi
import numpy as np

from nrs_cosim.plant_fmu.bundled.urdf_bodies import RigidBody, bodies
from nrs_cosim.plant_fmu.bundled.urdf_couplings import couplings
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import Array, Three, UrdfRobot
from nrs_cosim.plant_fmu.bundled.urdf_tree import from_the_base

REBOUND = 0.5
"""rad/s or m/s"""
_CODE: dict[str, bool | str] = {
    "main": False,
    "mex": False,
    "with_header": False,
    "with_export": False,
    "verbose": False,
    "casadi_int": "int",
}
_HEADER = """\
/* sin and cos are ours: those of libraries differ in the last bit. */
#include <math.h>
#include "mathematics.h"
#define sin sine
#define cos cosine

/* The signature that CasADi gives every function has a workspace that this one does not need. */
#pragma GCC diagnostic ignored "-Wunused-parameter"

"""
_Z = casadi.SX([0, 0, 1])
_EYE = casadi.SX.eye(3)


def accelerations(robot: UrdfRobot, gravity: Three) -> casadi.Function:
    """`forward_dynamics`: (q, qd, force) to qdd, (m,); gravity is in m/s2, in the base's frame."""
    coupled = couplings(robot.joints)
    m = len(robot.axes)
    q, qd, force = (casadi.SX.sym(name, m) for name in ("q", "qd", "force"))
    G = _sparse(coupled.G)
    Q, Qd = G @ q + casadi.SX(coupled.offset), G @ qd
    tree = _Tree(robot, Q)
    rotors = casadi.diag(casadi.SX([joint.rotor for joint in coupled.moving]))
    mass = G.T @ (tree.mass() + rotors) @ G
    effort = force + G.T @ (_passive(robot, Q, Qd) - tree.bias(Qd, gravity))
    outer_first = tree.outer_first(coupled.G)
    L = casadi.ldl(casadi.sparsify(mass)[outer_first, outer_first], False)
    qdd = casadi.SX(m, 1)
    qdd[outer_first] = casadi.ldl_solve(effort[outer_first], *L)
    return casadi.Function("forward_dynamics", [q, qd, force], [qdd], {"cse": True})


def c_code(equations: casadi.Function) -> str:
    """C of a function."""
    generator = casadi.CodeGenerator("dynamics.c", _CODE)
    generator.add(equations)
    return f"{_HEADER}{generator.dump()}\n"


def _passive(robot: UrdfRobot, Q: casadi.SX, Qd: casadi.SX) -> casadi.SX:
    """Return what acts on the joints that move by itself, as the module says."""
    forces = []
    for joint, at, rate in zip(
        couplings(robot.joints).moving, casadi.vertsplit(Q), casadi.vertsplit(Qd), strict=True
    ):
        force = -joint.damping * rate
        if joint.friction and robot.friction_speed:
            force -= joint.friction * rate / casadi.sqrt(rate * rate + robot.friction_speed**2)
        for end, side in ((joint.limits.upper, 1), (joint.limits.lower, -1)):
            if joint.stop and np.isfinite(end):
                pressed = _positive(side * (at - end)) * _positive(1 + side * rate / REBOUND)
                force -= side * joint.stop * pressed
        forces.append(force)
    return casadi.vertcat(*forces)


def _positive(x: casadi.SX) -> casadi.SX:
    """max(x, 0) without a branch."""
    return (x + casadi.fabs(x)) / 2


def _sparse(numbers: Array) -> casadi.DM:
    """Constants, of whose zeros no code is made."""
    return casadi.sparsify(casadi.DM(numbers))


class _Tree:
    """The bodies of a robot with all that moves at Q; vectors are in the axes of their body."""

    def __init__(self, robot: UrdfRobot, Q: casadi.SX) -> None:
        links = {link.name: link for link in robot.links}
        order = from_the_base(links, robot.joints, Remarks())
        assert order is not None
        moving = [joint.name for joint in couplings(robot.joints).moving]
        self.bodies: list[RigidBody] = bodies(links, order)
        self.number = [moving.index(body.joint.name) for body in self.bodies]
        """Which of Q is the body's."""
        self.slides = [body.joint.kind == "prismatic" for body in self.bodies]
        self.R = [_sparse(body.R) for body in self.bodies]
        self.cos, self.sin, self.p = [], [], []
        for k, body in enumerate(self.bodies):
            at = Q[self.number[k]]
            self.cos.append(1 if self.slides[k] else casadi.cos(at))
            self.sin.append(0 if self.slides[k] else casadi.sin(at))
            p = casadi.SX(_sparse(body.p))
            self.p.append(p + self.R[k] @ _Z * at if self.slides[k] else p)

    def outer_first(self, G: Array) -> list[int]:
        """Return the order of q in which each that leads joints comes after those further out."""
        seen: dict[int, None] = {}
        for number in self.number:
            seen |= dict.fromkeys(np.flatnonzero(G[number]).tolist())
        missing = set(range(G.shape[1])) - seen.keys()
        return [*missing, *reversed(seen)]

    def up(self, k: int, v: casadi.SX) -> casadi.SX:
        """Turn a vector of body k into the axes of the one below."""
        c, s = self.cos[k], self.sin[k]
        return self.R[k] @ casadi.vertcat(c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])

    def down(self, k: int, v: casadi.SX) -> casadi.SX:
        """Turn a vector of the body below into the axes of k."""
        c, s, v = self.cos[k], self.sin[k], self.R[k].T @ v
        return casadi.vertcat(c * v[0] + s * v[1], c * v[1] - s * v[0], v[2])

    def bias(self, Qd: casadi.SX, gravity: Three) -> casadi.SX:
        """Return the forces that keep Q'' at 0 under gravity: recursive Newton and Euler.

        A point at r of a body has the acceleration a + U r, U = [w']x + [w]x [w]x.
        """
        motions: list[tuple[casadi.SX, ...]] = []
        wrenches: list[tuple[casadi.SX, casadi.SX]] = []
        for k, body in enumerate(self.bodies):
            w, wd, a, U = casadi.SX(3, 1), casadi.SX(3, 1), casadi.SX(-casadi.DM(gravity)), None
            if body.below >= 0:
                w, wd, a, U = motions[body.below]
                a += U @ self.p[k]
            w, wd, a = self.down(k, w), self.down(k, wd), self.down(k, a)
            turned = casadi.cross(w, _Z * Qd[self.number[k]])
            if self.slides[k]:
                a += 2 * turned
            else:
                wd, w = wd + turned, w + _Z * Qd[self.number[k]]
            U = casadi.skew(wd) + w @ w.T - casadi.dot(w, w) * _EYE
            motions.append((w, wd, a, U))
            h, inertia = _sparse(body.moment), _sparse(body.inertia)
            moment = inertia @ wd + casadi.cross(w, inertia @ w) + casadi.cross(h, a)
            wrenches.append((body.mass * a + U @ h, moment))
        forces = casadi.SX(len(self.bodies), 1)
        for k in reversed(range(len(self.bodies))):
            forces[self.number[k]] = self._along(k, wrenches[k])
            if (below := self.bodies[k].below) >= 0:
                force, moment = self._carried(k, wrenches[k])
                wrenches[below] = wrenches[below][0] + force, wrenches[below][1] + moment
        return forces

    def mass(self) -> casadi.SX:
        """Return M of Q, by composite rigid bodies; no entry where two joints share no body."""
        m = [body.mass for body in self.bodies]
        h = [casadi.SX(_sparse(body.moment)) for body in self.bodies]
        inertia = [casadi.SX(_sparse(body.inertia)) for body in self.bodies]
        mass = casadi.SX(len(m), len(m))
        for k in reversed(range(len(m))):
            turned = casadi.cross(_Z, h[k])
            wrench = (m[k] * _Z, -turned) if self.slides[k] else (turned, inertia[k][:, 2])
            j = k
            while True:
                i, kth = self.number[j], self.number[k]
                mass[i, kth] = mass[kth, i] = self._along(j, wrench)
                if self.bodies[j].below < 0:
                    break
                wrench, j = self._carried(j, wrench), self.bodies[j].below
            if (below := self.bodies[k].below) >= 0:
                p, moment = self.p[k], self.up(k, h[k])
                inertia[below] += self._inertia_up(k, inertia[k], moment, m[k])
                h[below] += moment + m[k] * p
                m[below] += m[k]
        return mass

    def _along(self, k: int, wrench: Sequence[casadi.SX]) -> casadi.SX:
        """Return what the joint k feels of a force and a moment about its origin."""
        force, moment = wrench
        return force[2] if self.slides[k] else moment[2]

    def _carried(self, k: int, wrench: Sequence[casadi.SX]) -> tuple[casadi.SX, casadi.SX]:
        """Return a force and a moment on body k as one of the body below."""
        force, moment = (self.up(k, part) for part in wrench)
        return force, moment + casadi.cross(self.p[k], force)

    def _inertia_up(self, k: int, own: casadi.SX, h: casadi.SX, m: float) -> casadi.SX:
        """Return an inertia about k's origin as one about that below; h is in the axes there.

        R I R^T + 2 (p.h) 1 - p h^T - h p^T + m ((p.p) 1 - p p^T)
        """
        c, s, p = self.cos[k], self.sin[k], self.p[k]
        change = s * s * (own[1, 1] - own[0, 0]) - 2 * c * s * own[0, 1]
        xx, yy, zz = own[0, 0] + change, own[1, 1] - change, own[2, 2]
        xy = c * s * (own[0, 0] - own[1, 1]) + (c * c - s * s) * own[0, 1]
        xz, yz = c * own[0, 2] - s * own[1, 2], s * own[0, 2] + c * own[1, 2]
        rows = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
        turned = casadi.vertcat(*(casadi.horzcat(*row) for row in rows))
        ph = p @ h.T
        about = self.R[k] @ turned @ self.R[k].T + 2 * casadi.trace(ph) * _EYE - ph - ph.T
        return casadi.triu2symm(casadi.triu(about + m * (casadi.dot(p, p) * _EYE - p @ p.T)))
