"""What docs/tools.md says of other tools is done as it says, where they are installed."""

import ast
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from nrs_cosim.orchestrator.report.foxglove import Foxglove
from nrs_cosim.recordings import Recording
from tests.command import nrs
from tests.network.ports import free_port

PAGE = (Path(__file__).parents[1] / "docs/tools.md").read_text("utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder in which the page's commands were given."""
    folder = tmp_path_factory.mktemp("tools")
    (folder / "scenarios").symlink_to(Path(__file__).parents[1] / "scenarios")
    (session,) = blocks("console")
    for line in session.splitlines():
        program, *arguments = shlex.split(line.removeprefix("$ "))
        assert program == "nrs"
        done = nrs(*arguments, cwd=folder)
        assert done.returncode == 0, done.stderr
    return folder


def test_the_bag_is_read_without_ros(folder):
    pytest.importorskip("rosbags.highlevel", reason="needs rosbags, of the extra `test`")
    (program,) = [block for block in blocks("python") if "rosbags" in block]
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=True
    )
    lines = done.stdout.splitlines()
    with Recording(folder / "run.mcap") as recording:
        states = recording.states(3, end=0.1)
    assert len(lines) == len(states) == 5
    for line, state in zip(lines, states, strict=True):
        time, names, numbers = re.fullmatch(r"(\S+) (\[.*?'\]) \[(.*)\]", line).groups()
        assert (float(time), ast.literal_eval(names)) == (state["t"], ["q[1]", "q[2]"])
        assert [float(x) for x in numbers.split()] == pytest.approx(state["position"].tolist())


def test_eleven_lines_receive_what_is_published(folder):
    (program,) = [block for block in blocks("python") if "zenoh" in block]
    assert len([line for line in program.splitlines() if line]) == 11
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    program = program.replace("tcp/127.0.0.1:7447", endpoint)
    publish = ("replay", "run.mcap", "--publish", "--as-fast-as-possible", "--insecure-tcp")
    command = [Path(sys.executable).with_name("nrs"), *publish, "--listen", endpoint]
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True) as publisher:
        assert "waiting for a subscriber" in publisher.stderr.readline()
        with subprocess.Popen(
            [sys.executable, "-u", "-c", program], stdout=subprocess.PIPE, text=True
        ) as subscriber:
            lines = [subscriber.stdout.readline() for _ in range(3)]
            subscriber.kill()
        publisher.kill()
    with Recording(folder / "run.mcap") as recording:
        states = recording.states(3, end=0.06)
    for line, state in zip(lines, states, strict=True):
        encoding, time, numbers = line.split(" ", 2)
        assert encoding == "application/protobuf;nrs.State"
        assert (float(time), ast.literal_eval(numbers)) == (state["t"], state["position"].tolist())


def test_a_websocket_client_receives_a_replay(folder):
    pytest.importorskip("foxglove", reason="needs foxglove-sdk, of the extra `foxglove`")
    pytest.importorskip("websockets", reason="needs websockets, of the extra `test`")
    (program,) = [block for block in blocks("python") if "websockets" in block]
    with Foxglove(0) as view, Recording(folder / "run.mcap") as recording:
        states = recording.states(3)
        view.replay(folder / "run.mcap", 0, int(states["time_ns"][-1]), 1e5)
        view.wait_until_served()
        program = program.replace("ws://127.0.0.1:8765", view.address)
        with subprocess.Popen(
            [sys.executable, "-u", "-c", program], stdout=subprocess.PIPE, text=True
        ) as client:
            lines = [client.stdout.readline() for _ in range(len(states) + 1)]
            client.kill()
    assert lines[0] == "run.mcap\n"
    assert [int(line.split()[1]) for line in lines[1:]] == states["time_ns"].tolist()
