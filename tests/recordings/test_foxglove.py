"""A client of Foxglove's protocol has each message of a recording, of a run, and no file else."""

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from threading import Event, Thread

import pytest

from nrs_cosim.orchestrator.engine.in_process import in_process
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.mcap.growing import GrowingReader
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.robots.placed import own_urdf, placed_robots
from tests.recordings.made_up_runs import recorded
from tests.scenarios import example, paper

foxglove = pytest.importorskip("foxglove", reason="needs foxglove-sdk, of the extra `foxglove`")

from nrs_cosim.recordings.foxglove import live  # noqa: E402
from nrs_cosim.recordings.foxglove.replay import Player  # noqa: E402
from nrs_cosim.recordings.foxglove.server import HOST, Server  # noqa: E402
from tests.recordings.foxglove_client import PAUSE, PLAY, Client, schema_of  # noqa: E402

DRAWN = ("/scene", "/tf")
FAST = 1e5


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return a recording of six arms whose links lose samples."""
    path = tmp_path_factory.mktemp("foxglove") / "run.mcap"
    lossy = example("paper_lossy_links", {"run.duration": 0.6})
    run(lossy, path, in_process(lossy))
    return path


def client_of(server):
    return Client(f"ws://{HOST}:{server.port}")


def by_topic(messages):
    """Return the messages of each topic of a recording, in their order."""
    found = {}
    for topic, *message in messages:
        if topic not in DRAWN:
            found.setdefault(topic, []).append(tuple(message))
    return found


def recorded_by_topic(path, start_ns=None):
    with Reader(path) as reader:
        return by_topic((m[1], m[0], m[3]) for m in reader.messages(None, start_ns))


class Replay:
    """A replay in this process, and a client that has told it to wait."""

    def __init__(self, path):
        self.reader = Reader(path)
        start, self.end = self.reader.start_ns, self.reader.end_ns
        self.player = Player(self.reader, start, self.end, 1.0)
        self.server = Server(self.reader, 0, played=(start, self.end), control=self.player.control)
        self.over = Event()

    def __enter__(self):
        self.playing = Thread(target=self.player.serve, args=[self.server, self.over])
        self.playing.start()
        self.client = client_of(self.server).__enter__()
        self.client.control(PAUSE, 1.0, request="wait")
        self.client.answer("wait")
        topics = {channel.topic for channel in self.reader.channels} | {*DRAWN}
        self.client.until(lambda: self.client.channels.keys() >= topics)
        self.client.subscribe(topics)
        return self

    def __exit__(self, *_):
        self.client.__exit__(None, None, None)
        self.over.set()
        self.playing.join()
        self.server.__exit__()
        self.reader.close()

    def play(self, request, until):
        """Play on, and wait for the end, and until the messages that came are so many."""
        self.client.control(PLAY, FAST, request=request)
        self.client.until(
            lambda: self.client.playback[-1][0] == "ended" and until(self.client.messages)
        )


def drawn(path, start_ns=0):
    """Return how many messages there are of what is drawn from a time on."""
    with Reader(path) as reader:
        moved = {(m[1], m[0]) for m in reader.messages(["/robot_1/state", "/target/sample"])}
    return sum(time_ns >= start_ns for _, time_ns in moved)


def test_a_client_has_every_message_of_a_replay_and_the_robots_where_they_were(recording):
    with Replay(recording) as replay:
        client, reader = replay.client, replay.reader
        count = reader.message_count + drawn(recording) + 2
        replay.play("go", lambda found: len(found) >= count)
        assert {*client.info["capabilities"]} == {"time", "assets", "playbackControl"}
        assert by_topic(client.messages) == recorded_by_topic(recording)
        for channel in reader.channels:
            offered = client.channels[channel.topic]
            assert (offered["encoding"], offered["schemaName"]) == ("protobuf", channel.schema_name)
            (schema,) = [one for one in reader.schemas if one.name == channel.schema_name]
            assert schema_of(offered) == schema.data
        assert "/errors" not in client.channels  # nobody has said where the target is
        shown = Counter(topic for topic, *_ in client.messages if topic in DRAWN)
        assert shown == {"/scene": 1, "/tf": 1 + drawn(recording)}
        assert client.times == sorted({m[1] for m in client.messages})
        assert client.answer("go")[:2] == ("playing", reader.start_ns)
        assert client.playback[-1][:2] == ("ended", reader.end_ns)


def test_a_replay_pauses_seeks_and_plays_at_another_speed(recording):
    half = 300_000_000
    rest = recorded_by_topic(recording, half)
    with Replay(recording) as replay:
        client = replay.client
        count = replay.reader.message_count + drawn(recording) + 2
        replay.play("all", lambda found: len(found) >= count)
        client.control(PLAY, FAST, request="nothing is left")
        assert client.answer("nothing is left")[0] == "ended"
        client.messages.clear()
        client.control(PAUSE, 2.0, half, "sought")
        assert client.answer("sought") == ("paused", half, 2.0, True, "sought")
        client.until(
            lambda: {"/robot_1/state", "/target/sample"} <= {m[0] for m in client.messages}
        )
        assert all(time_ns < half for _, time_ns, _ in client.messages)
        count = sum(map(len, rest.values())) + drawn(recording, half)
        replay.play("on", lambda found: sum(m[1] >= half for m in found) >= count)
        assert by_topic(m for m in client.messages if m[1] >= half) == rest
        assert client.playback[-1][2] == pytest.approx(FAST)


def test_a_speed_that_is_none_changes_none(recording):
    with Replay(recording) as replay:
        for speed in (0.0, -1.0, float("nan"), float("inf")):
            replay.client.control(PAUSE, speed, request=str(speed))
            assert replay.client.answer(str(speed))[2] == 1.0


def test_assets_are_the_urdfs_of_the_robots_and_nothing_else(recording, tmp_path):
    secret = tmp_path / "secret.urdf"
    secret.write_text("<robot/>", "utf-8")
    with Replay(recording) as replay:
        (name,) = [n for n in replay.reader.attachments if n.endswith(".urdf")]
        arm = "package://nrs/robot_2.urdf"
        wrong = [
            str(secret),
            f"file://{secret}",
            f"package://nrs/{secret}",
            f"package://nrs/../../..{secret}",
            f"package://nrs/robot_2.urdf/../..{secret}",
            f"package://nrs/%2e%2e{secret}",
            f"{arm}\0",
            f"{arm}?",
            "package://nrs/",
            "package://nrs/robot_7.urdf",
            "package://other/robot_2.urdf",
            "file:///etc/passwd",
            "",
            name,
        ]
        for number, uri in enumerate([arm, "package://nrs/target.urdf", *wrong]):
            replay.client.send("fetchAsset", uri=uri, requestId=number)
            replay.client.until(lambda n=number: n in replay.client.assets)
        target, _, robot, *_ = placed_robots(replay.reader)
        found = [*replay.client.assets.values()]
        assert found[:2] == [own_urdf(robot).encode(), own_urdf(target).encode()]
        assert found[2:] == [None] * len(wrong)


def test_a_client_has_every_message_of_a_run_as_it_goes_on(tmp_path):
    path, over, short = tmp_path / "run.mcap", Event(), paper({"run.duration": 1.0})
    with ExitStack() as stack:
        clients = []
        stack.callback(over.set)

        def watch(_time_ns):
            if not clients:  # the head is in the file
                growing = stack.enter_context(GrowingReader(path))
                server = stack.enter_context(Server(growing, 0))
                client = stack.enter_context(client_of(server))
                topics = {*growing.topics.values(), *DRAWN}
                has_listeners = lambda: server.subscriptions == len(topics)  # noqa: E731
                follower = ThreadPoolExecutor(1)
                following = follower.submit(live.follow, growing, server, over, has_listeners)
                stack.callback(following.result)
                client.until(lambda: client.channels.keys() >= topics)
                client.subscribe(topics)
                clients.append(client)

        run(short, path, in_process(short), watch=watch)
        over.set()
        (client,) = clients
        count = sum(map(len, recorded_by_topic(path).values())) + drawn(path) + 2
        client.until(lambda: len(client.messages) >= count)
        assert by_topic(client.messages) == recorded_by_topic(path)
        client.close()
    run(short, tmp_path / "alone.mcap", in_process(short))
    with Reader(path) as watched, Reader(tmp_path / "alone.mcap") as alone:
        assert watched.digest == alone.digest


def test_a_client_that_reads_nothing_holds_nobody_up_and_is_told_of(tmp_path, monkeypatch):
    monkeypatch.setattr(live, "LINGER", 0.0)
    path, behind, over = tmp_path / "run.mcap", Event(), Event()
    recorded(path, m=80, ticks=400)  # more than what a socket's buffers take
    over.set()
    with (
        GrowingReader(path) as growing,
        Server(growing, 0, falls_behind=behind.set, backlog=64) as server,
        client_of(server) as slow,
    ):
        slow.until(lambda: "/robot_6/state" in slow.channels)
        slow.subscribe(f"/robot_{robot}/state" for robot in range(1, 7))
        with server.changed:
            server.changed.wait_for(lambda: server.subscriptions == 6)
        live.follow(growing, server, over, lambda: True)
        assert growing.is_whole
    assert behind.is_set()
