"""A scene shows every robot by its name, with or without a URDF, from t = 0 on, in a layout."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from typer.testing import CliRunner

from nrs_cosim.orchestrator.cli.main import app
from nrs_cosim.orchestrator.engine.in_process import in_process
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.export.scene_layout import scene_layout
from nrs_cosim.recordings.mcap.reader import Reader
from tests.recordings.made_up_runs import recorded
from tests.scenarios import example


def decoded(path: Path, topic: str) -> list[tuple[int, Any]]:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [
            (message.log_time, value)
            for _, _, message, value in reader.iter_decoded_messages([topic])
        ]


def scene_of(path: Path) -> Path:
    out = path.with_name("scene.mcap")
    result = CliRunner().invoke(app, ["scene", str(path), "-o", str(out)])
    assert result.exit_code == 0, result.output
    return out


def labels(scene: Path) -> dict[str, str]:
    ((_, update),) = decoded(scene, "/scene")
    return {entity.frame_id: text.text for entity in update.entities for text in entity.texts}


@pytest.fixture(scope="module")
def lossy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a short run with faults on its links."""
    experiment = example("paper_lossy_links", {"run.duration": 3.0})
    path = tmp_path_factory.mktemp("lossy") / "lossy.mcap"
    return run(experiment, path, in_process(experiment)).path


def test_errors_and_link_events_are_beside_the_arms(lossy: Path) -> None:
    scene = scene_of(lossy)
    names = {f"robot_{i}/base": f"robot {i}" for i in range(1, 7)}
    assert set(labels(scene).values()) == {"target", *names.values()}
    with Recording(lossy) as recording:
        states, events = recording.states(), recording.link_events()
    errors = decoded(scene, "/errors")
    assert [time for time, _ in errors] == np.unique(states["time_ns"]).tolist()
    t = states["t"]
    truth = np.stack([2 * t + np.sin(t), -2 * t - np.cos(t)], axis=1)
    for name, order, of in (
        ("position_tracking", 2, "position"),
        ("position_estimate", np.inf, "reference_position"),
    ):
        seen = [list(getattr(message, name)) for _, message in errors]
        expected = np.linalg.norm(states[of] - truth, order, axis=1).reshape(-1, 6)
        np.testing.assert_allclose(seen, expected, rtol=1e-12, atol=1e-14)
    logged = sorted((time, log.name) for time, log in decoded(scene, "/link_events"))
    assert logged == sorted((int(e["time_ns"]), f"robot_{e['robot']}") for e in events)
    moved = [
        one.child_frame_id
        for time, at in decoded(scene, "/tf")
        if time == 0
        for one in at.transforms
    ]
    assert {name.split("/")[0] for name in moved} == {"target", *(n.split("/")[0] for n in names)}


def test_robots_without_a_urdf_are_named_points_in_joint_space(tmp_path: Path) -> None:
    recorded(tmp_path / "a.mcap", n=2, m=2, ticks=3)
    scene = scene_of(tmp_path / "a.mcap")
    assert labels(scene) == {
        "target/point": "target", "robot_1/point": "robot 1", "robot_2/point": "robot 2"
    }  # fmt: skip
    with Recording(tmp_path / "a.mcap") as recording:
        states = recording.states()
    places: dict[tuple[int, str], dict[str, float]] = {}
    for time, at in decoded(scene, "/tf"):
        for one in at.transforms:
            robot, link = one.child_frame_id.split("/")
            axis = {"joint_1": "x", "point": "y"}.get(link)
            if axis:
                places.setdefault((time, robot), {})[axis] = getattr(one.translation, axis)
    for row in states:
        at = places[int(row["time_ns"]), f"robot_{row['robot']}"]
        assert [at["x"], at["y"]] == row["position"].tolist()
    assert {time for time, robot in places if robot == "target"} == {*states["time_ns"].tolist()}


def leaves(tree: Any) -> list[str]:
    return [tree] if isinstance(tree, str) else [*leaves(tree["first"]), *leaves(tree["second"])]


def test_a_layout_beside_a_scene_shows_all_of_its_topics(lossy: Path) -> None:
    scene = lossy.with_name("scene.mcap")
    if not scene.exists():
        scene_of(lossy)
    layout = json.loads(scene.with_suffix(".layout.json").read_text())
    panels = layout["configById"]
    assert sorted(leaves(layout["layout"])) == sorted(panels)
    with Reader(scene) as reader:
        there = {channel.topic for channel in reader.channels}
    topics = {
        path["value"].split(".")[0] for name in panels for path in panels[name].get("paths", ())
    }
    assert {
        *topics,
        *panels["3D!robots"]["topics"],
        panels["RosOut!events"]["topicToRender"],
    } <= there
    assert len(panels["Plot!tracking"]["paths"]) == 6


def test_a_layout_has_the_fields_that_foxglove_documents() -> None:
    layouts = pytest.importorskip("foxglove.layouts", reason="needs the extra `foxglove`")
    made = scene_layout(range(1, 1001), 3.0, events=True)["configById"]
    config, camera = layouts.ThreeDeeConfig(), layouts.ThreeDeeCameraState()
    kinds = {"3D": config, "Plot": layouts.PlotConfig(), "RosOut": layouts.LogConfig()}
    for name, panel in made.items():
        known = kinds[name.split("!")[0]]._to_dict().keys() | {"foxglovePanelTitle"}
        assert panel.keys() <= known
    assert made["3D!robots"]["cameraState"].keys() <= camera._to_dict().keys()
    for path in made["Plot!tracking"]["paths"]:
        assert path.keys() <= layouts.PlotSeries()._to_dict().keys()
    shown = [path["label"] for path in made["Plot!estimates"]["paths"]]
    assert (len(shown), shown[0]) == (24, "robot 1")
