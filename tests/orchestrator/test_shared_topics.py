"""Robots that share topics are read as robots that do not, by everything that reads a recording.

The oracle is the same run in the layout of few robots, whose files others' readers hold to.
"""

import json
from pathlib import Path

import pytest

from nrs_cosim.bus import topics
from nrs_cosim.bus.messages import HEADER
from nrs_cosim.bus.topics import Topics
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.mcap.container import MOST_CHANNELS
from nrs_cosim.recordings.mcap.reader import Reader
from tests.command import nrs
from tests.scenarios import example

SHORT = {"run.duration": 0.4, "run.checkpoint_every": 2}
RUNS = {"paper_lossy_links": SHORT, "compare_kalman_consensus": SHORT}
TABLES = ("samples", "states", "agent_states", "measurements", "link_events")
LAYOUTS = ("alone", "shared")


def share(patch: pytest.MonkeyPatch) -> None:
    """Let robots share topics where there are more than four, four each."""
    patch.setattr(topics, "MOST_ALONE", 4)
    patch.setattr(topics, "TOGETHER", 4)


@pytest.fixture(scope="module", params=RUNS)
def folder(request, tmp_path_factory) -> Path:
    """Return a folder with one run in both layouts."""
    place, of = tmp_path_factory.mktemp("runs"), example(request.param, RUNS[request.param])
    assert run(of, place / "alone.mcap").status == "completed"
    with pytest.MonkeyPatch.context() as patch:
        share(patch)
        assert run(of, place / "shared.mcap").status == "completed"
    return place


def test_topics_are_of_as_many_robots_as_they_name(folder):
    with Reader(folder / "shared.mcap", verify=True) as reader:
        assert not reader.damage
        names = {*reader.topics.values()}
        assert {"/target/sample", "/robots_1_4/state", "/robots_5_6/state"} < names
        assert not [name for name in names if name.startswith("/robot_")]
        for _, topic, _, data in reader.messages():
            if topic != "/target/sample":
                first, last = map(int, topic.split("/")[1].split("_")[1:])
                assert first <= HEADER.unpack_from(data)[0] <= last


@pytest.mark.parametrize("robots", [None, {2, 5}, {6}, set()])
def test_arrays_are_the_same(folder, robots):
    with Recording(folder / "alone.mcap") as alone, Recording(folder / "shared.mcap") as shared:
        assert (shared.robots, shared.ticks) == (alone.robots, alone.ticks)
        for table in TABLES:
            expected, found = (getattr(one, table)(robots) for one in (alone, shared))
            assert found.tobytes() == expected.tobytes()
        assert sum(len(getattr(alone, table)()) > 0 for table in TABLES) > 2


@pytest.mark.parametrize(
    "command", ["export RUN -o OUT", "convert RUN --to ros2 -o OUT --robots 2,5"]
)
def test_files_made_of_them_are_the_same(folder, tmp_path, command):
    made = []
    for layout in LAYOUTS:
        words = command.replace("RUN", str(folder / f"{layout}.mcap"))
        assert nrs(*words.replace("OUT", str(tmp_path / layout)).split()).returncode == 0
        files = (path for path in (tmp_path / layout).rglob("*") if path.is_file())
        made.append(
            {
                path.name.replace(layout, ""): path.read_bytes().replace(layout.encode(), b"")
                for path in files
            }
        )
    assert made[0] == made[1] != {}


def test_what_is_said_of_them_is_the_same_but_for_the_digest(folder):
    said = [
        json.loads(nrs("info", folder / f"{layout}.mcap", "--json").stdout) for layout in LAYOUTS
    ]
    assert said[0]["digest"] != said[1]["digest"]
    for of in said:
        for own in ("digest", "digest_here", "file", "spent"):
            of.pop(own, None)
    assert said[0] == said[1] != {}


@pytest.mark.parametrize("options", [[], ["--agents-only"]])
def test_they_are_verified_by_running_them_again(folder, monkeypatch, options):
    share(monkeypatch)
    done = nrs("replay", folder / "shared.mcap", "--verify", *options)
    assert done.returncode == 0, done.stderr
    assert "identical" in done.stdout


def test_a_run_goes_on_to_the_same_digest(folder, monkeypatch, tmp_path):
    share(monkeypatch)
    whole = (folder / "shared.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    done = nrs("resume", tmp_path / "cut.mcap", "-o", tmp_path / "again.mcap", "--json")
    assert done.returncode == 0, done.stderr
    with Reader(folder / "shared.mcap") as reader:
        assert json.loads(done.stdout)["digest"] == reader.digest


@pytest.mark.parametrize(
    ("n", "robots", "together", "topic"),
    [
        (1, 1, 1, "/robot_1/state"),
        (10_000, 10_000, 1, "/robot_10000/state"),
        (10_001, 10_001, 1000, "/robots_10001_10001/state"),
        (100_000, 1000, 1000, "/robots_1_1000/state"),
        (100_000, 1001, 1000, "/robots_1001_2000/state"),
        (99_999, 99_999, 1000, "/robots_99001_99999/state"),
        (30_000_000, 1, 3000, "/robots_1_3000/state"),
    ],
)
def test_a_recording_has_room_for_any_number_of_robots(n, robots, together, topic):
    of = Topics.of_run(n)
    assert (of.together, of.of("state", robots), of.of("sample", 0)) == (
        together,
        topic,
        "/target/sample",
    )
    assert robots in of.robots(robots)
    assert 6 * of.shared < MOST_CHANNELS
    assert Topics.among([of.of("sample", 1)], n) == of


def test_each_topic_is_given_once_with_all_that_it_is_of():
    assert dict(Topics(10, 4).each("x", [0, 2, 3, 9])) == {
        "/target/x": range(1),
        "/robots_1_4/x": range(1, 5),
        "/robots_9_10/x": range(9, 11),
    }
    of_all = dict(Topics(10, 4).each("x", range(1, 11))).values()
    assert [robot for robots in of_all for robot in robots] == [*range(1, 11)]
