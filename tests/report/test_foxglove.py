"""`--foxglove` serves from a process of its own, whose end is no run's."""

import socket

import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.engine.in_process import in_process
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.report.foxglove import Foxglove
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.robots.placed import shown_robots
from tests.scenarios import paper

pytest.importorskip("foxglove", reason="needs foxglove-sdk, of the extra `foxglove`")
from nrs_cosim.recordings.export.scene import ERRORS, write_scene
from tests.recordings.foxglove_client import Client

TOPICS = ["/robot_1/state", ERRORS]


def test_who_comes_late_has_a_run_from_its_beginning_and_a_replay_begins_with_who_listens(
    tmp_path, capsys
):
    path, short = tmp_path / "run.mcap", paper({"run.duration": 1.0})
    path.write_bytes(b"what was here before")

    def received(view):
        with Client(view.address) as client:
            client.until(lambda: client.channels.keys() >= {*TOPICS}).subscribe(TOPICS)
            client.until(lambda: len(client.messages) >= len(expected))
            return sorted(client.messages)

    with Foxglove(0) as view:
        view.begin(path, path)
        run(short, path, in_process(short))
        with Reader(path) as reader:
            target_at, end = experiment_of(reader).target_at, reader.end_ns
            write_scene(reader, tmp_path / "scene.mcap", shown_robots(reader), target_at)
        with Reader(tmp_path / "scene.mcap") as scene:
            expected = sorted((m[1], m[0], m[3]) for m in scene.messages(TOPICS))
        assert {topic for topic, *_ in expected} == {*TOPICS}
        assert view.is_served()
        assert received(view) == expected
    with Foxglove(0) as again:
        again.replay(path, 0, end, 1e5)
        assert received(again) == expected
    assert (view.process.returncode, again.process.returncode) == (0, 0)
    printed = capsys.readouterr().err.splitlines()
    assert printed == [f"foxglove: {served.address}" for served in (view, again)]


def test_a_port_that_is_taken_is_bad_input(tmp_path):
    with (
        socket.create_server(("127.0.0.1", 0)) as other,
        Foxglove(other.getsockname()[1]) as view,
        pytest.raises(InputError, match=r"^--port \d+: .*in use"),
    ):
        view.begin(tmp_path / "a.mcap", tmp_path / "a.mcap")
