"""M(q) qdd + h(q, qd) = force - D qd of a tree of joints with a fixed base, as C that gives qdd.

M is adam's composite rigid body algorithm, h (Coriolis, centrifugal, gravity) its recursive
Newton-Euler algorithm, and D the joints' damping. CasADi factors M = L E L^T symbolically,
E diagonal, and writes qdd as straight-line code without state, tables or branches.

What adam 0.5 has wrong of a prismatic joint is put right here, and random trees of all joints are
compared with another library in the tests.
"""

from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import casadi
import numpy as np
from adam.casadi.casadi_like import CasadiLike, SpatialMath
from adam.core.rbd_algorithms import RBDAlgorithms
from adam.model import Model
from adam.model.std_factories.std_joint import StdJoint
from adam.model.std_factories.std_model import URDFModelFactory

from nrs_cosim.plant_fmu.bundled.urdf_robot import Pose, Three, UrdfRobot

_CODE: dict[str, bool | str] = {
    "main": False,
    "mex": False,
    "with_header": False,
    "with_export": False,
    "verbose": False,
    "casadi_int": "int",
}
_HEADER = """\
/* The signature that CasADi gives every function has a workspace that this one does not need. */
#pragma GCC diagnostic ignored "-Wunused-parameter"

"""


def accelerations(robot: UrdfRobot, gravity: Three) -> casadi.Function:
    """`forward_dynamics`: (q, qd, force) to qdd, (m,); gravity is in m/s2, in the base's frame."""
    axes = robot.axes
    q, qd, force = (casadi.SX.sym(name, len(axes)) for name in ("q", "qd", "force"))
    damping = casadi.DM([joint.damping for joint in axes])
    mass, bias = _equations_of_motion(robot, gravity, q, qd)
    qdd = casadi.ldl_solve(force - damping * qd - bias, *casadi.ldl(mass, False))
    return casadi.Function("forward_dynamics", [q, qd, force], [qdd], {"cse": True})


def c_code(equations: casadi.Function) -> str:
    """C of a function."""
    generator = casadi.CodeGenerator("dynamics.c", _CODE)
    generator.add(equations)
    return f"{_HEADER}{generator.dump()}\n"


def _equations_of_motion(
    robot: UrdfRobot, gravity: Three, q: casadi.SX, qd: casadi.SX
) -> tuple[casadi.SX, casadi.SX]:
    """M (m, m) and h (m): adam's, for a base that floats, without the base's six rows."""
    maths = _Maths()
    names = [joint.name for joint in robot.axes]
    model = Model.build(_Factory(path=_plain(robot), math=maths), joints_name_list=names)
    algorithms = RBDAlgorithms(model, maths)
    base, at_rest = casadi.SX.eye(4), np.zeros(6)
    mass, _ = algorithms.crba(base, q)
    bias = algorithms.rnea(base, q, at_rest, qd, np.array([*gravity, 0.0, 0.0, 0.0]))
    return mass.array[6:, 6:], bias.array[6:]


class _Maths(SpatialMath):  # type: ignore[misc]
    """adam's, but for two things.

    A prismatic joint slides along R axis in its parent's frame, where adam 0.5 has the axis
    without R; and cos(pi/2) is 0 and not 6e-17, which halves the code of most arms.
    """

    def H_prismatic_joint(  # noqa: N802
        self, xyz: CasadiLike, rpy: CasadiLike, axis: CasadiLike, q: CasadiLike
    ) -> CasadiLike:
        R = self.R_from_RPY(rpy)
        return self.homogeneous(R, xyz + R @ (q * axis))

    def R_from_RPY(self, rpy: CasadiLike) -> CasadiLike:  # noqa: N802
        rotation = np.array(casadi.DM(super().R_from_RPY(rpy).array))
        whole = np.round(rotation)
        return CasadiLike(casadi.SX(np.where(np.abs(rotation - whole) < 1e-15, whole, rotation)))


class _Joint(StdJoint):  # type: ignore[misc]
    """adam's, but for the twist of a prismatic joint, to which adam 0.5 gives 12 rows for 6."""

    def motion_subspace(self) -> CasadiLike:
        if self.type != "prismatic":
            return super().motion_subspace()
        return self.math.vertcat(self.axis, self.math.zeros(3, 1))


class _Factory(URDFModelFactory):  # type: ignore[misc]
    def build_joint(self, joint: Any) -> _Joint:
        return _Joint(joint, self.math)


def _plain(robot: UrdfRobot) -> str:
    """The robot as a URDF in which all that adam reads is there, and nothing else."""
    root = Element("robot", name=robot.name)
    for link in robot.links:
        inertial = SubElement(SubElement(root, "link", name=link.name), "inertial")
        _origin(inertial, link.inertial.origin)
        SubElement(inertial, "mass", value=repr(link.inertial.mass))
        inertia = link.inertial.inertia
        entries = {
            f"i{a}{b}": repr(inertia[i][j])
            for i, a in enumerate("xyz")
            for j, b in enumerate("xyz")
            if i <= j
        }
        SubElement(inertial, "inertia", entries)
    for joint in robot.joints:
        element = SubElement(root, "joint", name=joint.name, type=joint.kind)
        SubElement(element, "parent", link=joint.parent)
        SubElement(element, "child", link=joint.child)
        _origin(element, joint.origin)
        SubElement(element, "axis", xyz=_text(joint.axis))
    return tostring(root, encoding="unicode")


def _origin(element: Element, pose: Pose) -> None:
    SubElement(element, "origin", xyz=_text(pose.xyz), rpy=_text(pose.rpy))


def _text(numbers: Three) -> str:
    return " ".join(map(repr, numbers))
