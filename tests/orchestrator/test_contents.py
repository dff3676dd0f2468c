"""A message that contradicts its topic, sequence or time is refused, whatever its checksums.

One message of a run is changed, taken away or put in twice; every command must name it, or not need
it.
"""

import re
from struct import pack

import numpy as np
import pytest

from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.messages import LINK_EVENT, Codec
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.container import DamageError
from nrs_cosim.recordings.mcap.contents import Contents
from nrs_cosim.recordings.mcap.ordering import columns_of
from nrs_cosim.recordings.mcap.reader import Reader
from tests.command import nrs
from tests.orchestrator.test_replay import rewritten
from tests.scenarios import SHORT, paper

K, ROBOT = 7, 3
STATE, SAMPLE = f"/robot_{ROBOT}/state", f"/robot_{ROBOT}/sample"
FIELDS = {  # where it stands behind its tag (bus.messages), how, and what the message says
    "another robot": (1, "<I", 2, "its robot is 2, expected {robot}"),
    "no robot": (1, "<I", 0, "its robot is 0, expected {robot}"),
    "beyond all robots": (1, "<I", 2**32 - 1, "its robot is 4294967295, expected {robot}"),
    "another tick": (6, "<I", K + 1, f"its k is {K + 1}, expected {K}"),
    "another time": (11, "<Q", 5, "its time_ns is 5, expected 700000000"),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the recording of a second of the paper's example, in chunks of a tick."""
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    run(paper(SHORT, {"run.output_step": 0.1}), path)
    return path


def with_field(at, form, value):
    """Return what puts a number into a message's bytes."""

    def change(message):
        *transient, data = message
        put = pack(form, value)
        return [(*transient, data[:at] + put + data[at + len(put) :])]

    return change


def twice(message):
    return [message, message]


def missing(_message):
    return []


def cut(message):
    return [(*message[:3], message[3][:10])]


def bad(whole, path, topic, change):
    """Write the recording with the messages of a topic at tick K changed."""

    def of(tick):
        kept = []
        for message in tick:
            kept += change(message) if message[1:3] == (topic, K) else [message]
        return kept

    rewritten(whole, path, of, chunk_bytes=1)
    return path


@pytest.mark.parametrize("topic", [STATE, SAMPLE, "/target/sample"])
@pytest.mark.parametrize("field", FIELDS)
def test_a_field_that_contradicts_its_message_is_damage_of_its_tick(whole, tmp_path, topic, field):
    at, form, value, says = FIELDS[field]
    robot = {"/target/sample": 0}.get(topic, ROBOT)
    if (field, robot) == ("no robot", 0):
        value, says = 1, "its robot is 1, expected {robot}"
    path = bad(whole, tmp_path / "bad.mcap", topic, with_field(at, form, value))
    result = f"a message of {topic} at tick {K}, t = 0.7 s: {says.format(robot=robot)}"
    with Reader(path, verify=True) as reader:
        assert result in reader.damage[0]
        assert reader.ticks == 9
        assert f"tick {K} is missing" in reader.damage
    with Reader(path) as reader, pytest.raises(UnreadableError, match=re.escape(result)):
        list(reader.columns())


def test_a_link_event_of_an_unknown_source_is_damage():
    ours = Contents({1: "/robot_1/link_event"}, 6)
    for source, holds in ((0, True), (6, True), (7, False)):
        codec = Codec(LINK_EVENT, Sizes(2))
        records = codec.blank(np.array([1]))
        records["source"] = source
        (data,) = codec.encode(records)
        columns = columns_of([(0, "/robot_1/link_event", 0, data)], {"/robot_1/link_event": 1})
        if holds:
            ours.expect(columns)
            continue
        with pytest.raises(DamageError, match="its source is 7, expected at most 6"):
            ours.expect(columns)


def commands(path, folder, other):
    """Yield the name of each command that reads a recording, and what it comes to."""
    folder.mkdir()
    what_if = ("--plant", "robots=1,controller.kp=150.0", "-o", folder / "if.mcap")
    yield "info", nrs("info", path, "--json")
    yield "export", nrs("export", path, "-o", folder / "tables")
    yield "report", nrs("report", path, "-o", folder / "page.html")
    yield "diff", nrs("diff", path, other)
    yield "recover", nrs("recover", path, "-o", folder / "new.mcap")
    yield "verify", nrs("replay", path, "--verify")
    yield "agents", nrs("replay", path, "--verify", "--agents-only")
    yield "what if", nrs("replay", path, *what_if)


MISSED = f"{SAMPLE} at tick {K}, t = 0.7 s: "


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (with_field(1, "<I", 2), f"{MISSED}its robot is 2, expected {ROBOT}"),
        (twice, f"{MISSED}it is there twice"),
        (cut, f"{MISSED}it is cut"),
    ],
    ids=["robot", "twice", "cut"],
)
def test_every_command_names_the_damage_and_recover_keeps_the_rest(whole, tmp_path, change, says):
    path = bad(whole, tmp_path / "bad.mcap", SAMPLE, change)
    for name, done in commands(path, tmp_path / "out", whole):
        assert says in done.stderr + done.stdout, (name, done)
        assert done.returncode == {"recover": 0, "verify": 1, "agents": 1}.get(name, 2), name
    with Reader(tmp_path / "out" / "new.mcap", verify=True) as reader:
        assert (reader.ticks, reader.digest) == (9, None)
        assert K not in {k for *_, k, _ in reader.messages()}


def test_a_missing_state_is_not_recomputed(whole, tmp_path):
    path = bad(whole, tmp_path / "bad.mcap", STATE, missing)
    found = dict(commands(path, tmp_path / "out", whole))
    for name in ("verify", "agents", "diff"):
        assert found[name].returncode == 1
        assert (
            f"tick {K}, t = 0.7 s: {STATE}, message of robot {ROBOT}"
            in found[name].stdout + found[name].stderr
        )
    assert found["what if"].returncode == 2
    assert f"tick {K}, t = 0.7 s: has no message of {STATE}" in found["what if"].stderr


def test_a_replay_reports_a_missing_sample(whole, tmp_path):
    path = bad(whole, tmp_path / "bad.mcap", SAMPLE, missing)
    for options in ((), ("--agents-only",)):
        done = nrs("replay", path, "--verify", *options)
        assert done.returncode == 1
        assert f"{SAMPLE}, message of robot {ROBOT} is in " in done.stderr
        assert " and not in the recording" in done.stderr


@pytest.mark.parametrize("way", [["--foxglove"], ["--publish", "--insecure-tcp"]])
def test_what_is_missing_is_said_before_a_recording_is_played(whole, tmp_path, way):
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole.read_bytes()[:-2000])
    with Reader(path) as reader:
        (damage, *_) = reader.damage
    done = nrs("replay", path, *way, "--from", "1000")  # after its end: nothing is played
    assert (done.returncode, f"damage: {damage}" in done.stderr) == (2, True), done.stderr
    assert "error: --from 1000: nothing of the recording, which ends at" in done.stderr
