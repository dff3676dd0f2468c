"""When ticks close, and when silence ends a run: workers and clock are made up, nothing waits."""

from collections import Counter

import numpy as np
import pytest

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.keys import TARGET, wire_key
from nrs_cosim.bus.transport import Message, Presence
from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.orchestrator.engine import lockstep
from nrs_cosim.orchestrator.engine.lockstep import Lockstep, TargetNode, window
from tests.made_up_batches import ASSIGNMENT, H, recorder_of, samples, tick_batch, whole, wire_of

DEADLINE = 2.0
"""s of the made-up clock."""
TARGET_OF = Harmonic(np.zeros(2), np.ones(2), np.ones((2, 1)), np.ones((2, 1)), np.zeros((2, 1)))


class Time:
    """Wall time, s, that passes only when somebody waits."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


class Workers:
    """Two workers and the bus at once: what they put arrives at its time."""

    def __init__(self, time):
        self.inbox = self
        self.time, self.coming, self.there = time, [], []
        self.rejected, self.restarts, self.assignment = Counter(), 0, ASSIGNMENT
        self.away = (0.0, 0.0)
        self.asked, self.advanced, self.handled, self.published = [], [], [], []

    def at(self, when, *items):
        """Let items arrive at a time."""
        self.coming += [(when, item) for item in items]
        return self

    def take(self, seconds=0.0):
        due = [when for when, _ in self.coming]
        if seconds and not (due and min(due) <= self.time.now):
            self.time.now = min([self.time.now + seconds, *due])
        arrived = [item for when, item in self.coming if when <= self.time.now]
        self.coming = [(when, item) for when, item in self.coming if when > self.time.now]
        return arrived

    def publisher(self, key):
        assert key == wire_key("samples", TARGET)

        def put(payload):
            self.published.append(self.wire_.unpack_samples(TARGET, payload))
            self.at(self.time.now, Message(key, payload))

        return put

    def advance(self, k, _until):
        self.advanced.append(k)

    def handle(self, item):
        self.handled.append(item)

    def look_after(self, k, at_last=False):
        self.asked.append((k, at_last))
        start, end = self.away
        return not start <= self.time.now < end


class Case:
    """A run of so many ticks on made-up workers."""

    def __init__(self, monkeypatch, ticks=3, ahead=2, needs=None, pace=None):
        self.time, self.seen = Time(), []
        for clock in ("monotonic", "perf_counter"):
            monkeypatch.setattr(lockstep, clock, self.time)
        self.clock, self.wire = Clock((H,), 1, ticks), wire_of(ticks)
        self.workers = Workers(self.time)
        self.workers.wire_ = self.wire
        self.recorder, self.writer = recorder_of(self.wire)
        target = TargetNode(self.workers, self.clock, self.wire, TARGET_OF)
        needs = needs or {"left": {"right", TARGET}, "right": {"left", TARGET}}
        options = {} if pace is None else {"pace": pace}
        self.lockstep = Lockstep(
            self.clock,
            target,
            self.workers,
            self.recorder,
            needs,
            ahead,
            DEADLINE,
            self.seen.append,
            **options,
        )

    def robots(self, k):
        """Return what the robots put of tick k."""
        of_target = wire_key("samples", TARGET)
        return [message for message in whole(self.wire, k) if message.key != of_target]

    def run(self):
        return list(self.lockstep.run())


@pytest.fixture
def case(monkeypatch):
    return lambda **options: Case(monkeypatch, **options)


def test_ticks_close_in_order_and_complete(case):
    run = case()
    for k in (2, 0, 3, 1):
        run.workers.at(0.0, *run.robots(k))
    assert run.run() == [0, 1, 2, 3]
    assert run.workers.advanced == [0, 1, 2, 3]
    assert run.writer.ticks[0] == [("/robot_1/state", 0, 0), ("/robot_2/state", 0, 0)]
    for k in (1, 2, 3):
        robots = [f"/robot_{robot}/{kind}" for robot in (1, 2) for kind in ("sample", "state")]
        topics = [*robots, "/target/sample"]
        assert run.writer.ticks[k] == [(topic, k * H, k) for topic in topics]
    assert run.time.now == 0


def test_the_target_is_sent_no_further_ahead_than_the_window(case):
    run, ahead = case(ticks=5), 2
    for k in range(6):
        run.workers.at(0.0, *run.robots(k))
    for k in run.lockstep.run():
        assert min(k + ahead // 2, 5) <= run.workers.published[-1][0] <= k + ahead
    assert [k for k, _ in run.workers.published] == [1, 2, 3, 4, 5]
    for k, record in run.workers.published:
        t = seconds(k * H)
        assert record["time_ns"] == k * H
        assert record["position"][0] == pytest.approx(t + np.sin(t))
        assert record["velocity"][0] == pytest.approx(1 + np.cos(t))


def test_a_run_continues_after_its_recorded_ticks(case):
    run = case(ticks=4)
    for k in (0, 1):
        for message in whole(run.wire, k):
            run.recorder.take(message)
        run.recorder.close(k)
    for k in (2, 3, 4):
        run.workers.at(0.0, *run.robots(k))
    assert run.run() == [2, 3, 4]
    assert run.workers.advanced == [2, 3, 4]
    assert [k for k, _ in run.workers.published] == [2, 3, 4]
    assert len(run.writer.ticks) == 5


def test_without_recorded_ticks_the_target_begins_with_the_first():
    workers, wire = Workers(Time()), wire_of(3)
    workers.wire_ = wire
    TargetNode(workers, Clock((H,), 1, 3), wire, TARGET_OF).publish_until(2)
    assert [k for k, _ in workers.published] == [1, 2]


def test_samples_of_the_target_are_the_same_bits_however_many_are_worked_out_at_once():
    rng = np.random.default_rng(5)
    target = Harmonic(*rng.normal(size=(2, 1)), *(9 * rng.normal(size=(3, 1, 11))))
    at_once, single = Workers(Time()), Workers(Time())
    for workers, steps in ((at_once, (64,)), (single, range(1, 65))):
        workers.wire_ = wire_of(64)
        node = TargetNode(workers, Clock((H,), 1, 64), workers.wire_, target)
        for k in steps:
            node.publish_until(k)
    numbers = [[r.tobytes() for _, r in workers.published] for workers in (at_once, single)]
    assert len(numbers[0]) == 64
    assert numbers[0] == numbers[1]


def test_the_time_spent_is_measured(case):
    """It passes where workers are waited for, by 0.1 s at each message and 0.5 s at each put."""
    run = case(ticks=2)
    put, take = run.writer.put, run.recorder.take

    def slow(seconds, act):
        def acted(what):
            run.time.now += seconds
            act(what)

        return acted

    run.writer.put, run.recorder.take = slow(0.5, put), slow(0.1, take)
    for k in range(3):
        run.workers.at(2.0 * k, *run.robots(k))
    run.run()
    taken = 2 + 2 + 2 * 4  # the target's samples, records of t_0, samples and records since
    assert run.lockstep.recording == pytest.approx(3 * 0.5)
    assert run.lockstep.spent.bus == pytest.approx(0.1 * taken)
    assert run.lockstep.spent.waiting == pytest.approx(run.time.now - 3 * 0.5 - 0.1 * taken)
    assert run.lockstep.spent.waiting > 1


def test_silence_as_long_as_the_deadline_ends_the_run(case):
    run = case()
    run.workers.at(0.0, *run.robots(0)).at(1.0, samples(run.wire, "left", 1))
    with pytest.raises(BusError) as caught:
        run.run()
    assert str(caught.value) == (
        "tick 1 did not close in 2 s of silence: "
        "robot 1 on worker left sent samples up to tick 1 and lack those of right; "
        "robot 2 on worker right sent samples up to tick 0 and wait for none: computing, or stopped"
    )
    assert run.time.now == 1.0 + DEADLINE
    assert run.workers.asked[-1] == (1, True)
    assert (1, True) not in run.workers.asked[:-1]


def test_silence_of_the_target_is_named(case):
    run = case(ahead=-1)
    run.workers.at(0.0, *run.robots(0), *run.robots(1))
    with pytest.raises(BusError, match="the target sent samples up to tick 0"):
        run.run()


def test_each_new_batch_restarts_the_deadline(case):
    run = case(ticks=1)
    run.workers.at(0.0, *run.robots(0))
    messages = run.robots(1)
    for number, message in enumerate(messages, 1):
        run.workers.at(number * 0.9 * DEADLINE, message)
    assert run.run() == [0, 1]
    assert run.time.now == pytest.approx(len(messages) * 0.9 * DEADLINE)


@pytest.mark.parametrize("say", [samples, tick_batch])
def test_rejected_and_repeated_batches_do_not_restart_the_deadline(case, say):
    run = case(ticks=1)
    again = say(run.wire, "left", 1)
    run.workers.at(0.0, *run.robots(0), again)
    run.workers.at(1.0, again, Message(again.key, b"nothing"), Message(again.key, again.payload))
    with pytest.raises(BusError, match="tick 1 did not close"):
        run.run()
    assert run.time.now == DEADLINE
    assert run.recorder.repeated == 2
    assert run.recorder.rejected.total() == 1


def test_the_deadline_is_paused_while_a_worker_is_away(case):
    run = case(ticks=1)
    run.workers.away = (0.5, 10 * DEADLINE)
    run.workers.at(0.0, *run.robots(0))
    run.workers.at(10.8 * DEADLINE, *run.robots(1))
    assert run.run() == [0, 1]


def test_the_deadline_restarts_when_a_worker_is_back(case):
    run = case(ticks=1)
    run.workers.away = (0.5, 10 * DEADLINE)
    run.workers.at(0.0, *run.robots(0))
    with pytest.raises(BusError, match="tick 1 did not close in 2 s of silence"):
        run.run()
    assert run.time.now == pytest.approx(11 * DEADLINE, abs=0.5)


def test_a_workers_failure_is_reported_before_its_silence(case):
    run = case(ticks=1)

    def look_after(_k, at_last=False):
        if at_last:
            raise BusError("robot 2 diverged")
        return True

    run.workers.look_after = look_after
    with pytest.raises(BusError, match="robot 2 diverged"):
        run.run()


def test_other_messages_are_passed_to_the_coordinator(case):
    run = case(ticks=1)
    others = [Presence("alive/left", here=True), Message("report/left", b"done")]
    run.workers.at(0.0, *run.robots(0), *others, *run.robots(1))
    assert run.run() == [0, 1]
    assert run.workers.handled == others
    assert not run.recorder.rejected


def test_the_watcher_gets_the_last_closed_tick_while_waiting(case):
    run = case(ticks=2)
    for k in range(3):
        run.workers.at(0.6 * k, *run.robots(k))
    run.run()
    assert run.seen[0] == 0
    closed = {k * H for k in range(3)}
    assert set(run.seen) == closed
    assert run.seen == sorted(run.seen)
    waited_for_1 = [time for time in run.seen if time == 0]
    assert len(waited_for_1) == 1 + 2  # t_0 was closed, and 0.6 s have two looks of 0.25 s


class Paced:
    """A pace that keeps what it is asked."""

    asked = 1.0

    def __init__(self):
        self.calls = []

    def start(self, time_ns):
        self.calls.append(("start", time_ns))

    def wait(self, time_ns, ask):
        self.calls.append(("wait", time_ns))
        ask()


def test_the_pace_delays_a_tick_while_workers_are_supervised(case):
    pace = Paced()
    run = case(ticks=3, pace=pace)
    for k in (0, 1):
        for message in whole(run.wire, k):
            run.recorder.take(message)
        run.recorder.close(k)
    for k in (2, 3):
        run.workers.at(0.0, *run.robots(k))
    run.run()
    assert pace.calls == [("start", H), ("wait", 2 * H), ("wait", 3 * H)]
    assert run.workers.asked == [(2, False), (3, False)]


@pytest.mark.parametrize(
    ("size", "ticks"),
    [(0, 64), (1, 64), (2**18, 64), (2**19, 32), (2**22, 4), (2**23, 4), (2**40, 4)],
)
def test_the_window_is_sixteen_megabytes_of_ticks(size, ticks):
    assert window(size) == ticks
