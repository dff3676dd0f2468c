"""A URDF file becomes a robot, or all that is wrong of the file is said in one message.

The file is read as leniently as others read it, with warnings, wherever the dynamics are the same;
nothing that they depend on is guessed.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.bundled.urdf_couplings import couplings, judge_mimics
from nrs_cosim.plant_fmu.bundled.urdf_elements import (
    named_elements,
    read_joint,
    read_link,
    writable,
)
from nrs_cosim.plant_fmu.bundled.urdf_inertia import SOME_INERTIA, judge_inertias
from nrs_cosim.plant_fmu.bundled.urdf_passive import with_passive_forces
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import Inertial, UrdfJoint, UrdfRobot
from nrs_cosim.plant_fmu.bundled.urdf_rotors import reflected_inertias
from nrs_cosim.plant_fmu.bundled.urdf_selection import FREE, Selection, select
from nrs_cosim.plant_fmu.bundled.urdf_text import kept_text
from nrs_cosim.plant_fmu.bundled.urdf_tree import from_the_base, moving_links
from nrs_cosim.plant_fmu.bundled.urdf_xacro import expect_expanded
from nrs_cosim.plant_fmu.bundled.urdf_xml import Element, read_xml
from nrs_cosim.plant_fmu.errors import FmuError

ALL = Selection()


def read_urdf(path: Path, chosen: Selection = ALL) -> UrdfRobot:
    """Read and check a URDF file; `FmuError` names the file, the elements and what to do."""
    faults, warnings = Remarks(), Remarks()
    try:
        root = _root(path, warnings)
    except FmuError as error:
        raise FmuError(f"{path}: {error}") from None
    robot = _robot(root, path.stem, chosen, faults, warnings)
    if faults:
        raise FmuError("\n".join(f"{path}: {line}" for line in faults.lines()))
    text = kept_text(root, robot, warnings)
    return replace(robot, warnings=warnings.lines(), text=text)


def _root(path: Path, warnings: Remarks) -> Element:
    root = read_xml(path, warnings)
    if root.tag != "robot":
        raise FmuError(f"has no <robot>: its root is <{root.tag}>")
    expect_expanded(root, warnings)
    return root


def _robot(
    root: Element, stem: str, chosen: Selection, faults: Remarks, warnings: Remarks
) -> UrdfRobot:
    name = _name(root, stem, faults, warnings)
    unnamed = Remarks()
    read = [read_link(name, element) for name, element in named_elements(root, "link", unnamed)]
    links = {link.name: link for link, _ in read}
    joints = tuple(
        read_joint(name, element, links, faults, warnings)
        for name, element in named_elements(root, "joint", unnamed)
    )
    faults.take(unnamed)
    rotors = reflected_inertias(root, {joint.name: joint for joint in joints}, faults, warnings)
    joints = select(chosen, links, joints, faults, warnings)
    joints = tuple(_to_move(joint, rotors, faults) for joint in joints)
    if all(joint.kind == "fixed" for joint in joints) and not faults:
        faults.add("has no moving joint; expected a revolute, continuous or prismatic one")
    moves, order = set(links), None
    if not unnamed and all({joint.parent, joint.child} <= links.keys() for joint in joints):
        order = from_the_base(links, joints, faults)
    if order is not None:
        moves = moving_links(order)
    for link, wrong in ((link, wrong) for link, wrong in read if link.name in links):
        if link.name in moves:
            faults.take(wrong)
        kept = (SOME_INERTIA if wrong else link.inertial) if link.name in moves else Inertial()
        links[link.name] = replace(link, inertial=kept)
    if judge_mimics(joints, faults) and order is not None:
        judge_inertias(links, order, couplings(joints), faults, warnings)
        if not faults:
            joints = with_passive_forces(chosen, links, order, joints, warnings)
    return UrdfRobot(name, tuple(links.values()), joints, chosen.friction_speed)


def _to_move(joint: UrdfJoint, rotors: Mapping[str, float], faults: Remarks) -> UrdfJoint:
    """Return a joint that is left as it moves, and as a fixed one where it cannot."""
    if joint.kind not in FREE:
        rotor = 0.0 if joint.kind == "fixed" else rotors.get(joint.name, 0.0)
        return replace(joint, rotor=rotor)
    faults.add(
        f"type {quoted(joint.kind)} is not supported, for the base is fixed; lock it (--lock), or "
        "begin at its child (--base-link)",
        "joint",
        joint.name,
    )
    return replace(joint, kind="fixed")


def _name(root: Element, stem: str, faults: Remarks, warnings: Remarks) -> str:
    name = str(root.get("name", "")).strip()
    if not name:
        name = stem if writable(stem) else "robot"
        warnings.add(f"its <robot> has no name; it is called {quoted(name)}")
    elif not writable(name):
        faults.add("a name is made of printable characters other than *", "robot", name)
    return name
