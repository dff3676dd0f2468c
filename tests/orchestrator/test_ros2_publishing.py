"""Messages of ROS 2 come over Zenoh in the form that rmw_zenoh documents, a bag's very bytes."""

import re
import struct
from queue import SimpleQueue

import pytest
import zenoh
from zenoh.ext import HistoryConfig, Int64, declare_advanced_subscriber, z_deserialize

from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.orchestrator.engine.in_process import in_process
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.replay.publish import as_ros2
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.ros2.conversion import convert
from tests.guard import GUARD
from tests.network.ports import free_port
from tests.scenarios import example

highlevel = pytest.importorskip("rosbags.highlevel", reason="needs rosbags, of the extra `test`")
typesys = pytest.importorskip("rosbags.typesys", reason="needs rosbags, of the extra `test`")
STORE = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
DOMAIN, EPOCH = 7, 1_000_000_000
LATCHED = ("/tf_static", "/robot_description")


def opened(port):
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["tcp/127.0.0.1:{port}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def wire(name):
    """Return what rmw_zenoh calls a type: of DDS's namespace, its slashes two colons."""
    package, folder, kind = name.split("/")
    return f"{package}::{folder}::dds_::{kind}_"


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    """Return a bag's topics and messages; what came over Zenoh; who was alive; what came late."""
    folder = tmp_path_factory.mktemp("ros2")
    lossy = example("paper_lossy_links", {"run.duration": 0.3})
    run(lossy, folder / "run.mcap", in_process(lossy))
    port, received, late = free_port(), SimpleQueue(), SimpleQueue()
    with Reader(folder / "run.mcap") as reader:
        convert(reader, folder / "bag", epoch_ns=EPOCH)
        endpoints = Endpoints(listen=(f"tcp/127.0.0.1:{port}",), insecure_tcp=True)
        with (
            as_ros2(reader, endpoints, domain=DOMAIN, epoch_ns=EPOCH) as publication,
            opened(port) as session,
        ):
            subscriber = session.declare_subscriber(f"{DOMAIN}/**", received.put)
            assert publication.wait_for_listener(GUARD)
            count = publication.publish(None, lambda _seconds: None)
            came = [received.get(timeout=GUARD) for _ in range(count)]
            assert received.empty()
            subscriber.undeclare()
            alive = [str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/**")]
            with opened(port) as other:
                declare_advanced_subscriber(
                    other, f"{DOMAIN}/tf_static/**", late.put, history=HistoryConfig()
                )
                last = late.get(timeout=GUARD)
    with highlevel.AnyReader([folder / "bag"], default_typestore=STORE) as bag:
        messages = [(c.topic, c.msgtype, bytes(raw)) for c, _, raw in bag.messages()]
        topics = {c.topic: c.msgtype for c in bag.connections}
    return topics, messages, came, alive, last


def test_each_message_of_a_bag_comes_on_its_key_and_no_other(published):
    topics, messages, came, _, last = published
    prefix = {
        f"{DOMAIN}{topic}/{wire(kind)}/{STORE.hash_rihs01(kind)}": topic
        for topic, kind in topics.items()
    }
    found = [(prefix[str(sample.key_expr)], sample.payload.to_bytes()) for sample in came]

    def by_topic(pairs):
        return {topic: [data for on, data in pairs if on == topic] for topic in topics}

    assert by_topic(found) == by_topic([(topic, data) for topic, _, data in messages])
    assert {str(sample.encoding) for sample in came} == {"application/cdr"}
    assert [last.payload.to_bytes()] == by_topic(found)["/tf_static"]
    kinds = {topics[topic] for topic, _ in found}
    assert {kind.rpartition("/")[2] for kind in kinds} == {
        "JointState", "Log", "String", "TFMessage",
    }  # fmt: skip
    for topic, data in found:
        assert STORE.deserialize_cdr(data, topics[topic]) is not None


def test_attachments_count_the_messages_of_each_publisher_and_say_when(published):
    _, _, came, _, _ = published
    seen = {}
    for sample in came:
        data = sample.attachment.to_bytes()
        number, at, gid = z_deserialize(tuple[Int64, Int64, bytes], zenoh.ZBytes(data))
        assert data == struct.pack("<qqB", number, at, 16) + gid
        seen.setdefault(str(sample.key_expr), []).append((int(number), int(at), gid))
    for rows in seen.values():
        numbers, times, gids = zip(*rows, strict=True)
        assert numbers == (*range(1, len(rows) + 1),)
        assert sorted(times) == [*times]
        assert len({*gids}) == 1
    assert len({rows[0][2] for rows in seen.values()}) == len(seen)


def test_a_node_and_a_publisher_of_each_topic_are_alive(published):
    topics, _, _, alive, _ = published
    session = rf"@ros2_lv/{DOMAIN}/([0-9a-f]+)/0/(\d+)"
    (node,) = [key for key in alive if "/NN/" in key]
    zid = re.fullmatch(rf"{session}/NN/%/%/nrs", node)[1]
    publishers = [re.fullmatch(rf"{session}/MP/%/%/nrs/(.*)", key) for key in alive if key != node]
    assert {found[1] for found in publishers} == {zid}
    assert len({found[2] for found in publishers} | {"0"}) == len(topics) + 1
    expected = set()
    for topic, kind in topics.items():
        policy = ":1:,1:,:,:,," if topic.endswith(LATCHED) else "::,10:,:,:,,"
        name = topic.replace("/", "%")
        expected.add(f"{name}/{wire(kind)}/{STORE.hash_rihs01(kind)}/{policy}")
    assert {found[3] for found in publishers} == expected
