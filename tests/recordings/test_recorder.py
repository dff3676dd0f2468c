"""What the recorder takes, lacks, closes and keeps of two workers' batches; nothing is on a
disk."""

import pytest

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.keys import EVERYONE, TARGET, topic_of, wire_key
from nrs_cosim.bus.transport import Message
from nrs_cosim.recordings import recorder as module
from nrs_cosim.recordings.channels import channels
from tests.made_up_batches import H, recorder_of, samples, tick_batch, whole, wire_of

TICKS = 40


@pytest.fixture
def wire():
    return wire_of(TICKS)


def closed(recorder, wire, until, **what):
    """Have a recorder close the ticks up to one."""
    for k in range(recorder.closed + 1, until + 1):
        for message in whole(wire, k, **what):
            recorder.take(message)
        recorder.close(k)


def test_tick_0_waits_only_for_records(wire):
    recorder, _ = recorder_of(wire)
    assert recorder.missing(0) == {"left": ["records"], "right": ["records"]}
    recorder.take(tick_batch(wire, "right", 0))
    assert recorder.missing(0) == {"left": ["records"]}
    assert not recorder.is_whole(0)
    recorder.take(tick_batch(wire, "left", 0))
    assert recorder.missing(0) == {}
    assert recorder.is_whole(0)


def test_a_later_tick_waits_for_the_batches_not_received(wire):
    recorder, _ = recorder_of(wire)
    closed(recorder, wire, 0)
    assert recorder.missing(0) == {}
    assert recorder.missing(1) == {
        "left": ["records", "samples"],
        "right": ["records", "samples"],
        TARGET: ["samples"],
    }
    for message in whole(wire, 1):
        assert not recorder.is_whole(1)
        kind, _, worker = message.key.partition("/")
        assert kind in recorder.missing(1)[worker]
        recorder.take(message)
        assert kind not in recorder.missing(1).get(worker, [])
    assert recorder.is_whole(1)


def test_a_tick_is_written_complete_with_events_and_checkpoints(wire):
    recorder, writer = recorder_of(wire, faulty=(1, 2), checkpoints=True)
    closed(recorder, wire, 0)
    closed(recorder, wire, 1, faults=2, checkpoint=True)
    kinds = ["checkpoint", "link_event", "link_event", "sample", "state"]
    topics = sorted(
        ["/target/sample", *(f"/robot_{robot}/{kind}" for kind in kinds for robot in (1, 2))]
    )
    assert writer.ticks == [
        [("/robot_1/state", 0, 0), ("/robot_2/state", 0, 0)],
        [(topic, H, 1) for topic in topics],
    ]
    assert recorder.messages == 2 + len(topics)
    assert recorder.closed == 1
    assert {robot: k for robot, (k, _) in recorder.checkpoints.items()} == {1: 1, 2: 1}


@pytest.mark.parametrize(
    ("what", "room"),
    [
        ({"faults": 1}, {"checkpoints": True}),
        ({"checkpoint": True}, {"faulty": (1, 2)}),
        ({"faults": 1}, {"faulty": (2,)}),
    ],
)
def test_a_message_without_a_channel_is_refused(wire, what, room):
    recorder, _ = recorder_of(wire, **room)
    recorder.take(tick_batch(wire, "left", 1, **what))
    assert recorder.rejected == {"topic": 1}
    assert recorder.taken == 0


def test_rejected_messages_are_counted_by_reason(wire):
    recorder, _ = recorder_of(wire)
    good = samples(wire, "left", 1)
    recorder.take(Message(good.key, good.payload[:-1]))
    recorder.take(Message(good.key, good.payload + b"\0"))
    recorder.take(Message(wire_key("samples", "nobody"), good.payload))
    recorder.take(Message(wire_key("report", "left"), good.payload))
    assert recorder.rejected == {"size": 2, "worker": 1, "key": 1}
    assert (recorder.taken, recorder.repeated) == (0, 0)


def test_a_batch_repeated_identically_is_recorded_once(wire):
    recorder, writer = recorder_of(wire)
    for k in (0, 1):
        for message in whole(wire, k) * 2:
            recorder.take(message)
        recorder.close(k)
        for message in whole(wire, k):
            recorder.take(message)
    assert (recorder.taken, recorder.repeated) == (7, 14)
    assert [len(tick) for tick in writer.ticks] == [2, 5]


@pytest.mark.parametrize("say", [samples, tick_batch])
def test_a_batch_repeated_differently_ends_the_run(wire, say):
    recorder, _ = recorder_of(wire)
    recorder.take(say(wire, "left", 1))
    with pytest.raises(BusError, match="tick 1: worker left sent it twice with other contents"):
        recorder.take(say(wire, "left", 1, value=2.0))


def test_the_last_tick_received_of_a_worker_is_known(wire):
    recorder, _ = recorder_of(wire)
    closed(recorder, wire, 2)
    for k in (5, 3):
        recorder.take(samples(wire, "left", k))
    recorder.take(tick_batch(wire, "right", 4))
    assert recorder.last_received("left") == 5
    assert recorder.last_received("right") == 2


def test_samples_of_the_last_closed_ticks_stay_in_memory(wire):
    keep = 4
    recorder, _ = recorder_of(wire, keep=keep)
    closed(recorder, wire, TICKS)
    assert len(recorder._past) == keep  # memory does not grow with the run
    at_hand = [*recorder.samples(TICKS - keep + 1, TICKS + 5)]
    assert [k for k, _, _ in at_hand] == [*range(TICKS - keep + 1, TICKS + 1)]
    for _, records, worker in at_hand:
        assert worker == EVERYONE
        assert sorted(records["robot"].tolist()) == [0, 1, 2]


def test_samples_of_open_ticks_are_by_worker(wire):
    recorder, _ = recorder_of(wire)
    closed(recorder, wire, 1)
    for k in (2, 3, 4):
        recorder.take(samples(wire, "left", k))
    known = [(k, worker) for k, _, worker in recorder.samples(1, 3)]
    assert known == [(1, EVERYONE), (2, "left"), (3, "left")]


def test_each_robot_has_its_channels_and_uncounted_ones_are_marked():
    found = channels(Codecs.of(Sizes(2)), 2, (2,), checkpoints=True)
    assert [channel.topic for channel in found if channel.counted] == [
        *(topic_of("sample", node) for node in range(3)),
        *("/robot_1/state", "/robot_2/state"),
    ]
    assert [channel.topic for channel in found if not channel.counted] == [
        *("/robot_2/link_event", "/robot_1/checkpoint", "/robot_2/checkpoint")
    ]
    kinds = {channel.topic.split("/")[2]: channel.schema_name for channel in found}
    assert kinds == {
        "sample": "nrs.Sample",
        "state": "nrs.State",
        "link_event": "nrs.LinkEvent",
        "checkpoint": "nrs.Checkpoint",
    }


class Read:
    """A reader of a made-up recording: see `recordings.mcap.reader.Reader`."""

    def __init__(self, wire, opened):
        self.wire, self.opened, self.is_open = wire, opened, True
        opened.append(self)

    def batches(self, topics, start, end):
        assert topics == ["/target/sample", "/robot_1/sample", "/robot_2/sample"]
        for k in range(-(-start // H), -(-end // H)):
            of_all = [
                self.wire.unpack_samples(worker, samples(self.wire, worker, k).payload)[1]
                for worker in ("left", "right", TARGET)
            ]
            yield [
                (k * H, topic_of("sample", robot), k, data)
                for records in of_all
                for robot, data in zip(
                    records["robot"], self.wire.samples.encode(records), strict=True
                )
            ]

    def close(self):
        self.is_open = False


def test_older_samples_are_read_from_the_flushed_file(wire, monkeypatch):
    opened, flushed = [], []
    recorder, writer = recorder_of(wire, keep=2)
    writer.flush = lambda: flushed.append(recorder.closed)
    monkeypatch.setattr(module, "Reader", lambda path: (path, Read(wire, opened))[1])
    closed(recorder, wire, 10)
    assert [k for k, _, _ in recorder.samples(9, 10)] == [9, 10]
    assert opened == []
    recorder.take(samples(wire, "left", 11))
    found = list(recorder.samples(3, 11))
    assert [(k, worker) for k, _, worker in found] == [
        *((k, EVERYONE) for k in range(3, 11)),
        (11, "left"),
    ]
    assert all(sorted(records["robot"].tolist()) == [0, 1, 2] for _, records, _ in found[:-1])
    assert [k for k, _, _ in recorder.samples(5, 7)] == [5, 6, 7]
    assert (len(opened), flushed) == (1, [10])
    closed(recorder, wire, 14)
    assert [k for k, _, _ in recorder.samples(8, 13)] == [*range(8, 14)]
    assert [reader.is_open for reader in opened] == [False, True]
    assert flushed == [10, 14]
    recorder.end()
    assert [reader.is_open for reader in opened] == [False, False]


def test_a_recorder_that_read_nothing_back_ends_cleanly(wire):
    recorder_of(wire)[0].end()


def test_a_tick_of_another_recording_is_copied_with_its_samples_and_checkpoints(wire):
    first, _ = recorder_of(wire, checkpoints=True)
    closed(first, wire, 3, checkpoint=True)
    batch = [
        (3 * H, topic_of("sample", robot), 3, data)
        for _, records, _ in first.samples(3, 3)
        for robot, data in zip(records["robot"], wire.samples.encode(records), strict=True)
    ]
    batch += [
        (3 * H, f"/robot_{r}/checkpoint", 3, data) for r, (_, data) in first.checkpoints.items()
    ]
    again, writer = recorder_of(wire, checkpoints=True)
    again.copy(3, batch)
    assert again.checkpoints == first.checkpoints
    assert (again.closed, again.messages) == (3, 5)
    assert writer.ticks == [sorted((topic, time, k) for time, topic, k, _ in batch)]
    ((k, records, worker),) = again.samples(3, 3)
    assert (k, worker, sorted(records["robot"].tolist())) == (3, EVERYONE, [0, 1, 2])


def test_channels_carry_joints_units_fmu_and_drive():
    arm = [{"name": "shoulder", "unit": "rad"}, {"name": "slide", "unit": "m"}]
    plants = [
        {"robots": [2], "joints": arm, "fmu": "arm.fmu", "drive": "one step an interval"},
        {"robots": [1], "joints": [{"name": "x", "unit": ""}] * 2, "fmu": "a.fmu", "drive": "held"},
    ]
    found = {
        channel.topic: channel.metadata
        for channel in channels(Codecs.of(Sizes(2)), 2, (2,), True, plants)
    }
    assert found["/robot_2/state"] == {
        "joints": '["shoulder", "slide"]',
        "unit.position": '["rad", "m"]',
        "unit.velocity": '["rad/s", "m/s"]',
        "unit.effort": '["N m", "N"]',
        "unit.reference_position": '["rad", "m"]',
        "unit.reference_velocity": '["rad/s", "m/s"]',
        "fmu": "arm.fmu",
        "drive": "one step an interval",
    }
    assert found["/robot_2/link_event"]["unit.velocity"] == '["rad/s", "m/s"]'
    assert found["/robot_1/sample"]["unit.position"] == '["", ""]'
    assert found["/target/sample"] == found["/robot_2/checkpoint"] == {}
