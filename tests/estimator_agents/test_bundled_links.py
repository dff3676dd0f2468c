"""Bundled algorithms that keep something of each link: shares, histories, and what was received."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import Field
from nrs_cosim.bus.links.links import LinkFault, Links
from nrs_cosim.bus.topologies import InteractionGraphs, TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea3 import ThirdOrder
from nrs_cosim.estimator_agents.dynamic_average import DynamicAverage
from nrs_cosim.estimator_agents.edges import field_sizes
from nrs_cosim.estimator_agents.event_triggered import EventTriggered
from nrs_cosim.estimator_agents.max_consensus import MaxConsensus
from nrs_cosim.estimator_agents.push_sum import PushSum
from nrs_cosim.estimator_agents.values import Values
from nrs_cosim.estimator_agents.wmsr import Wmsr
from tests.estimator_agents.agents_without_bus import CLOCK, agents_at, meet, whole
from tests.estimator_agents.test_bundled import H, chain, made, schedule, target_of


def unbalanced(n=20):
    edges = {((i - 1) % n + 1, i + 1) for i in range(n)} | {
        ((i * 7 + 3) % n + 1, i + 1) for i in range(n)
    }
    return schedule(n, [edge for edge in edges if edge[0] != edge[1]] + [(0, 5)])


@pytest.mark.parametrize(
    "fault", [None, LinkFault(loss=0.3), LinkFault(delay=(0, 3))], ids=["sound", "loss", "delay"]
)
def test_push_sum_comes_to_the_average_whatever_links_lose(fault):
    values = np.random.default_rng(5).normal(size=(20, 1)) * 10
    agents = made(PushSum(), unbalanced(), {"s": values}, fault=fault)
    for k in range(1, 401):
        meet(agents, k, 1.0, target_of(PushSum()))
    np.testing.assert_allclose(whole(agents, "position"), values.mean(), atol=1e-10)


@pytest.mark.parametrize(
    "fault", [None, LinkFault(loss=0.2, delay=(0, 2))], ids=["sound", "faulty"]
)
@pytest.mark.parametrize(
    "algorithm",
    [
        ThirdOrder(0.7, 0.6, 0.5),
        MaxConsensus(),
        Wmsr(1),
        EventTriggered(0.7, 0.6, c0=0.3, d0=0.3, longest_silence=1.0),
        PushSum(),
        DynamicAverage(0.3, 0.05, 0.02, follows_signal=True),
    ],
    ids=lambda algorithm: type(algorithm).__name__,
)
def test_any_partition_and_restart_gives_the_same_bits(algorithm, fault):
    n, topologies = 20, unbalanced()
    rng = np.random.default_rng(8)
    start = {
        name: rng.normal(size=(n, *(1 for _ in field.shape)))
        for name, field in algorithm.STATE.items()
        if field.shape == ("m",)
    }
    label = rng.integers(0, 5, n)
    layouts = [
        [np.arange(1, n + 1)],
        [np.array([i]) for i in range(1, n + 1)],
        [np.flatnonzero(label == part) + 1 for part in range(5)],
    ]
    together, apart, mixed = (made(algorithm, topologies, start, parts, fault) for parts in layouts)
    for k in range(1, 41):
        if k == 20:
            saved = {
                int(robot): part.save(row, part.state)
                for part in apart
                for row, robot in enumerate(part.robots)
            }
            mixed = made(algorithm, topologies, start, layouts[2], fault)
            for part in mixed:
                part.state = part.restore([saved[int(robot)] for robot in part.robots])
        senders = [
            meet(agents, k, H, target_of(algorithm, np.sin(k * H), np.cos(k * H))).tolist()
            for agents in (together, apart, mixed)
        ]
        assert senders[0] == senders[1] == senders[2]
        for name in algorithm.STATE:
            bits = whole(together, name).tobytes()
            assert whole(apart, name).tobytes() == bits, (k, name)
            assert whole(mixed, name).tobytes() == bits, (k, name)


@dataclass(frozen=True)
class Increments(PushSum):
    """Push-sum whose messages are shares, each of which must come once."""

    STATE: ClassVar = {name: PushSum.STATE[name] for name in ("position", "velocity", "s", "w")}
    SENT: ClassVar = {"s": Field(), "w": Field((1,))}
    LINK: ClassVar = {}
    MISSING: ClassVar = ("drop",)

    def send(self, now, x):
        share = 1 / (1 + now.out_degree)
        after = x.replace(s=x.s * share, w=x.w * share)
        return after, Values(s=after.s, w=after.w), None

    def receive(self, now, x, received):  # noqa: ARG002
        s, w = (x[name] + received.sum(received.samples[name]) for name in ("s", "w"))
        return x.replace(s=s, w=w, position=s / w)


@dataclass(frozen=True)
class EveryIncrement(Increments):
    ARRIVALS: ClassVar = "every"


@pytest.mark.parametrize(
    ("algorithm", "fault", "keeps"),
    [
        (Increments(), None, True),
        (EveryIncrement(), None, True),
        (Increments(), LinkFault(delay=(2, 2)), True),
        (EveryIncrement(), LinkFault(delay=(2, 2)), True),
        (Increments(), LinkFault(delay=(0, 3)), False),
        (EveryIncrement(), LinkFault(delay=(0, 3)), True),
        (Increments(), LinkFault(loss=0.3), False),
        (EveryIncrement(), LinkFault(loss=0.3), False),
        (Increments(), LinkFault(duplicate=0.3), True),
        (EveryIncrement(), LinkFault(duplicate=0.3), False),
        (PushSum(), LinkFault(duplicate=0.3), True),
    ],
)
def test_shares_keep_their_sum_where_each_comes_once(algorithm, fault, keeps):
    """The newest of two that arrive at once throws a share away; a duplicate makes one."""
    values = np.random.default_rng(5).normal(size=(20, 1)) * 10
    agents = made(algorithm, unbalanced(), {"s": values}, fault=fault)
    for k in range(1, 401):
        meet(agents, k, 1.0, target_of(algorithm))
    off = np.abs(whole(agents, "position") - values.mean()).max()
    assert (off < 1e-9) == keeps
    assert keeps or off > 1e-3


def test_every_sample_is_received_in_order_wherever_a_robot_is():
    n, topologies, algorithm = 20, unbalanced(), EveryIncrement()
    start = {"s": np.random.default_rng(5).normal(size=(n, 1))}
    fault = LinkFault(loss=0.1, delay=(0, 3), duplicate=0.2)
    layouts = [[np.arange(1, n + 1)], [np.array([i]) for i in range(1, n + 1)]]
    together, apart = (made(algorithm, topologies, start, parts, fault) for parts in layouts)
    for k in range(1, 41):
        if k == 20:
            saved = [together[0].save(row, together[0].state) for row in range(n)]
            apart = made(algorithm, topologies, start, layouts[1], fault)
            for part in apart:
                part.state = part.restore([saved[part.robots[0] - 1]])
        for agents in (together, apart):
            meet(agents, k, 1.0, target_of(algorithm))
        assert whole(together, "s").tobytes() == whole(apart, "s").tobytes(), k


def test_ages_and_weights_of_all_that_arrives():
    """Robot 2 receives the target and robot 1, each a period late and twice."""
    seen = []

    @dataclass(frozen=True)
    class Seeing(Increments):
        ARRIVALS: ClassVar = "every"

        def receive(self, now, x, received):
            mine = received.row == now.robots.tolist().index(2)
            seen.append(
                [
                    (int(source), int(age), float(weight))
                    for source, age, weight in zip(
                        received.source[mine],
                        received.age[mine],
                        received.weight[mine, 0],
                        strict=True,
                    )
                ]
            )
            return x

    topologies = schedule(2, [(0, 1), (0, 2), (1, 2)])
    agents = made(Seeing(), topologies, {}, fault=LinkFault(delay=(1, 1), duplicate=1.0))
    for k in range(1, 3):
        meet(agents, k, 1.0, target_of(Seeing()))
    assert seen == [[], [(0, 1, 0.25), (0, 1, 0.25), (1, 1, 0.25), (1, 1, 0.25)]]


@dataclass(frozen=True)
class Counting(FirstOrder):
    """Counts how often it was asked to send, and sends at every third time."""

    STATE: ClassVar = {**FirstOrder.STATE, "asked": Field(())}
    MISSING: ClassVar = ("hold",)
    TRIGGERED: ClassVar = True

    def send(self, now, x):  # noqa: ARG002
        after = x.replace(asked=x.asked + 1)
        return after, Values(position=x.position, velocity=x.velocity), after.asked % 3 == 1


def test_a_robot_in_an_outage_is_as_if_it_had_not_been_asked_to_send():
    algorithm, topologies = Counting(0.5, 0.5), chain(2)
    links = Links(
        topologies,
        np.arange(1, 3),
        {},
        {2: ((200_000_000, 400_000_000),)},
        ticks=CLOCK,
        seed=0,
        codecs=Codecs.of(field_sizes(topologies, 1), "Tried", kept=algorithm.STATE),
        every=True,
    )
    start = {"position": np.zeros((2, 1)), "velocity": np.zeros((2, 1))}
    agents = agents_at([1, 2], topologies, algorithm, start, links)
    asked, sent = [], []
    for k in range(1, 7):
        sent.append(meet([agents], k, H, target_of(algorithm)).tolist())
        asked.append(agents.state.asked.tolist())
    assert asked == [[1, 1], [2, 1], [3, 1], [4, 2], [5, 3], [6, 4]]
    assert sent == [[1, 2], [], [], [1], [], [2]]


def test_what_was_sent_while_there_was_no_edge_is_not_received_later():
    """Robot 2 receives from robot 1 from tick 3 on, which sends at ticks 1 and 4 alone."""
    seen = []

    @dataclass(frozen=True)
    class Seeing(Counting):
        def receive(self, now, x, received):
            mine = (received.row == 1) & (received.source == 1)
            seen.append((now.k, received.present[mine].tolist(), received.age[mine].tolist()))
            return x

    apart = Topology.of_edges(2, np.array([0, 0]), np.array([1, 2]), np.ones(2))
    joined = Topology.of_edges(2, np.array([0, 0, 1]), np.array([1, 2, 2]), np.ones(3))
    topologies = TopologySchedule.of(
        [InteractionGraphs.of(apart), InteractionGraphs.of(joined)], (1, 3)
    )
    agents = made(Seeing(0.5, 0.5), topologies, {})
    for k in range(1, 7):
        meet(agents, k, H, target_of(Seeing(0.5, 0.5)))
    assert seen == [
        (1, [], []),
        (2, [], []),
        (3, [False], [3]),
        (4, [True], [0]),
        (5, [True], [1]),
        (6, [True], [2]),
    ]
