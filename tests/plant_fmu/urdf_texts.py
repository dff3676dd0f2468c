"""Robots of a few links, written as URDF, what they become, and states of theirs."""

import numpy as np

from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
from nrs_cosim.plant_fmu.bundled.urdf_fmu import GRAVITY
from nrs_cosim.plant_fmu.bundled.urdf_selection import Selection

NO_GRAVITY = (0.0, 0.0, 0.0)
LIMIT = '<limit lower="{}" upper="{}" effort="9" velocity="9"/>'
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def reader(folder):
    """Return what reads a text, with what is chosen of it."""

    def read(text, **chosen):
        path = folder / "robot.urdf"
        path.write_text(text, "utf-8")
        return read_urdf(path, Selection(**chosen))

    return read


def dynamics(robot, gravity=GRAVITY):
    """(q, qd, force) to qdd."""
    from nrs_cosim.plant_fmu.bundled.rigid_body import accelerations  # noqa: PLC0415

    function = accelerations(robot, gravity)
    return lambda q, qd, force: np.array(function(q, qd, force)).ravel()


def joint(name, parent, child, kind="revolute", more="", xyz="0.3 0 0.1", axis="0 1 0", limit=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{limit or LIMIT.format(-9, 9)}{more}</joint>'
    )


def link(name, mass=1.0):
    moments = " ".join(f'{i}="{0.1 * mass * (i[1] == i[2])}"' for i in MOMENTS)
    origin = '<origin xyz="0.1 0.05 0"/>'
    return (
        f'<link name="{name}"><inertial>{origin}<mass value="{mass}"/><inertia {moments}/>'
        "</inertial></link>"
    )


def robot(*elements):
    return f'<robot name="r"><link name="base"/>{"".join(elements)}</robot>'


def mimic(leader, multiplier, offset=0.0):
    return f'<mimic joint="{leader}" multiplier="{multiplier}" offset="{offset}"/>'


def states(m, seed, count=3):
    random = np.random.default_rng((19, seed))
    for _ in range(count):
        yield random.uniform(-2, 2, m), random.uniform(-2, 2, m), random.uniform(-20, 20, m)
