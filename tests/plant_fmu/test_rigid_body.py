"""The equations of random trees against Pinocchio, and of a turning slider in closed form."""

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
from nrs_cosim.plant_fmu.bundled.urdf_couplings import couplings
from nrs_cosim.plant_fmu.bundled.urdf_fmu import GRAVITY, build_urdf
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import UrdfRobot
from nrs_cosim.plant_fmu.bundled.urdf_tree import from_the_base, mass_matrix
from tests.plant_fmu.equations import Equations
from tests.plant_fmu.pinocchio_reference import Reference
from tests.plant_fmu.random_robots import KINDS, MOST_JOINTS, RandomRobot, random_robot

TREES, STATES = 220, 3
TOLERANCE = 1e-12
"""Relative: of the largest acceleration."""


@pytest.fixture(scope="module", autouse=True)
def _extra() -> None:
    pytest.importorskip(
        "nrs_cosim.plant_fmu.bundled.rigid_body", reason="needs the packages of the extra urdf"
    )


@pytest.fixture(scope="module")
def pinocchio():
    return pytest.importorskip("pinocchio", reason="needs the package pin, of the extra test")


@pytest.fixture(scope="module")
def robots() -> list[RandomRobot]:
    return [random_robot(seed) for seed in range(TREES)]


def reference_of(pinocchio, robot: RandomRobot, gravity) -> Reference:
    names = [joint.name for joint in robot.moving]
    damping = np.array([joint.damping for joint in robot.moving])
    return Reference(pinocchio.buildModelFromXML(robot.urdf), names, gravity, damping)


def read(robot: RandomRobot, folder: Path) -> UrdfRobot:
    path = folder / "drawn.urdf"
    path.write_text(robot.urdf, "utf-8")
    return read_urdf(path)


def states(m: int, seed: int) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    random = np.random.default_rng((14, seed))
    for _ in range(STATES):
        yield random.uniform(-3, 3, m), random.uniform(-2, 2, m), random.uniform(-20, 20, m)


def test_accelerations_of_random_trees_agree_with_another_library(pinocchio, robots, tmp_path):
    from nrs_cosim.plant_fmu.bundled.rigid_body import accelerations  # noqa: PLC0415

    wrong = []
    for seed, robot in enumerate(robots):
        gravity = tuple(np.random.default_rng((15, seed)).uniform(-10, 10, 3))
        reference = reference_of(pinocchio, robot, gravity)
        equations = accelerations(read(robot, tmp_path), gravity)
        for q, qd, force in states(len(robot.moving), seed):
            wanted = reference.acceleration(q, qd, force)
            found = np.array(equations(q, qd, force)).ravel()
            error = np.abs(found - wanted).max() / np.abs(wanted).max()
            if not error <= TOLERANCE:
                wrong.append((seed, error))
    assert not wrong


def test_mass_matrices_of_random_trees_agree_with_another_library(pinocchio, robots, tmp_path):
    """That which tells whether a URDF has inertias enough."""
    for seed, drawn in enumerate(robots):
        robot = read(drawn, tmp_path)
        links = {link.name: link for link in robot.links}
        order = from_the_base(links, robot.joints, Remarks())
        reference = reference_of(pinocchio, drawn, GRAVITY)
        for q, _, _ in states(len(robot.axes), seed):
            found, largest = mass_matrix(links, order, couplings(robot.joints), q)
            wanted = reference.mass(q)
            assert np.abs(found - wanted).max() <= 1e-13 * np.abs(wanted).max()
            assert (np.diag(found) <= largest * (1 + 1e-13)).all()


def test_random_trees_cover_all_kinds_of_joints(robots):
    joints = [joint for robot in robots for joint in robot.joints]
    places, yes_no = ("base", "welded", "moving"), (False, True)
    seen = {(j.kind, j.rotated, j.on) for j in joints}
    assert seen == set(product(KINDS, yes_no, places))
    moving = [joint for joint in joints if joint.on == "moving"]
    for other in ("damped", "branches"):
        seen = {(j.kind, j.rotated, j.oblique, getattr(j, other)) for j in moving}
        assert seen == set(product(KINDS, yes_no, yes_no, yes_no))
    assert {len(robot.moving) for robot in robots} == set(range(1, MOST_JOINTS + 1))


def test_compiled_trees_agree_with_their_equations(robots, tmp_path):
    """C agrees with the function that it is generated from, for both versions of FMI."""
    from nrs_cosim.plant_fmu.bundled.rigid_body import accelerations  # noqa: PLC0415

    sliding = [
        k
        for k, robot in enumerate(robots)
        if any(j.kind == "prismatic" and j.rotated and j.on == "moving" for j in robot.joints)
    ]
    for seed, fmi in zip(sliding, (3, 2, 3), strict=False):
        robot = read(robots[seed], tmp_path)
        function = accelerations(robot, GRAVITY)
        fmu = Equations(build_urdf(robot, fmi), tmp_path / str(seed))
        for q, qd, force in states(len(robot.axes), seed):
            wanted = np.array(function(q, qd, force)).ravel()
            error = np.abs(fmu.acceleration(q, qd, force) - wanted).max()
            assert error <= 1e-14 * np.abs(wanted).max()
        fmu.fmu.freeInstance()


BODY = (
    '<inertial><mass value="{0}"/>'
    '<inertia ixx="{1}" ixy="0" ixz="0" iyy="{1}" iyz="0" izz="{1}"/></inertial>'
)
UNIVERSAL_JOINT = (
    '<robot name="rod"><link name="base"/><link name="cross"/>'
    '<link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="2"/>'
    '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>'
    '<joint name="x" type="continuous"><parent link="base"/><child link="cross"/>'
    '<axis xyz="1 0 0"/></joint><joint name="y" type="continuous"><parent link="cross"/>'
    '<child link="rod"/><axis xyz="0 1 0"/></joint></robot>'
)


def test_a_rod_on_a_massless_cross_agrees_with_the_closed_form(tmp_path):
    """Of kinetic energy T = (J x'^2 + I y'^2)/2, J = 0.1 + 0.5 cos^2 y, I = 0.6, without gravity.

    Then J x" = tau1 + sin y cos y x' y', I y" = tau2 - sin y cos y x'^2 / 2.
    """
    from nrs_cosim.plant_fmu.bundled.rigid_body import accelerations  # noqa: PLC0415

    path = tmp_path / "rod.urdf"
    path.write_text(UNIVERSAL_JOINT, "utf-8")
    equations = accelerations(read_urdf(path), (0.0, 0.0, 0.0))
    for q, qd, tau in states(2, 1):
        both = np.sin(q[1]) * np.cos(q[1])
        x = (tau[0] + both * qd[0] * qd[1]) / (0.1 + 0.5 * np.cos(q[1]) ** 2)
        wanted = [x, (tau[1] - both * qd[0] ** 2 / 2) / 0.6]
        np.testing.assert_allclose(np.array(equations(q, qd, tau)).ravel(), wanted, rtol=1e-12)


TURNING_SLIDER = (
    '<robot name="turning slider"><link name="base"/>'
    f'<link name="turn">{BODY.format(1, 0.5)}</link><link name="slide">{BODY.format(2, 0.1)}</link>'
    '<joint name="a" type="revolute"><parent link="base"/><child link="turn"/>'
    '<axis xyz="0 0 1"/></joint>'
    '<joint name="b" type="prismatic"><parent link="turn"/><child link="slide"/>'
    '<origin xyz="1 0 0" rpy="{}"/><axis xyz="{}"/></joint></robot>'
)


@pytest.mark.parametrize(
    ("rpy", "axis"),
    [("0 0 0", "1 0 0"), (f"0 {np.pi / 2} 0", "0 0 1"), (f"0 0 {np.pi / 2}", "0 -1 0")],
)
def test_a_slider_on_a_turning_link_agrees_with_the_closed_form(tmp_path, rpy, axis):
    """Spellings of one robot: whatever the slider's frame, it slides along the link's x axis.

    With r = 1 + q2 and I = 0.6 + 2 r^2, qdd1 = (tau1 - 4 r qd1 qd2) / I, qdd2 = tau2/2 + r qd1^2.
    """
    from nrs_cosim.plant_fmu.bundled.rigid_body import accelerations  # noqa: PLC0415

    path = tmp_path / "slider.urdf"
    path.write_text(TURNING_SLIDER.format(rpy, axis), "utf-8")
    equations = accelerations(read_urdf(path), (0.0, 0.0, 0.0))
    for q, qd, tau in [([0.3, 0.5], [2.0, 0.7], [0.0, 0.0]), *states(2, 0)]:
        r = 1 + q[1]
        turning = (tau[0] - 4 * r * qd[0] * qd[1]) / (0.6 + 2 * r**2)
        wanted = [turning, tau[1] / 2 + r * qd[0] ** 2]
        found = np.array(equations(q, qd, tau)).ravel()
        np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-14)
