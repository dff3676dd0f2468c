"""A recording has the URDF of each robot of which one is known, by its content."""

import hashlib
import json
import platform
import re
from contextlib import ExitStack
from zipfile import ZipFile

import pytest

from nrs_cosim.orchestrator.cluster.protocol import PlantDescription, Ready
from nrs_cosim.orchestrator.engine.joint_limits import beyond_limits
from nrs_cosim.orchestrator.engine.robots import Robots
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.bundled.model_urdf import model_urdf
from nrs_cosim.plant_fmu.joints import JOINTS, URDF
from nrs_cosim.plant_fmu.urdf_limits import FRICTION, LIMITS, left_out
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import RUN, URDFS
from tests.command import nrs
from tests.orchestrator.test_assets import again
from tests.scenarios import paper, write

ELBOWED = model_urdf("two_link_arm", {"r1": 0.7}, ["shoulder", "elbow"])
CHANGES = {
    "run.duration": 0.2,
    "network": {"edge_list": [[0, 1], [1, 2], [2, 3], [3, 4]]},
    "initial": None,
    "disturbance": None,
    "robots": [
        {"id": 2, "plant": {"parameters": {"r1": 1.5}}},
        {"id": 4, "plant": {"fmu": "own.fmu"}},
    ],
}
BUNDLED = ["q[1]", "q[2]"]
EXPECTED = {
    **dict.fromkeys([1, 3], model_urdf("two_link_arm", {}, BUNDLED)),
    2: model_urdf("two_link_arm", {"r1": 1.5}, BUNDLED),
    4: ELBOWED,
}


def own_fmu(path, urdf=ELBOWED, end=""):
    """Write an FMU as it is made of a URDF: it names its joints, and says how it looks."""
    joints = [{"name": name, "unit": "rad"} for name in ("shoulder", "elbow")]
    with ZipFile(build("two_link_arm")) as source, ZipFile(path, "w") as own:
        for entry in source.infolist():
            content = source.read(entry)
            if entry.filename == "modelDescription.xml":
                content = re.sub(rb'( description="[^"]*)', rb"\1" + end.encode(), content, count=1)
            own.writestr(entry, content)
        own.writestr(JOINTS, json.dumps(joints))
        own.writestr(URDF, urdf)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with an FMU of whoever that has a URDF, a scenario and a run of it."""
    folder = tmp_path_factory.mktemp("urdfs")
    own_fmu(folder / "own.fmu")
    write(folder / "run.toml", CHANGES)
    done = nrs("run", folder / "run.toml", "-o", folder / "run.mcap")
    assert done.returncode == 0, done.stderr
    return folder


def test_an_fmu_whose_urdf_is_no_text_is_refused_by_name(tmp_path):
    own_fmu(tmp_path / "own.fmu", b"<robot name='\xff'/>")
    done = nrs("fmu", "info", tmp_path / "own.fmu")
    assert (done.returncode, done.stdout) == (2, "")
    assert f"own.fmu: its {URDF} cannot be used: it is no text: " in done.stderr


def test_a_urdf_that_cannot_be_drawn_is_refused_by_the_attachments_name(tmp_path):
    own_fmu(tmp_path / "own.fmu", "<robot name='of nothing'/>")
    write(tmp_path / "run.toml", CHANGES)
    assert nrs("run", tmp_path / "run.toml", "-o", tmp_path / "run.mcap").returncode == 0
    done = nrs("convert", tmp_path / "run.mcap", "--to", "ros2", "-o", tmp_path / "bag")
    assert done.returncode == 2
    name = hashlib.sha256(b"<robot name='of nothing'/>").hexdigest()
    assert f"{tmp_path / 'run.mcap'}: {name}.urdf: is no URDF that can be drawn" in done.stderr
    assert not (tmp_path / "bag").exists()


def urdfs(path):
    with Reader(path) as reader:
        return {robot: text.decode() for robot, text in reader.about.urdfs.items()}


def test_each_urdf_is_attached_once_under_its_hash(folder):
    assert urdfs(folder / "run.mcap") == EXPECTED
    with Reader(folder / "run.mcap") as reader:
        attached = {name: data for name, (_, data) in reader.attachments.items() if "urdf" in name}
        names = {channel.topic: channel.metadata.get("joints") for channel in reader.channels}
    assert len(attached) == 3
    for name, data in attached.items():
        assert name == f"{hashlib.sha256(data).hexdigest()}.urdf"
    assert names["/robot_4/state"] == '["shoulder", "elbow"]'


def test_a_worker_tells_the_urdfs_of_its_robots(folder):
    with ExitStack() as stack:
        robots = Robots.opened(stack, paper(CHANGES, folder=folder), [3, 4])
        plants = tuple(PlantDescription(**plant) for plant in robots.plant_descriptions)
    ready = Ready.read(Ready(incarnation="a", plants=plants).written())
    assert [plant.urdf for plant in ready.plants] == ["", ELBOWED]


def test_a_changed_run_keeps_the_urdfs_of_robots_that_are_not_changed(folder):
    change = "robots=1,plant.parameters={r1=2.0}"
    done = nrs("replay", folder / "run.mcap", "--plant", change, "-o", folder / "changed.mcap")
    assert done.returncode == 0, done.stderr
    longer = {1: model_urdf("two_link_arm", {"r1": 2.0}, BUNDLED)}
    assert urdfs(folder / "changed.mcap") == EXPECTED | longer


@pytest.mark.parametrize("changes", [CHANGES, {**CHANGES, "robots": []}])
def test_a_recording_says_nothing_of_its_makers_folders_or_kernel(folder, tmp_path, changes):
    """What it needs of them is where FMUs are, seen from it: both may move together."""
    home, moved = tmp_path / "home-of-eve", tmp_path / "moved"
    (home / "results").mkdir(parents=True)
    (home / "own.fmu").write_bytes((folder / "own.fmu").read_bytes())
    write(home / "run.toml", changes)
    done = nrs("run", home / "run.toml", "-o", home / "results/run.mcap")
    assert done.returncode == 0, done.stderr
    content = (home / "results/run.mcap").read_bytes()
    for secret in (str(tmp_path), "home-of-eve", platform.release(), platform.node()):
        assert secret.encode() not in content
    with Reader(home / "results/run.mcap") as reader:
        assert reader.metadata[RUN]["folder"] == (".." if changes["robots"] else ".")
        experiment = experiment_of(reader)
    assert experiment.files_at == (home if changes["robots"] else None)
    home.rename(moved)
    done = nrs("replay", moved / "results/run.mcap", "--verify")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("records", "wrong"),
    [
        ({"a.urdf": "[1]"}, "a.urdf: expected this attachment, which nrs.urdfs names"),
        ({"scenario.toml": "[1]"}, "scenario.toml: expected the content of that SHA-256"),
        ({None: "[9]"}, "expected robots of the 4, once, got 9"),
        ({None: "[1, 1]"}, "expected robots of the 4, once, got 1"),
        ({None: "one"}, "nrs.urdfs: "),
    ],
)
def test_records_of_urdfs_that_are_none_are_refused(folder, tmp_path, records, wrong):
    with Reader(folder / "run.mcap") as reader:
        name = next(iter(reader.metadata[URDFS]))
    said = {key or name: value for key, value in records.items()}
    changed = {"records": lambda kept: {**kept, URDFS: said}}
    with pytest.raises(UnreadableError) as error:
        Reader(again(folder / "run.mcap", tmp_path / "new.mcap", **changed))
    assert wrong in str(error.value)


def limited(joint, kind, *limits):
    ends = " ".join(f'{name}="{at}"' for name, at in zip(("lower", "upper"), limits, strict=False))
    return f'<joint name="{joint}" type="{kind}"><limit {ends}/></joint>'


@pytest.mark.parametrize(
    ("shoulder", "elbow", "said"),
    [
        # 2 t + sin t comes to 0.4 + sin 0.2, and −2 t − cos t from −1 to −0.4 − cos 0.2.
        (("revolute", -0.5, 0.55), ("revolute", -2, 1), ["the target comes", "shoulder", "0.5987"]),
        (("revolute", -1, 1), ("prismatic", -1.2, 1), ["the target comes", "elbow", "-1.38"]),
        (
            ("revolute", 0.1, 1),
            ("revolute", -2, 1),
            ["starts are", "shoulder (0.1 to 1): robot 4 at 0;"],
        ),
        (("continuous", -0.1, 0.1), ("revolute", 0, 0), []),
        (("revolute",), ("fixed", -0.1, 0.1), []),
    ],
)
def test_what_is_beyond_a_joints_limits_is_told(tmp_path, shoulder, elbow, said):
    joints = limited("shoulder", *shoulder) + limited("elbow", *elbow)
    own_fmu(tmp_path / "own.fmu", f'<robot name="r">{joints}</robot>')
    found = beyond_limits(paper(CHANGES, folder=tmp_path))
    assert any(all(word in line for word in said) for line in found) == bool(said)


@pytest.mark.parametrize(
    ("missing", "acting"),
    [([LIMITS, FRICTION], False), ([LIMITS], False), ([FRICTION], True), ([], True), (None, False)],
)
def test_each_robot_that_starts_beyond_a_limit_is_told_with_where_and_whether_stops_act(
    tmp_path, missing, acting
):
    urdf = "".join(
        (limited("shoulder", "revolute", -9, 9), limited("elbow", "prismatic", -9, 0.04))
    )
    end = "" if missing is None else left_out(missing)
    own_fmu(tmp_path / "own.fmu", f'<robot name="r">{urdf}</robot>', end)
    starts = {1: 0.3, 2: 0.0385, 3: -9.5, 4: 0.3}
    robots = [{"id": robot, "initial": {"q": [0, q]}} for robot, q in starts.items()]
    changes = CHANGES | {"plant.fmu": "own.fmu", "robots": robots}
    assert beyond_limits(paper(changes, folder=tmp_path)) == [
        "starts are beyond the limits of joints: elbow (-9 to 0.04): robots 1, 4 at 0.3, robot 3 "
        "at -9.5; "
        + ("the robots' soft stops act there" if acting else "they act on robots with stops alone ")
        + "(nrs fmu from-urdf --stops)" * (not acting)
    ]


def test_a_robot_of_another_number_of_joints_is_refused_in_a_line(tmp_path):
    own_fmu(tmp_path / "own.fmu", ELBOWED)
    axes = {"target.axes": [{}] * 3}
    scenario = write(
        tmp_path / "run.toml", {**CHANGES, **axes, "robots": [], "plant.fmu": "own.fmu"}
    )
    done = nrs("run", scenario, "-o", tmp_path / "run.mcap")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"error: {scenario}: plant: {tmp_path}/own.fmu: q takes 3 ")
    assert len(done.stderr.splitlines()) == 1


def test_limits_are_told_of_before_a_run_and_by_check(tmp_path):
    limits = '<limit lower="-0.1" upper="0.1" effort="1" velocity="1"/>'
    urdf = ELBOWED.replace("continuous", "revolute").replace("<axis", f"{limits}<axis")
    own_fmu(tmp_path / "own.fmu", urdf)
    scenario = write(tmp_path / "run.toml", CHANGES)
    for command in (["check", scenario], ["run", scenario, "-o", tmp_path / "run.mcap"]):
        done = nrs(*command)
        assert done.returncode == 0, done.stderr
        assert "warning: the target comes beyond the limits of robot 4's joints" in done.stderr
