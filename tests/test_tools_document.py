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
from tests.cases import cases
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
    (program,) = [block for block in blocks("python") if "AnyReader" in block]
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


def program_with(words, address, own):
    """Return the program of the page that has some words, with another address."""
    (found,) = [block for block in blocks("python") if words in block]
    assert address in found
    return found.replace(address, own)


def first_lines(program, count):
    """Return the first lines that a program prints, which does not end by itself."""
    with subprocess.Popen(
        [sys.executable, "-u", "-c", program], stdout=subprocess.PIPE, text=True
    ) as running:
        lines = [running.stdout.readline() for _ in range(count)]
        running.kill()
    return lines


@pytest.mark.parametrize("ros2", cases([False, True], [False]))
def test_a_subscriber_receives_what_is_published(folder, ros2):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    words = "0/robot_3/joint_states" if ros2 else "nrs/*/robot_3"
    program = program_with(words, "tcp/127.0.0.1:7447", endpoint)
    assert ros2 or len([line for line in program.splitlines() if line]) == 11
    publish = ["replay", "run.mcap", "--publish", "--as-fast-as-possible", "--insecure-tcp"]
    publish += ["--ros2"] if ros2 else []
    command = [Path(sys.executable).with_name("nrs"), *publish, "--listen", endpoint]
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True) as publisher:
        assert "waiting for a subscriber" in publisher.stderr.readline()
        lines = first_lines(program, 3)
        publisher.kill()
    with Recording(folder / "run.mcap") as recording:
        states = recording.states(3, end=0.06)
    for line, state in zip(lines, states, strict=True):
        if ros2:
            found = re.fullmatch(r"(\S+) \['q\[1\]', 'q\[2\]'\] \[(.*)\]\n", line)
            time, numbers = found.groups()
            assert [float(x) for x in numbers.split()] == pytest.approx(state["position"].tolist())
        else:
            encoding, time, numbers = line.split(" ", 2)
            assert encoding == "application/protobuf;nrs.State"
            assert ast.literal_eval(numbers) == state["position"].tolist()
        assert float(time) == state["t"]


@pytest.mark.parametrize("words", cases(["websockets"], []))
def test_a_websocket_client_receives_a_replay(folder, words):
    pytest.importorskip("foxglove", reason="needs foxglove-sdk, of the extra `foxglove`")
    pytest.importorskip("websockets", reason="needs websockets, of the extra `test`")
    with Foxglove(0) as view, Recording(folder / "run.mcap") as recording:
        states = recording.states(3)
        view.replay(folder / "run.mcap", 0, int(states["time_ns"][-1]), 1e5)
        program = program_with(words, "ws://127.0.0.1:8765", view.address)
        name, *lines = first_lines(program, len(states) + 1)
    assert name == "run.mcap\n"
    assert [int(line.split()[1]) for line in lines] == states["time_ns"].tolist()
