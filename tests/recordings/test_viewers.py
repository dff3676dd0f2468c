"""A recording of the paper's example opens elsewhere, with our counts and our numbers."""

import hashlib
import json
import shutil
import subprocess
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from nrs_cosim.orchestrator.engine.in_process import in_process
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import describe, experiment_of
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.plant_fmu.bundled.model_urdf import model_urdf
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.errors import UncreatableError
from nrs_cosim.recordings.export.scene import write_scene
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import URDFS
from nrs_cosim.recordings.robots.placed import placed_robots
from tests.guard import GUARD
from tests.orchestrator.test_assets import again
from tests.recordings.made_up_runs import recorded
from tests.recordings.transforms import matrix

SCENARIOS = Path(__file__).parents[2] / "scenarios"


@pytest.fixture(scope="module", params=["paper_first_order", "paper_lossy_links"])
def example(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole recording of the paper's example, and of the one with faults."""
    path = tmp_path_factory.mktemp("viewers") / "run.mcap"
    file = read_scenario(SCENARIOS / f"{request.param}.toml")
    run(file, path, in_process(file))
    return path


def decoded(path: Path) -> list[tuple[str, Any, Any]]:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [(c.topic, m, value) for _, c, m, value in reader.iter_decoded_messages()]


def test_the_reference_decoder_gives_our_numbers(example: Path) -> None:
    found = decoded(example)
    with Reader(example) as reader, Recording(example) as recording:
        assert len(found) == describe(reader, experiment_of(reader))["messages"]
        for kind, table in (
            ("sample", recording.samples()),
            ("state", recording.states()),
            ("link_event", recording.link_events()),
        ):
            mine = sorted(
                (value for topic, _, value in found if topic.endswith(f"/{kind}")),
                key=lambda value: (value.time_ns, value.robot, getattr(value, "source", 0)),
            )
            assert len(mine) == len(table)
            for name in table.dtype.names:
                if name != "t" and len(table):
                    assert np.array_equal([getattr(v, name) for v in mine], table[name])


def test_rerun_loads_every_message(example: Path) -> None:
    reader = pytest.importorskip("rerun.chunk", reason="needs the extra `viewers`").McapReader
    rows: Counter[str] = Counter()
    for chunk in reader(example).stream():
        if not chunk.is_static:
            rows[chunk.entity_path] += chunk.num_rows
    with Reader(example) as ours:
        expected = Counter(topic for _, topic, _, _ in ours.messages())
        assert (
            reader(example).info().message_count == describe(ours, experiment_of(ours))["messages"]
        )
    assert {path: rows[path] for path in expected} == dict(expected)


def test_foxgloves_reader_in_node_reads_every_message(example: Path) -> None:
    """`make viewers` has its packages; they are looked for as NODE_PATH says."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node")
    needed = "require.resolve('@mcap/core'); require.resolve('fzstd')"
    if subprocess.run([node, "-e", needed], capture_output=True, check=False).returncode:
        pytest.skip("needs @mcap/core and fzstd of npm; see make viewers")
    script = Path(__file__).with_name("read_mcap.cjs")
    done = subprocess.run([node, script, example], capture_output=True, check=True, timeout=GUARD)
    data: defaultdict[str, bytes] = defaultdict(bytes)
    counts: Counter[str] = Counter()
    with Reader(example) as reader:
        for _, topic, _, content in reader.messages():
            data[topic] += content
            counts[topic] += 1
    assert json.loads(done.stdout) == {
        topic: [counts[topic], hashlib.sha256(content).hexdigest()]
        for topic, content in data.items()
    }


def test_a_scene_shows_the_arms_at_their_positions(example: Path, tmp_path: Path) -> None:
    path = tmp_path / "scene.mcap"
    with Reader(example) as reader:
        placed = placed_robots(reader)
        write_scene(reader, path, placed)
        with Reader(path, verify=True) as new:
            assert (new.digest, new.status, new.ticks) == (reader.digest, "completed", 300)
            assert new.damage == []
            ours = [channel.topic for channel in reader.channels]
            assert list(new.messages(ours)) == list(reader.messages())
        with pytest.raises(UncreatableError, match="is there already"):
            write_scene(reader, path, placed)
    found = decoded(path)
    (scene,) = [value for topic, _, value in found if topic == "/scene"]
    lengths = {e.frame_id: e.cylinders[0].size.z for e in scene.entities if e.cylinders}
    names = ["target", *(f"robot_{i}" for i in range(1, 7))]
    links = {f"{name}/link_{k}": length for name in names for k, length in ((1, 1.0), (2, 0.8))}
    assert lengths == links
    moves: dict[int, list[Any]] = {}
    for topic, message, value in found:
        if topic == "/tf":
            assert {one.timestamp.ToNanoseconds() for one in value.transforms} == {message.log_time}
            moves.setdefault(message.log_time, []).extend(value.transforms)
    still = {one.child_frame_id: one for one in moves[0]}
    with Recording(path) as recording:
        states = recording.states()
    assert moves.keys() == {*states["time_ns"].tolist()}
    for row in states[::97]:
        made = still | {one.child_frame_id: one for one in moves[int(row["time_ns"])]}
        frame, place = f"robot_{row['robot']}/tip", np.eye(4)
        while frame != "world":
            place = matrix(made[frame]) @ place
            frame = made[frame].parent_frame_id
        one, both = row["position"][0], row["position"].sum()
        x, z = np.cos(one) + 0.8 * np.cos(both), np.sin(one) + 0.8 * np.sin(both)
        assert place[[0, 2], 3] == pytest.approx([x, z], abs=1e-9)


def test_points_move_in_the_plane(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recorded(path, n=2, m=2, ticks=3)
    urdf = model_urdf("planar_robot", {}, ["joint_1", "joint_2"]).encode()
    name = f"{hashlib.sha256(urdf).hexdigest()}.urdf"
    again(
        path,
        tmp_path / "b.mcap",
        attachments=lambda kept: {**kept, name: ("application/xml", urdf)},
        records=lambda kept: {**kept, URDFS: {name: "[1, 2]"}},
    )
    with Reader(tmp_path / "b.mcap") as reader:
        write_scene(reader, tmp_path / "c.mcap", placed_robots(reader))
    with Recording(path) as recording:
        states, samples = recording.states(), recording.samples([0])
    places = {(row["time_ns"], row["robot"]): row["position"] for row in (*states, *samples)}
    shown: dict[Any, Any] = {}
    for topic, message, value in decoded(tmp_path / "c.mcap"):
        for one in value.transforms if topic == "/tf" else ():
            robot, link = one.child_frame_id.split("/")
            if link.startswith("link_"):
                at = (message.log_time, int(robot[-1]) if robot != "target" else 0)
                shift = [getattr(one.translation, axis) for axis in "xy"]
                shown[at] = np.array(shift) + shown.get(at, 0)
    assert shown.keys() == places.keys()
    assert all(shown[at].tolist() == places[at].tolist() for at in places)
