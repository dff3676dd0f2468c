"""What the recorder takes, lacks, closes and keeps of two hosts' batches; nothing is on a disk."""

import pytest

from bus.errors import BusError
from bus.keys import EVERYONE, TARGET, wire_key
from bus.transport import Message
from tests.batches import H, recorder_of, samples, told, whole, wire_of

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


def test_tick_0_lacks_records_alone(wire):
    recorder, _ = recorder_of(wire)
    assert recorder.missing(0) == {"left": ["records"], "right": ["records"]}
    recorder.take(told(wire, "right", 0))
    assert recorder.missing(0) == {"left": ["records"]}
    assert not recorder.is_whole(0)
    recorder.take(told(wire, "left", 0))
    assert recorder.missing(0) == {}
    assert recorder.is_whole(0)


def test_a_later_tick_lacks_what_each_host_did_not_say(wire):
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
        kind, _, host = message.key.partition("/")
        assert kind in recorder.missing(1)[host]
        recorder.take(message)
        assert kind not in recorder.missing(1).get(host, [])
    assert recorder.is_whole(1)


def test_a_tick_is_written_whole_with_its_faults_and_checkpoints(wire):
    recorder, writer = recorder_of(wire, faulty=(1, 2), checkpoints=True)
    closed(recorder, wire, 0)
    closed(recorder, wire, 1, faults=2, checkpoint=True)
    kinds = ["checkpoint", "fault", "fault", "sample", "state"]
    topics = sorted(["sample/0", *(f"{kind}/{robot}" for kind in kinds for robot in (1, 2))])
    assert writer.ticks == [
        [("state/1", 0, 0), ("state/2", 0, 0)],
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
    recorder.take(told(wire, "left", 1, **what))
    assert recorder.refused == {"topic": 1}
    assert recorder.taken == 0


def test_what_cannot_be_believed_is_counted_by_its_reason(wire):
    recorder, _ = recorder_of(wire)
    good = samples(wire, "left", 1)
    recorder.take(Message(good.key, good.payload[:-1]))
    recorder.take(Message(good.key, good.payload + b"\0"))
    recorder.take(Message(wire_key("samples", "nobody"), good.payload))
    recorder.take(Message(wire_key("report", "left"), good.payload))
    assert recorder.refused == {"size": 2, "host": 1, "key": 1}
    assert (recorder.taken, recorder.repeated) == (0, 0)


def test_what_is_said_again_in_the_same_words_is_kept_once(wire):
    recorder, writer = recorder_of(wire)
    for k in (0, 1):
        for message in whole(wire, k) * 2:
            recorder.take(message)
        recorder.close(k)
        for message in whole(wire, k):
            recorder.take(message)
    assert (recorder.taken, recorder.repeated) == (7, 14)
    assert [len(tick) for tick in writer.ticks] == [2, 5]


@pytest.mark.parametrize("say", [samples, told])
def test_what_is_said_again_in_other_words_ends_the_run(wire, say):
    recorder, _ = recorder_of(wire)
    recorder.take(say(wire, "left", 1))
    with pytest.raises(BusError, match="tick 1: host left said it twice, and not the same"):
        recorder.take(say(wire, "left", 1, value=2.0))


def test_the_last_that_was_heard_of_a_host(wire):
    recorder, _ = recorder_of(wire)
    closed(recorder, wire, 2)
    for k in (5, 3):
        recorder.take(samples(wire, "left", k))
    recorder.take(told(wire, "right", 4))
    assert recorder.last_heard("left") == 5
    assert recorder.last_heard("right") == 2


def test_samples_of_so_many_closed_ticks_stay_at_hand_and_no_more(wire):
    keep = 4
    recorder, _ = recorder_of(wire, keep=keep)
    closed(recorder, wire, TICKS)
    assert len(recorder._past) == keep  # memory does not grow with the run
    at_hand = [*recorder.samples(TICKS - keep + 1, TICKS + 5)]
    assert [k for k, _, _ in at_hand] == [*range(TICKS - keep + 1, TICKS + 1)]
    for _, records, host in at_hand:
        assert host == EVERYONE
        assert sorted(records["robot"].tolist()) == [0, 1, 2]


def test_samples_of_open_ticks_are_by_host(wire):
    recorder, _ = recorder_of(wire)
    closed(recorder, wire, 1)
    for k in (2, 3, 4):
        recorder.take(samples(wire, "left", k))
    known = [(k, host) for k, _, host in recorder.samples(1, 3)]
    assert known == [(1, EVERYONE), (2, "left"), (3, "left")]
