"""Who receives what and when on either bus, and what comes of a batch that is wrong or lost."""

from collections import Counter
from contextlib import ExitStack
from functools import partial
from struct import Struct

import numpy as np
import pytest

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.keys import topic_of
from nrs_cosim.bus.memory_bus import MemoryBus
from nrs_cosim.bus.messages import HEADER, SAMPLE, STATE, Codec
from nrs_cosim.bus.network.zenoh_bus import ZenohBus
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.orchestrator.engine.in_process import InProcess
from nrs_cosim.orchestrator.engine.lockstep import Lockstep, TargetNode
from nrs_cosim.orchestrator.engine.robots import Robots
from nrs_cosim.orchestrator.scenario.tables import algorithms
from nrs_cosim.recordings.channels import channels
from nrs_cosim.recordings.recorder import Recorder
from tests.scenarios import SHORT, paper


class Loop:
    """A run's parts in the open, on any bus, advanced a tick at a time."""

    def __init__(self, stack, file, bus, writer):
        clock, n = file.clock, file.n
        robots = Robots.opened(stack, file, range(1, n + 1))
        self.agents = robots.agents
        self.workers = InProcess(bus, robots, lambda _t: None)
        wire = self.workers.wire()
        self.target = TargetNode(bus, clock, wire, file.target)
        self.recorder = Recorder(writer, wire, n, 0)
        parts = (clock, self.target, self.workers, self.recorder)
        self.lockstep = Lockstep(*parts, {}, 1, 0.1, lambda _t: None)

    def ticks(self):
        self.workers.begin(self.recorder)
        return self.lockstep.run()


class Kept:
    """A writer that keeps what it is given."""

    def __init__(self):
        self.batches = []
        self._topics = dict(
            enumerate((channel.topic for channel in channels(Codecs.of(Sizes(2)), 6, (), False)), 1)
        )
        self.numbers = {topic: number for number, topic in self._topics.items()}

    def put(self, tick):
        self.batches.append(sorted(m for part in tick for m in part.messages(self._topics)))


def test_each_robot_receives_exactly_its_neighbours_samples(monkeypatch):
    """Listen to the session beside the run: nothing else is sent, nobody receives from others."""
    received_at = []

    class Listening(FirstOrder):
        """Keeps what it receives."""

        def receive(self, now, x, received):
            received_at.append(received)
            return super().receive(now, x, received)

    monkeypatch.setattr(algorithms, "load_algorithm", lambda _name, p: Listening(**p))
    file, m = paper(SHORT), 2
    codec = Codec(SAMPLE, Sizes(m))
    with ExitStack() as stack:
        bus, kept = ZenohBus("listened"), Kept()
        stack.callback(bus.close)
        ear = bus.listen("**")
        loop = Loop(stack, file, bus, kept)
        neighbours = {1: [2, 3], 2: [1], 3: [0], 4: [1, 3], 5: [2, 3, 4], 6: [3]}
        said = []
        for k in loop.ticks():
            said += [item.key for item in ear.take()]
            if k == 0:
                continue
            spoken = {}
            for time_ns, topic, sequence, data in kept.batches[k]:
                if topic.endswith("/sample"):
                    robot = HEADER.unpack_from(data)[0]
                    assert (topic, sequence, time_ns) == (
                        topic_of("sample", robot),
                        k,
                        k * 100_000_000,
                    )
                    record = codec.decode([data])[0]
                    spoken[robot] = (record["position"].tolist(), record["velocity"].tolist())
            assert spoken.keys() == {*range(7)}
            received = received_at.pop()
            for robot, nodes in neighbours.items():
                mine = received.row == robot - 1
                assert received.source[mine].tolist() == nodes
                assert received.samples.position[mine].tolist() == [spoken[j][0] for j in nodes]
                assert received.samples.velocity[mine].tolist() == [spoken[j][1] for j in nodes]
        assert Counter(said) == {"samples/target": 10, "samples/here": 10, "records/here": 11}


def test_both_buses_give_the_same_run():
    stories = []
    for make in (MemoryBus, lambda: ZenohBus("compared")):
        with ExitStack() as stack:
            bus, kept = make(), Kept()
            stack.callback(bus.close)
            list(Loop(stack, paper(SHORT), bus, kept).ticks())
            stories.append(kept.batches)
    assert stories[0] == stories[1]
    assert [len(batch) for batch in stories[0]] == [6] + [37] * 10


def test_a_tick_is_recorded_in_total_order_with_left_limits():
    with ExitStack() as stack:
        bus, kept = MemoryBus(), Kept()
        loop = Loop(stack, paper(SHORT), bus, kept)
        initial = loop.agents.state
        list(loop.ticks())
    last = (-1, "")
    for k, batch in enumerate(kept.batches):
        assert {sequence for _, _, sequence, _ in batch} == {k}
        for time_ns, topic, *_ in batch:
            assert (time_ns, topic) > last
            last = (time_ns, topic)
    sample = Codec(SAMPLE, Sizes(2)).decode(
        [d for _, t, _, d in kept.batches[1] if t == "/robot_4/sample"]
    )[0]
    expected = Estimate(initial.position[3], initial.velocity[3]).after(0.1)
    assert sample["position"].tolist() == expected.position.tolist()
    assert last[0] == 1_000_000_000


class Intercepted(MemoryBus):
    """A bus on which one key's messages are changed, or lost when the change gives None."""

    def __init__(self, key, change):
        super().__init__()
        self.key, self.change = key, change

    def publisher(self, key):
        put = super().publisher(key)
        if key != self.key:
            return put

        def changed(payload):
            new = self.change(payload)
            if new is not None:
                put(new)

        return changed


TICK = Struct("<I")
"""A batch opens with its tick; a part of one with its length, of the same form."""
SAMPLES, STATES = Codec(SAMPLE, Sizes(2)), Codec(STATE, Sizes(2))
FIRST_SAMPLE, FIRST_STATE = TICK.size, TICK.size + TICK.size


def changed(codec, first, robot, payload, /, **values):
    """Return a batch of six robots in which one robot's record has other values."""
    records = np.frombuffer(payload, codec.dtype, 6, first).copy()
    for name, value in values.items():
        records[name][robot - 1] = value
    return payload[:first] + records.tobytes() + payload[first + records.nbytes :]


sample_of_2 = partial(changed, SAMPLES, FIRST_SAMPLE, 2)
state_of_1 = partial(changed, STATES, FIRST_STATE, 1)


def at_tick(payload, k):
    return TICK.pack(k) + payload[TICK.size :]


def without_robot_2(payload):
    second = FIRST_SAMPLE + SAMPLES.size
    return payload[:second] + payload[second + SAMPLES.size :]


REJECTED = {
    "another robot's": (lambda p: sample_of_2(p, robot=3), "robot"),
    "another tick's": (lambda p: sample_of_2(p, k=7), "tick"),
    "of another time": (lambda p: sample_of_2(p, time_ns=7), "time"),
    "of another form": (lambda p: sample_of_2(p, **{"robot.tag": 7}), "form"),
    "a batch of another tick": (lambda p: at_tick(p, 2), "tick"),
    "a batch beyond the end": (lambda p: at_tick(p, 1 + 2**16), "tick"),
    "cut": (lambda p: p[:-1], "size"),
    "a robot's left out": (without_robot_2, "size"),
    "not finite": (lambda p: sample_of_2(p, velocity=[0, np.nan]), "value"),
    "empty": (lambda _p: b"", "size"),
}


@pytest.mark.parametrize(("change", "reason"), REJECTED.values(), ids=REJECTED.keys())
def test_a_bad_batch_of_samples_is_refused_and_its_worker_named(change, reason):
    with ExitStack() as stack:
        loop = Loop(stack, paper(SHORT), Intercepted("samples/here", change), Kept())
        with pytest.raises(BusError, match="tick 1: no samples came from here"):
            list(loop.ticks())
        for item in loop.workers.inbox.take():
            loop.recorder.take(item)
    assert loop.recorder.rejected == {reason: 1}


def test_lost_samples_are_reported_with_their_worker():
    with ExitStack() as stack:
        loop = Loop(stack, paper(SHORT), Intercepted("samples/here", lambda _p: None), Kept())
        with pytest.raises(BusError, match="tick 1: no samples came from here"):
            list(loop.ticks())


STATE_BATCH = {
    "lost": (lambda _p: None, {}),
    "cut": (lambda p: p[:-1], {"size": 1}),
    "another robot's": (lambda p: state_of_1(p, robot=3), {"robot": 1}),
    "another tick's": (lambda p: state_of_1(p, k=7), {"tick": 1}),
    "not finite": (lambda p: state_of_1(p, position=[np.nan, 0]), {"value": 1}),
}


@pytest.mark.parametrize(("change", "rejected"), STATE_BATCH.values(), ids=STATE_BATCH.keys())
def test_a_missing_state_is_reported_with_its_worker(change, rejected):
    with ExitStack() as stack:
        loop = Loop(stack, paper(SHORT), Intercepted("records/here", change), Kept())
        silence = r"tick 0 did not close in 0.1 s of silence: robots 1-6 on worker here"
        with pytest.raises(BusError, match=silence):
            list(loop.ticks())
    assert loop.recorder.rejected == rejected


def test_an_extra_message_is_rejected_and_counted():
    with ExitStack() as stack:
        bus = MemoryBus()
        loop = Loop(stack, paper(SHORT), bus, Kept())
        bus.publisher("samples/nobody")(b"stray")
        list(loop.ticks())
    assert loop.recorder.rejected == {"worker": 1}


def test_a_repeated_batch_is_recorded_once():
    def twice(payload):
        put(payload)
        return payload

    with ExitStack() as stack:
        bus, kept = Intercepted("records/here", twice), Kept()
        put = MemoryBus.publisher(bus, "records/here")
        loop = Loop(stack, paper(SHORT), bus, kept)
        list(loop.ticks())
        assert [len(batch) for batch in kept.batches] == [6] + [37] * 10
        assert loop.recorder.repeated == 11
