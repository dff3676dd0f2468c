"""What is taken of a URDF: joints that mimic others, locked joints, and chains."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
from nrs_cosim.plant_fmu.bundled.urdf_couplings import couplings
from nrs_cosim.plant_fmu.bundled.urdf_fmu import GRAVITY, build_urdf
from nrs_cosim.plant_fmu.bundled.urdf_selection import Selection
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.recordings.robots.description import parse_urdf
from nrs_cosim.recordings.robots.kinematics import Kinematics
from tests.command import nrs
from tests.plant_fmu.equations import Equations
from tests.plant_fmu.newton_euler import Oracle
from tests.plant_fmu.pinocchio_reference import Reference
from tests.plant_fmu.random_robots import random_robot
from tests.plant_fmu.urdf_texts import LIMIT, dynamics, joint, link, mimic, reader, robot, states

TREES = 40


@pytest.fixture(scope="module", autouse=True)
def _extra():
    pytest.importorskip(
        "nrs_cosim.plant_fmu.bundled.rigid_body", reason="needs the packages of the extra urdf"
    )


@pytest.fixture(scope="module")
def pinocchio():
    return pytest.importorskip("pinocchio", reason="needs the package pin, of the extra test")


@pytest.fixture
def read(tmp_path):
    return reader(tmp_path)


# Joints that mimic others

GRIPPER = robot(
    *map(link, ("palm", "left", "right", "tip")),
    joint("wrist", "base", "palm", axis="0 0 1"),
    joint("tip", "right", "tip", more=mimic("right", -0.5, 0.2)),
    joint("right", "palm", "right", "prismatic", mimic("left", 0.7, -0.1)),
    joint("left", "palm", "left", more='<dynamics damping="0.4"/>'),
)
G = np.array([[1, 0], [0, -0.35], [0, 0.7], [0, 1]])
OFFSET = np.array([0, 0.25, -0.1, 0])


def test_a_chain_of_mimics_agrees_with_newton_euler(read, tmp_path):
    """The tip follows the right finger, which follows the left one: q = -0.35 q_left + 0.25."""
    found = read(GRIPPER)
    assert [j.name for j in found.axes] == ["wrist", "left"]
    np.testing.assert_allclose(couplings(found.joints).G, G, rtol=1e-15)
    np.testing.assert_allclose(couplings(found.joints).offset, OFFSET, rtol=1e-15)
    oracle, moving = Oracle(tmp_path / "robot.urdf"), dynamics(found)
    for q, qd, force in states(2, 0):
        Q, Qd = G @ q + OFFSET, G @ qd
        bias = G.T @ (oracle.force(Q, Qd, np.zeros(4)) + oracle.damping * Qd)
        wanted = np.linalg.solve(G.T @ oracle.mass_matrix(Q) @ G, force - bias)
        np.testing.assert_allclose(moving(q, qd, force), wanted, rtol=1e-12)


def test_mimics_in_random_trees_agree_with_another_library(pinocchio, read):
    for seed in range(TREES):
        drawn, random = random_robot(seed), np.random.default_rng((20, seed))
        m = len(drawn.moving)
        text, matrix, offset = drawn.urdf, np.eye(m), np.zeros(m)
        for k in random.permutation(m)[: m // 2]:
            leader = int(random.integers(m))
            if matrix[leader, k]:  # it would follow itself
                continue
            factor, shift = random.uniform(-2, 2, 2)
            text = text.replace(
                f'<joint name="{drawn.moving[k].name}" type="{drawn.moving[k].kind}">',
                f'<joint name="{drawn.moving[k].name}" type="{drawn.moving[k].kind}">'
                + mimic(drawn.moving[leader].name, factor, shift),
            )
            follows = matrix[:, k].copy()  # so do those that follow it already
            matrix += np.outer(follows, factor * matrix[leader])
            offset += follows * (factor * offset[leader] + shift)
            matrix[:, k] = 0
        leading = matrix[:, matrix.any(axis=0)]
        damping = np.array([j.damping for j in drawn.moving])
        model, names = pinocchio.buildModelFromXML(drawn.urdf), [j.name for j in drawn.moving]
        reference, moving = Reference(model, names, GRAVITY, damping), dynamics(read(text))
        for q, qd, force in states(leading.shape[1], seed):
            wanted = reference.coupled(leading, offset, q, qd, force)
            error = np.abs(moving(q, qd, force) - wanted).max()
            assert error <= 1e-12 * np.abs(wanted).max(), seed


@pytest.mark.usefixtures("pinocchio")
def test_a_compiled_gripper_is_a_row_of_the_table_of_robots(tmp_path):
    from tests.urdfs import look_at  # noqa: PLC0415, which needs Pinocchio

    path = tmp_path / "gripper.urdf"
    path.write_text(GRIPPER, "utf-8")
    found = look_at(path, tmp_path / "gripper")
    assert (found.cells[0], found.refused) == ("2", "")
    assert 0 < found.error < 1e-13
    assert np.isfinite(float(found.cells[3]))
    path.write_text(GRIPPER.replace(link("tip") + "<", "<"), "utf-8")
    wanted = "joint 'tip': <child>: there is no link 'tip'"
    assert look_at(path, tmp_path / "none").refused == wanted


def test_a_finger_without_inertia_may_follow_another(read):
    found = read(GRIPPER.replace(link("tip"), '<link name="tip"/>'))
    assert found.warnings == (
        "link 'tip': no inertia about its joint's axis of its own, and the mass matrix is positive "
        "definite in the posture of zeros and 8 random ones; it may be singular in others",
    )


# Locked joints, and chains


def test_locked_joints_of_random_trees_agree_with_another_library(pinocchio, read):
    for seed in range(TREES):
        drawn, random = random_robot(seed), np.random.default_rng((21, seed))
        names = [j.name for j in drawn.moving]
        locked = {str(n): float(random.uniform(-2, 2)) for n in names[: len(names) // 2]}
        left = [j for j in drawn.moving if j.name not in locked]
        model, damping = pinocchio.buildModelFromXML(drawn.urdf), [j.damping for j in left]
        free = [j.name for j in left]
        reference = Reference(model, free, GRAVITY, np.array(damping), locked)
        found = read(drawn.urdf, lock=locked)
        assert [j.name for j in found.axes] == free
        for q, qd, force in states(len(free), seed):
            wanted = reference.acceleration(q, qd, force)
            error = np.abs(dynamics(found)(q, qd, force) - wanted).max()
            assert error <= 1e-12 * np.abs(wanted).max(), seed


HUMANOID = robot(
    *map(link, ("hip", "torso", "head", "upper", "lower", "thumb", "finger", "left")),
    joint("root", "base", "hip", "floating"),
    joint("waist", "hip", "torso", axis="1 0 0"),
    joint("neck", "torso", "head", "continuous", axis="0 0 1"),
    joint("shoulder", "torso", "upper", axis="1 0 1"),
    joint("elbow", "upper", "lower", limit=LIMIT.format(0.2, 2)),
    joint("thumb", "lower", "thumb", limit=LIMIT.format(0.3, 0.9)),
    joint("finger", "lower", "finger", more=mimic("thumb", -1, 0.1)),
    joint("left", "torso", "left"),
)


def test_a_chain_of_a_humanoid_moves_as_with_all_else_locked(pinocchio, read):
    found = read(HUMANOID, base="torso", tip="lower")
    assert [j.name for j in found.axes] == ["shoulder", "elbow"]
    assert found.warnings == (
        "not between base and tip: joints locked at neck = 0, thumb = 0.3, left = 0",
        "joint 'finger': mimics 'thumb', which is fixed, so it is fixed as well",
    )
    locked = {"waist": 0.0, "neck": 0.0, "thumb": 0.3, "finger": -0.2, "left": 0.0}
    model = pinocchio.buildModelFromXML(HUMANOID.replace("floating", "fixed"))
    reference = Reference(model, ["shoulder", "elbow"], GRAVITY, 0.0, locked)
    for q, qd, force in states(2, 0):
        wanted = reference.acceleration(q, qd, force)
        np.testing.assert_allclose(dynamics(found)(q, qd, force), wanted, rtol=1e-12)


def test_a_joint_is_locked_as_near_to_0_as_its_limits_let_it(read):
    found = read(HUMANOID, lock={"root": None, "elbow": None, "waist": None})
    turns = {j.name: j.origin.rpy for j in found.joints if j.kind == "fixed"}
    assert turns.pop("elbow") == pytest.approx((0, 0.2, 0), rel=1e-15)
    assert turns == {"root": (0, 0, 0), "waist": (0, 0, 0)}
    assert [j.name for j in found.axes] == ["neck", "shoulder", "thumb", "left"]


def test_a_joint_that_is_locked_beyond_its_limits_is_told_with_the_unit(read):
    said = "joint 'elbow': --lock: 90 rad is beyond its limits, 0.2 to 2 rad"
    for value, warned in ((90.0, True), (2.0, False)):
        found = read(HUMANOID, lock={"root": None, "elbow": value})
        assert (said in found.warnings) == warned


def test_what_is_kept_of_a_file_says_where_the_links_are(pinocchio, read):
    """A finger two mimics from its leader, a hand whose locked joint pitches by a quarter turn."""
    text = robot(
        *map(link, ("stand", "palm", "left", "right", "tip")),
        joint("stand", "base", "stand", "floating"),
        joint("wrist", "stand", "palm", axis="0.6 0.64 0.48"),
        joint("tip", "right", "tip", more=mimic("right", -0.5, 0.2)),
        joint("right", "palm", "right", "prismatic", mimic("left", 0.7, -0.1)),
        joint("left", "palm", "left"),
    ).replace('<origin xyz="0.3 0 0.1"/>', f'<origin xyz="0.3 0 0.1" rpy="0.3 {np.pi / 2} 1"/>')
    kept = parse_urdf(read(text, base="stand", lock={"wrist": 0.4}).text, "kept")
    assert {j.mimic.joint for j in kept.joints if j.mimic} == {"left"}
    found = Kinematics.of(kept, ["left"]).links(np.array([[0.8]]))[0]
    model = pinocchio.buildModelFromXML(text.replace("floating", "fixed"))
    reference = Reference(model, ["wrist", "tip", "right", "left"], GRAVITY)
    base, *_ = frames = reference.frames([0.4, -0.03, 0.46, 0.8], kept.links)
    for frame, wanted in zip(found, frames, strict=True):
        np.testing.assert_allclose(frame[:3], base.actInv(wanted).translation, atol=1e-15)
        turned = Rotation.from_quat(frame[3:]).as_matrix()
        np.testing.assert_allclose(turned, base.actInv(wanted).rotation, atol=1e-14)


WRONG = {
    "no such joint": ({"lock": {"waste": None}}, "--lock: there is no joint 'waste'; did you mean"),
    "a value of a floating joint": (
        {"lock": {"root": 1.0}},
        "joint 'root': --lock: a floating joint is locked where it is, without a value",
    ),
    "no such link": ({"base": "torse"}, "--base-link: there is no link 'torse'; did you mean"),
    "a tip that is the base": (
        {"base": "torso", "tip": "torso"},
        "link 'torso': --tip-link: is the base itself, or is not above it",
    ),
    "a tip on another branch": (
        {"base": "upper", "tip": "head"},
        "link 'head': --tip-link: is the base itself, or is not above it",
    ),
    "a floating joint": ({}, "joint 'root': type 'floating' is not supported, for the base is"),
}


@pytest.mark.parametrize("leader", ["root", "waist"])
def test_all_that_is_wrong_is_told_where_a_joint_mimics_one_that_cannot_move(read, leader):
    text = HUMANOID.replace('mimic joint="thumb"', f'mimic joint="{leader}"')
    text = text.replace('name="waist" type="revolute"', 'name="waist" type="fixed"')
    with pytest.raises(FmuError) as caught:
        read(text, lock={"root": 1.0})
    assert len(str(caught.value).splitlines()) == 2


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_selected_is_told(read, case):
    chosen, message = WRONG[case]
    with pytest.raises(FmuError, match=re.escape(message)):
        read(HUMANOID, **chosen)


# The command


def test_the_command_takes_all_choices_and_its_fmu_passes_the_check(tmp_path):
    rough = LIMIT.format(0.2, 2) + '<dynamics friction="0.1"/>'
    path, output = tmp_path / "humanoid.urdf", tmp_path / "arm.fmu"
    path.write_text(HUMANOID.replace(LIMIT.format(0.2, 2), rough), "utf-8")
    options = ["--base-link", "torso", "--lock", "thumb=0.5", "--lock", "neck", "--lock", "left"]
    options += ["--friction", "0.05", "--stops", "10"]
    done = nrs("fmu", "from-urdf", path, "-o", output, *options)
    assert (done.returncode, done.stdout) == (0, f"{output}\n")
    chosen = Selection({"thumb": 0.5, "neck": None, "left": None}, "torso", "", 0.05, 10.0)
    found = read_urdf(path, chosen)
    assert done.stderr.splitlines() == [f"warning: {path}: {line}" for line in found.warnings]
    assert output.read_bytes() == build_urdf(found).read_bytes()
    fmu = Equations(output, tmp_path / "arm")
    for q, qd, force in states(2, 0):
        wanted = dynamics(found)(q, qd, force)
        np.testing.assert_allclose(fmu.acceleration(q, qd, force), wanted, rtol=1e-13)
    fmu.fmu.freeInstance()


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--lock", "j=half", "expected JOINT or JOINT=VALUE, got 'j=half'"),
        ("--friction", "0", "expected 1e-06 to 1e+06, got 0"),
        ("--stops", "-1", "expected 1e-06 to 1e+06, got -1"),
    ],
)
def test_wrong_choices_are_told(tmp_path, option, value, message):
    done = nrs("fmu", "from-urdf", "a.urdf", "-o", tmp_path / "a.fmu", option, value)
    assert (done.returncode, done.stderr) == (2, f"error: {option}: {message}\n")
