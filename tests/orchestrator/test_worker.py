"""A worker of two robots whose plants, bus and clock are made up: what it says, and from where."""

from collections import defaultdict

import numpy as np
import pytest

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.framing import joined
from nrs_cosim.bus.keys import EVERYONE, RECORDS, SAMPLES, TARGET, wire_key
from nrs_cosim.bus.messages import CHECKPOINT, Blob
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.bus.transport import Message, Presence
from nrs_cosim.bus.validation import Wire
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.values import Values
from nrs_cosim.orchestrator.engine.worker import Worker, needed
from nrs_cosim.orchestrator.errors import DivergedError
from nrs_cosim.plant_fmu.errors import FmuError

H, TICKS, M, EVERY = 100_000_000, 6, 2, 2
ASSIGNMENT = {"here": np.array([1, 3]), "there": np.array([2]), TARGET: np.array([0])}
TOPOLOGY = Topology.of([[0, 1, 0], [0, 0, 0], [1, 1, 0]], [1, 1, 0])
"""Robot 2 alone receives the target, and all others receive from it."""


class Springs:
    """Plants that are drawn to their references: q' = e^{-s} q + (1 − e^{-s}) ε."""

    checkpointable = True

    def __init__(self):
        self.q, self.qd, self.tau = np.zeros((3, 2, M))
        self.calls = []

    def hold(self, position, velocity):
        self._position, self._velocity = position.copy(), velocity.copy()

    def advance(self, start, step):
        self.calls.append((start, step))
        share = np.exp(-step)
        self._position = self._position + step * self._velocity
        self.qd = (self._position - self.q) * (1 - share) / step
        self.q = share * self.q + (1 - share) * self._position
        self.tau = self._position - self.q

    def save(self):
        return [np.stack([q, qd]).tobytes() for q, qd in zip(self.q, self.qd, strict=True)]

    def restore(self, data):
        rows = np.array([np.frombuffer(row).reshape(2, M) for row in data])
        self.q, self.qd = rows[:, 0].copy(), rows[:, 1].copy()


class Bus:
    """A bus on which the target and robot 2 say what they do at once."""

    def __init__(self, wire):
        self.put, self.wire, self.arrived = defaultdict(list), wire, []
        self.patience = 0.0

    def publisher(self, key):
        return self.put[key].append

    def take(self, _seconds=0.0):
        arrived, self.arrived = self.arrived, []
        return arrived

    def sample(self, worker, k):
        """Return what another worker says at t_k: anything, as long as it is the same again."""
        records = self.wire.samples.blank(ASSIGNMENT[worker])
        records["k"], records["time_ns"] = k, k * H
        drawn = np.random.default_rng([k, len(worker)]).normal(size=(2, len(records), M))
        records["position"], records["velocity"] = drawn
        return records

    def said(self, worker, k):
        """Return it as it travels."""
        return Message(
            wire_key(SAMPLES, worker), self.wire.pack_samples(worker, k, self.sample(worker, k))
        )


class Case:
    """A worker, and what it receives when it lacks something."""

    patience = 0.25

    def __init__(self, every=EVERY, limit=1e6, start=1.0):
        self.wire = Wire(Codecs.of(Sizes(M)), Clock((H,), 2, TICKS), ASSIGNMENT, Signer(b"secret"))
        self.bus, self.plants = Bus(self.wire), Springs()
        robots = ASSIGNMENT["here"]
        initial = Values(position=np.full((2, M), start), velocity=np.full((2, M), 0.5))
        clock = Clock((H,), 2, TICKS)
        topologies = TopologySchedule.constant(TOPOLOGY)
        agents = Agents(robots, topologies, FirstOrder(0.9, 1.1), initial, clock)
        self.worker = Worker(
            "here", self.bus, self.bus, self.wire, clock, agents, self.plants, limit, every
        )
        self.lacks, self.handled = [], []

    def lack(self, k, missing):
        self.lacks.append((k, list(missing)))
        if "here" in missing:
            payloads = self.bus.put[wire_key(SAMPLES, "here")]
            self.bus.arrived.append(Message(wire_key(SAMPLES, "here"), payloads[-1]))
        self.bus.arrived += [self.bus.said(worker, k) for worker in missing if worker != "here"]
        return ()

    def handle(self, item):
        self.handled.append(item)
        return ()

    def run(self, recorded=-1, watch=lambda _t: None):
        return list(self.worker.run(recorded, watch, self))

    def closed_ticks(self):
        """Return what it said beside samples, by tick."""
        payloads = self.bus.put[wire_key(RECORDS, "here")]
        return dict(self.wire.unpack_tick("here", payload) for payload in payloads)

    def samples(self):
        """Return its samples, by tick."""
        payloads = self.bus.put[wire_key(SAMPLES, "here")]
        unpacked = [self.wire.unpack_samples("here", payload) for payload in payloads]
        return {k: records.tobytes() for k, records in unpacked}


def test_a_worker_is_at_the_beginning_until_it_runs():
    worker = Case().worker
    assert (worker.now, worker.place) == (0, (0, 0, 0))


def test_a_worker_sends_each_tick_complete_on_the_output_grid():
    case, reached = Case(), []
    assert case.run(watch=reached.append) == [*range(TICKS + 1)]
    assert sorted(case.samples()) == [*range(1, TICKS + 1)]
    closed_ticks = case.closed_ticks()
    assert sorted(closed_ticks) == [*range(TICKS + 1)]
    assert [k for k, tick in closed_ticks.items() if tick.checkpoints] == [2, 4, 6]
    assert reached == [part * H // 2 for part in range(1, 2 * TICKS + 1)]
    assert case.plants.calls == [(seconds(t - H // 2), seconds(H // 2)) for t in reached]
    assert case.lacks == [(k, ["here", TARGET, "there"]) for k in range(1, TICKS + 1)]


def test_an_estimate_moves_and_jumps_by_received_samples():
    case = Case()
    ticks = case.worker.run(-1, lambda _t: None, case)
    next(ticks), next(ticks)
    position, velocity = np.full((2, M), 1.0) + 0.1 * 0.5, np.full((2, M), 0.5)
    np.testing.assert_allclose(case.worker.left.position, position)
    received = {0: case.bus.sample(TARGET, 1)[0], 2: case.bus.sample("there", 1)[0]}
    left = {row: (position[row], velocity[row]) for row in (0, 1)}
    for row, sources in ((0, (0, 2)), (1, (None, 2))):
        d = np.zeros((2, M))
        for j in sources:
            closed_ticks = (
                left[0] if j is None else (received[j]["position"], received[j]["velocity"])
            )
            d += (np.array(closed_ticks) - np.array(left[row])) / 2
        after = case.worker.agents.state
        np.testing.assert_allclose(after.position[row], position[row] + 0.9 * d[0])
        np.testing.assert_allclose(after.velocity[row], velocity[row] + 1.1 * d[1])


@pytest.mark.parametrize("start", [2, 4])
@pytest.mark.parametrize("recorded", [4, 5])
def test_a_restored_worker_sends_the_same_bits_from_its_checkpoint_on(start, recorded):
    first = Case()
    first.run()
    again = Case()
    again.worker.restore(start, first.closed_ticks()[start].checkpoints)
    own = first.bus.put[wire_key(SAMPLES, "here")]

    def lack(k, missing):
        if k <= recorded and "here" in missing:
            again.bus.arrived.append(Message(wire_key(SAMPLES, "here"), own[k - 1]))
            missing = [worker for worker in missing if worker != "here"]
        return Case.lack(again, k, missing)

    again.lack = lack
    assert again.run(recorded) == [*range(start, TICKS + 1)]
    new = range(recorded + 1, TICKS + 1)
    assert again.samples() == {k: first.samples()[k] for k in new}
    for kind in (SAMPLES, RECORDS):
        key = wire_key(kind, "here")
        assert again.bus.put[key] == first.bus.put[key][-len(new) :]
    assert again.plants.q.tobytes() == first.plants.q.tobytes()


@pytest.mark.parametrize("parts", [0, 3, 5], ids=["none", "one too few", "one too many"])
def test_a_damaged_checkpoint_is_refused_and_its_robot_named(parts):
    first = Case()
    first.run()
    good = first.closed_ticks()[2].checkpoints[0]
    damaged = CHECKPOINT.encode(Blob(3, 2, 2 * H, joined([bytes(16)] * parts)))
    with pytest.raises(FmuError, match="robot 3's checkpoint is damaged"):
        Case().worker.restore(2, [good, damaged])


@pytest.mark.parametrize(("every", "checkpointable"), [(0, True), (EVERY, False)])
def test_no_checkpoint_is_taken_off_schedule_or_of_plants_without_states(every, checkpointable):
    case = Case(every)
    case.plants.checkpointable = checkpointable
    case.run()
    assert not any(tick.checkpoints for tick in case.closed_ticks().values())


def test_samples_arrive_in_any_order_and_rejected_ones_are_ignored():
    case = Case()
    others = [case.bus.said(worker, k) for k in (3, 1, 2, 4, 6, 5) for worker in (TARGET, "there")]
    spoilt = Message(others[0].key, others[0].payload[:-1])
    unknown = Presence("alive/there", here=False)
    case.bus.arrived = [*others, spoilt, unknown, Message("orders/here", b"")]
    assert case.run() == [*range(TICKS + 1)]
    assert case.handled == [unknown, Message("orders/here", b"")]
    reference = Case()
    reference.run()
    assert case.samples() == reference.samples()


def test_samples_of_all_are_received_once():
    case, reference = Case(), Case()
    reference.run()

    def lack(k, _missing):
        own = np.frombuffer(reference.samples()[k], case.wire.samples.dtype)
        parts = [own, case.bus.sample("there", k), case.bus.sample(TARGET, k)]
        return [(k, np.concatenate(parts), EVERYONE)]

    case.lack = lack
    assert case.run() == [*range(TICKS + 1)]
    assert case.samples() == reference.samples()


@pytest.mark.parametrize(
    ("spoil", "words", "done"),
    [
        (lambda case: case.plants.q.__setitem__((1, 0), 2e6), "robot 3's q is [2", 3),
        (lambda case: case.plants.qd.__setitem__((0, 1), np.nan), "robot 1's qd is [0", 4),
        (lambda case: case.plants.tau.__setitem__((1, 1), np.inf), "robot 3's tau is [0", 5),
    ],
    ids=["q", "qd", "tau"],
)
def test_a_number_beyond_the_limit_is_named_with_its_robot(spoil, words, done):
    case = Case()
    spoil(case)
    with pytest.raises(DivergedError) as caught:
        case.run()
    assert str(caught.value).startswith(f"diverged at t = 0 s: {words}")
    assert case.worker.place == (0, done, 3 if "robot 3" in words else 1)


@pytest.mark.parametrize(("start", "limit", "fails"), [(5.0, 5.0, False), (5.0, 4.999, True)])
def test_a_number_equal_to_the_limit_is_accepted(start, limit, fails):
    ticks = Case(limit=limit, start=start).worker.run(-1, lambda _t: None, Case())
    if fails:
        with pytest.raises(
            DivergedError, match=r"estimated position is .* beyond run.divergence_l"
        ):
            next(ticks)
    else:
        assert next(ticks) == 0


def test_a_worker_receives_from_its_neighbours_workers_and_the_target():
    assert needed(np.array([2]), ASSIGNMENT) == {"there", TARGET}
    assert needed(np.array([1, 2]), ASSIGNMENT) == {"here", "there", TARGET}
    assert needed(np.array([0]), ASSIGNMENT) == {TARGET}
