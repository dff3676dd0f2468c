"""Where links are: against Pinocchio on robots of files, of bundled models, and drawn at random."""

from pathlib import Path

import numpy as np
import pytest

from nrs_cosim.plant_fmu.bundled.model_urdf import model_urdf
from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.robots.description import parse_urdf
from nrs_cosim.recordings.robots.kinematics import Kinematics
from tests.plant_fmu.random_robots import random_robot

ROBOTS = Path(__file__).parents[1] / "plant_fmu/robots"
TIMES = 20


def urdfs(folder):
    """Return ten robots and more: what is kept of files, and what bundled models have."""
    texts = [read_urdf(path).text.decode() for path in sorted(ROBOTS.glob("*.urdf"))]
    texts.append(model_urdf("two_link_arm", {"r1": 1.3}, ["shoulder", "elbow"]))
    texts.append(model_urdf("n_link_arm", {"n": 5, "r": [1, 2, 3, 4, 0.5]}, list("abcde")))
    texts.append(model_urdf("planar_robot", {}, ["x", "y"]))
    for seed in range(6):
        path = folder / f"{seed}.urdf"
        path.write_text(random_robot(seed).urdf, "utf-8")
        texts.append(read_urdf(path).text.decode())
    return texts


def test_links_are_where_another_library_has_them(tmp_path):
    pinocchio = pytest.importorskip("pinocchio", reason="needs the package pin, of the extra test")
    random, compared = np.random.default_rng(3), 0
    for text in urdfs(tmp_path):
        model = pinocchio.buildModelFromXML(text)
        data = model.createData()
        names = [*model.names][1:]
        kinematics = Kinematics.of(parse_urdf(text.encode(), "a"), names)
        q = random.uniform(-3, 3, (TIMES, len(names)))
        found = kinematics.links(q)
        for row, posture in enumerate(q):
            theirs = [
                part
                for joint, value in zip(model.joints[1:], posture, strict=True)
                for part in ((np.cos(value), np.sin(value)) if joint.nq == 2 else (value,))
            ]
            pinocchio.framesForwardKinematics(model, data, np.array(theirs))
            for at, link in enumerate(kinematics.description.links):
                frame = data.oMf[model.getFrameId(link, pinocchio.FrameType.BODY)]
                assert np.abs(found[row, at, :3] - frame.translation).max() <= 1e-14
                turned = pinocchio.Quaternion(found[row, at, 3:]).toRotationMatrix()
                assert np.abs(turned - frame.rotation).max() <= 1e-14
                compared += 1
    assert compared > 10 * TIMES


def test_an_arm_of_two_links_is_its_closed_form():
    text = model_urdf("two_link_arm", {"r1": 1.5, "r2": 0.5}, ["one", "two"])
    description = parse_urdf(text.encode(), "a")
    q = np.random.default_rng(1).uniform(-3, 3, (50, 2))
    ends = Kinematics.of(description, ["one", "two"]).links(q)[:, -1, :3]
    one, both = q[:, 0], q.sum(axis=1)
    x, z = 1.5 * np.cos(one) + 0.5 * np.cos(both), 1.5 * np.sin(one) + 0.5 * np.sin(both)
    assert ends == pytest.approx(np.stack([x, 0 * x, z], 1))
    assert description.reach == pytest.approx(2.0)


CHAIN = """
<robot name="finger"><link name="palm"/><link name="near"/><link name="far"/>
<joint name="bend" type="revolute"><parent link="palm"/><child link="near"/>
  <axis xyz="0 0 2"/></joint>
<joint name="curl" type="revolute"><parent link="near"/><child link="far"/><axis xyz="0 0 1"/>
  <origin xyz="1 0 0"/><mimic joint="bend" multiplier="2" offset="0.1"/></joint></robot>
"""


def test_a_joint_that_mimics_another_goes_with_it():
    kinematics = Kinematics.of(parse_urdf(CHAIN.encode(), "a"), ["bend"])
    far = kinematics.links(np.array([[0.3]]))[0, 2]
    assert far[:3] == pytest.approx([np.cos(0.3), np.sin(0.3), 0])
    assert far[3:] == pytest.approx([0, 0, np.sin(0.5), np.cos(0.5)])  # half of 0.3 + 0.7


def test_links_that_only_meshes_show_look_like_rods(tmp_path):
    """Of meshes those of ROS packages stay; whose file it is nobody learns."""
    inertia = '<mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    looks = (
        '<visual><geometry><mesh filename="{}"/></geometry></visual>'
        f"<inertial>{inertia}</inertial></link>"
    )
    text = CHAIN.replace('<mimic joint="bend" multiplier="2" offset="0.1"/>', "<!-- by Eve -->")
    text = text.replace('"near"/>', '"near">' + looks.format("file:///home/eve/near.stl"), 1)
    text = text.replace('"far"/>', '"far">' + looks.format("package://eve/far.stl"), 1)
    text = text.replace("</robot>", "<gazebo><plugin filename='/home/eve/x.so'/></gazebo></robot>")
    path = tmp_path / "finger.urdf"
    path.write_text(text, "utf-8")
    kept = read_urdf(path).text
    assert b"package://eve/far.stl" in kept
    assert not any(word in kept for word in (b"home", b"Eve", b"gazebo"))
    shapes = parse_urdf(kept, "a").shapes
    assert [shape.kind for shape in shapes["near"]] == ["cylinder", "sphere"]
    rod = shapes["near"][0]
    assert (rod.size[1], rod.xyz, rod.rpy) == (1.0, (0.5, 0.0, 0.0), (0.0, np.pi / 2, 0.0))


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        ("<robot", "<robots", "is no URDF that can be drawn: Opening and ending tag mismatch"),
        ("robot", "model", "its root is <model>, expected <robot>"),
        ('parent link="near"', 'parent link="nobody"', "there is no link 'nobody'"),
        ('parent link="near"', 'parent link="far"', "its links are not one tree"),
        ('parent link="palm"', 'parent link="far"', "its links are not one tree"),
        ('name="curl"', 'name="bend"', "two links or two joints have one name"),
        ('xyz="0 0 2"', 'xyz="0 0 0"', "joint 'bend': its axis has no direction"),
        ('xyz="1 0 0"', 'xyz="1 0 inf"', "<origin> xyz: got '1 0 inf'"),
        ('type="revolute"', 'type="floating"', "joint 'bend': type: got 'floating'"),
        ('mimic joint="bend"', 'mimic joint="curl"', "'curl' mimics none that moves by itself"),
    ],
)
def test_what_is_no_tree_of_links_is_refused_by_name(old, new, wrong):
    with pytest.raises(UnreadableError) as error:
        parse_urdf(CHAIN.replace(old, new).encode(), "run.mcap: a.urdf")
    assert str(error.value).startswith("run.mcap: a.urdf: is no URDF that can be drawn: ")
    assert wrong in str(error.value)
