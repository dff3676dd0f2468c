"""A robot read from URDF becomes an FMU like a bundled one: the same interface, core and builder.

Its equations are generated, and need the packages of the extra `urdf`.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from nrs_cosim.plant_fmu.bundled.builder import build_model
from nrs_cosim.plant_fmu.bundled.declaration import MODELS, Declaration, declare
from nrs_cosim.plant_fmu.bundled.urdf_robot import Three, UrdfRobot
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.joints import JOINTS, Joint, write_joints

GRAVITY: Three = (0.0, 0.0, -9.80665)
"""m/s2, in the frame of the base link."""
Begin = Callable[[str], None]
"""What is told of a stage of the work as it begins."""


def build_urdf(
    robot: UrdfRobot, fmi: int = 3, gravity: Three = GRAVITY, begin: Begin = lambda _: None
) -> Path:
    """The FMU of a robot for FMI 2 or 3, kept where `build` keeps those of bundled models.

    `begin` is told what is done next. `FmuError` says which packages or which compiler is missing.
    """
    try:
        from nrs_cosim.plant_fmu.bundled.rigid_body import accelerations, c_code  # noqa: PLC0415
    except ImportError as error:
        raise FmuError(
            f"the packages that generate the dynamics of a URDF are not installed ({error}): "
            "pip install '.[urdf]' in nrs-cosim's sources"
        ) from None
    begin("equations of motion")
    function = accelerations(robot, gravity)
    begin("C code")
    equations = {
        "model.c": (MODELS / "rigid_body" / "model.c").read_bytes(),
        "dynamics.c": c_code(function).encode(),
    }
    begin("compiling")
    joints = [Joint(j.name, "m" if j.kind == "prismatic" else "rad") for j in robot.axes]
    return build_model(_declaration(robot, gravity), equations, fmi, {JOINTS: write_joints(joints)})


def _declaration(robot: UrdfRobot, gravity: Three) -> Declaration:
    """As of a bundled robot, with the joints' names where a variable has a number for each."""
    m = len(robot.axes)
    own = {
        "description": (
            f"Rigid-body dynamics of {robot.name} from its URDF, base fixed, gravity "
            f"({', '.join(f'{g:g}' for g in gravity)}) m/s2; joint limits and dry friction are "
            "left out"
        ),
        "dimensions": {"m": m},
        "units": _units(robot),
        "variables": {},
    }
    plain = declare(_identifier(robot.name), own)
    names = ", ".join(joint.name for joint in robot.axes)
    variables = (
        replace(v, description=f"{v.description} ({names})") if v.shape == (m,) else v
        for v in plain.variables
    )
    return replace(plain, variables=tuple(variables))


def _units(robot: UrdfRobot) -> dict[str, Any]:
    """None where some joints turn and some slide: an array has one unit for all its numbers."""
    slides = {joint.kind == "prismatic" for joint in robot.axes}
    if slides == {True}:
        return {"coordinate": "m", "effort": "N"}
    return {"coordinate": "rad", "effort": "N.m"} if slides == {False} else {}


def _identifier(name: str) -> str:
    """The model identifier of FMI, which is a C identifier and names the binary."""
    word = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
    return word if re.match("[A-Za-z]", word) else f"robot_{word}".rstrip("_")
