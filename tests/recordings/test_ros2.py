"""A recording as a bag of ROS 2, as other libraries read it: their bytes, our numbers."""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from mcap.reader import make_reader

from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.metadata import URDFS
from nrs_cosim.recordings.ros2 import cdr, definitions
from tests.cases import cases
from tests.command import nrs
from tests.orchestrator.test_assets import again
from tests.orchestrator.test_urdfs import CHANGES, own_fmu
from tests.recordings.transforms import matrix
from tests.scenarios import write

highlevel = pytest.importorskip("rosbags.highlevel", reason="needs rosbags, of the extra `test`")
typesys = pytest.importorskip("rosbags.typesys", reason="needs rosbags, of the extra `test`")
decoder = pytest.importorskip("mcap_ros2.decoder", reason="needs mcap-ros2-support, of `test`")
STORE = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
TYPES = STORE.types
RERUN = Path(sys.executable).with_name("rerun")
LOSSY = {
    "run.duration": 0.4,
    "faults.links": [{"loss": 0.4, "delay": {"uniform": [0, 1]}}],
    "faults.robots": [{"id": 3, "outages": [[0.15, 0.25]]}],
}


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return a recording of four arms, of which the last has joints with names."""
    folder = tmp_path_factory.mktemp("ros2")
    own_fmu(folder / "own.fmu")
    write(folder / "run.toml", CHANGES, LOSSY)
    done = nrs("run", folder / "run.toml", "-o", folder / "run.mcap")
    assert done.returncode == 0, done.stderr
    return folder / "run.mcap"


def converted(recording, output, *options):
    done = nrs("convert", recording, "--to", "ros2", "-o", output, *options)
    assert (done.returncode, done.stderr, done.stdout) == (0, "", f"{output}\n")
    return output


def messages(path):
    """Yield topic, log time, message and bytes of a bag, by rosbags."""
    with highlevel.AnyReader([path], default_typestore=STORE) as reader:
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            again = STORE.serialize_cdr(message, connection.msgtype)
            assert bytes(again) == bytes(raw), connection.topic
            yield connection.topic, time_ns, message


def stamp_of(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def expected_joints(recording):
    """Return what JointStates there are to be, by topic and time."""
    found = {}
    with Recording(recording) as opened:
        for row in opened.states():
            own = ["shoulder", "elbow"] if row["robot"] == 4 else ["q[1]", "q[2]"]
            of = f"/robot_{row['robot']}", int(row["time_ns"])
            moved = [row[name].tolist() for name in ("position", "velocity", "effort")]
            followed = [row[f"reference_{name}"].tolist() for name in ("position", "velocity")]
            found[f"{of[0]}/joint_states", of[1]] = (own, *moved)
            found[f"{of[0]}/reference", of[1]] = (own, *followed, [])
        for row in opened.samples(0):
            sent = row["position"].tolist(), row["velocity"].tolist(), []
            found["/target/joint_states", int(row["time_ns"])] = (["q[1]", "q[2]"], *sent)
    return found


def as_expected(message):
    numbers = (message.position, message.velocity, message.effort)
    return (list(message.name), *([float(x) for x in of] for of in numbers))


def test_a_folder_and_a_file_are_read_by_other_libraries_with_equal_numbers(recording, tmp_path):
    expected = expected_joints(recording)
    found = {}
    for topic, time_ns, message in messages(converted(recording, tmp_path / "bag")):
        if hasattr(message, "velocity"):
            assert stamp_of(message.header) == time_ns
            found[topic, time_ns] = as_expected(message)
    assert found == expected
    alone = converted(recording, tmp_path / "bag.mcap")
    assert alone.read_bytes() == (tmp_path / "bag/bag_0.mcap").read_bytes()
    with alone.open("rb") as file:
        decoded = make_reader(
            file, decoder_factories=[decoder.DecoderFactory()]
        ).iter_decoded_messages()
        read = {
            (channel.topic, message.log_time): as_expected(decoded_message)
            for _, channel, message, decoded_message in decoded
            if channel.topic.endswith(("joint_states", "reference"))
        }
    assert read == expected


LENGTHS = {0: 1.0, 1: 1.0, 2: 1.5, 3: 1.0, 4: 0.7}


def test_frames_of_robots_of_one_urdf_are_apart_and_go_where_their_joints_do(recording, tmp_path):
    still, moving = {}, {}
    for topic, time_ns, message in messages(converted(recording, tmp_path / "bag.mcap")):
        for one in getattr(message, "transforms", ()):
            to = still if topic == "/tf_static" else moving.setdefault(time_ns, {})
            assert stamp_of(one.header) == time_ns
            to[one.child_frame_id] = (one.header.frame_id, matrix(one.transform))
    bases = {still[f"robot_{i}/base"][1][1, 3] for i in range(1, 5)}
    assert len(bases) == 4
    assert min(np.diff(sorted(bases))) >= 1.0
    with Recording(recording) as opened:
        states, samples = opened.states(), opened.samples(0)
    assert moving.keys() == {*states["time_ns"].tolist(), *samples["time_ns"].tolist()}
    for row in [*states, *samples]:
        name = f"robot_{row['robot']}" if row["robot"] else "target"
        frame, place = f"{name}/tip", np.eye(4)
        while frame != "world":
            frame, step = (still | moving[int(row["time_ns"])])[frame]
            place = step @ place
        one, both = row["position"][0], row["position"].sum()
        first = LENGTHS[int(row["robot"])]
        x, z = first * np.cos(one) + 0.8 * np.cos(both), first * np.sin(one) + 0.8 * np.sin(both)
        y = still[f"{name}/base"][1][1, 3]
        assert place[:3, 3] == pytest.approx([x, y, z], abs=1e-12)


def test_each_robot_is_described_by_a_urdf_of_its_own_frames(recording, tmp_path):
    names = set()
    for topic, time_ns, message in messages(converted(recording, tmp_path / "bag.mcap")):
        if not topic.endswith("/robot_description"):
            continue
        robot, root = topic.split("/")[1], etree.fromstring(message.data)
        names.add(root.get("name"))
        links = {link.get("name") for link in root.findall("link")}
        ends = {end.get("link") for end in root.iterfind("joint/*[@link]")}
        assert (time_ns, root.get("name")) == (0, robot)
        assert links == ends == {f"{robot}/{link}" for link in ("base", "link_1", "link_2", "tip")}
        colours = {colour.get("rgba") for colour in root.iterfind("link/visual/material/color")}
        assert len(colours) == 1
    assert names == {"target", *(f"robot_{i}" for i in range(1, 5))}


def test_link_events_are_logged_in_words(recording, tmp_path):
    said = Counter()
    for topic, time_ns, message in messages(converted(recording, tmp_path / "bag.mcap")):
        if topic == "/rosout":
            said[time_ns, message.name, message.msg, message.level] += 1
    expected = Counter()
    with Recording(recording) as opened:
        for row in opened.link_events():
            of = f"robot {row['source']}" if row["source"] else "the target"
            met = ["lost"] * bool(row["lost"]) + ["in an outage"] * bool(row["outage"])
            met += [f"late by {row['delay']} sampling period"] * bool(row["delay"])
            text = f"sample of {of}: {', '.join(met)}"
            if row["source"] == row["robot"]:
                text = "in an outage"
            level = 30 if row["lost"] or row["outage"] else 20
            expected[int(row["time_ns"]), f"robot_{row['robot']}", text, level] += 1
    assert said == expected
    assert {text for _, _, text, _ in said} >= {
        "in an outage",
        "sample of robot 1: late by 1 sampling period",
    }


def test_robots_and_times_are_selected_and_times_begin_at_the_epoch(recording, tmp_path):
    options = ("--robots", "2,4", "--from", "0.1", "--until", "0.3", "--epoch", "1000")
    kept = {
        (topic, time_ns + 1000 * 10**9)
        for topic, time_ns in expected_joints(recording)
        if topic.split("/")[1] in {"robot_2", "robot_4", "target"} and 1e8 <= time_ns < 3e8
    }
    found, frames = set(), set()
    for topic, time_ns, message in messages(converted(recording, tmp_path / "bag", *options)):
        if hasattr(message, "velocity"):
            assert stamp_of(message.header) == time_ns
            found.add((topic, time_ns))
        frames |= {one.child_frame_id.split("/")[0] for one in getattr(message, "transforms", ())}
    assert found == kept
    assert frames == {"robot_2", "robot_4", "target"}


def test_robots_without_a_urdf_have_joints_and_no_frames(recording, tmp_path):
    without = tmp_path / "run.mcap"
    again(recording, without, records=lambda kept: {n: of for n, of in kept.items() if n != URDFS})
    done = nrs("convert", without, "--to", "ros2", "-o", tmp_path / "bag.mcap")
    assert done.returncode == 0
    assert done.stderr == "frames: there are none of robots 1-4: no URDF is known\n"
    topics = {topic for topic, _, _ in messages(tmp_path / "bag.mcap")}
    assert topics == {topic for topic, _ in expected_joints(recording)} | {"/rosout"}


@pytest.mark.parametrize(
    "of", [definitions.JOINT_STATE, definitions.TF, definitions.STRING, definitions.LOG]
)
def test_definitions_and_hashes_are_those_of_their_packages(of):
    defined = typesys.get_types_from_msg(of.definition, of.name)
    for name, fields in defined.items():
        assert fields[1] == STORE.fielddefs[name][1], name
    assert of.hash == STORE.hash_rihs01(of.name)


def test_messages_of_any_names_and_sizes_are_the_bytes_of_another_library():
    """Many in one call, of templates of many sizes, as of a chunk."""
    random = np.random.default_rng(5)
    header, time = TYPES["std_msgs/msg/Header"], TYPES["builtin_interfaces/msg/Time"]
    letters = list("abcé_/1ü漢")
    for _ in range(cases(300, 30)):
        m, count = int(random.integers(1, 9)), 5
        words = [
            ["".join(random.choice(letters, random.integers(0, 12))) for _ in range(m + 1)]
            for _ in range(count)
        ]
        which = random.integers(0, count, 20)
        times = random.integers(0, 2**31 * 10**9, 20)
        values = random.standard_normal((3, 20, m))
        made = [cdr.joint_state(frame, names, effort=True) for frame, *names in words]
        fields = dict(zip(("position", "velocity", "effort"), values, strict=True))
        data, starts, stops = cdr.Templates.of(made).filled(
            which, {"stamp": cdr.stamps(times), **fields}
        )
        for row, (start, stop) in enumerate(zip(starts, stops, strict=True)):
            frame, *names = words[which[row]]
            stamp = time(*map(int, divmod(times[row], 10**9)))
            message = TYPES["sensor_msgs/msg/JointState"](
                header(stamp, frame), names, *values[:, row]
            )
            theirs = STORE.serialize_cdr(message, "sensor_msgs/msg/JointState")
            assert bytes(data[start:stop]) == bytes(theirs)


def test_rerun_has_arms_and_named_joints_of_it(recording, tmp_path):
    chunks = pytest.importorskip("rerun.chunk", reason="needs the extra `viewers`")
    bag, rrd = converted(recording, tmp_path / "bag.mcap"), tmp_path / "bag.rrd"
    for command in (["mcap", "convert", bag, "-o", rrd], ["rrd", "verify", rrd]):
        subprocess.run([RERUN, *command], check=True, capture_output=True)
    names, shapes, frames = {}, set(), set()
    for chunk in chunks.McapReader(bag).stream():
        of = chunk.to_record_batch().to_pydict()
        for row in of.get("SeriesLines:names", ()):
            names[chunk.entity_path] = row
        shapes |= {chunk.entity_path} if "Cylinders3D:lengths" in of else set()
        frames |= {one for row in of.get("Transform3D:child_frame", ()) for one in row}
    assert names["/robot_4/joint_states/position"] == ["shoulder", "elbow"]
    assert names["/robot_1/reference/velocity"] == ["q[1]", "q[2]"]
    robots = ["target", *(f"robot_{i}" for i in range(1, 5))]
    links = [(robot, f"link_{link}") for robot in robots for link in (1, 2)]
    assert shapes == {
        f"/{robot}/visual_geometries/{robot}\\/{link}/visual_1" for robot, link in links
    }
    assert frames >= {f"{robot}/{link}" for robot, link in links}
