"""Agents on links with faults against plain Python, link by link, and against themselves apart."""

from itertools import accumulate

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from nrs_cosim.bus.clock import Clock
from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import ESTIMATE, Sizes
from nrs_cosim.bus.links.links import LinkFault, Links
from nrs_cosim.bus.topologies import InteractionGraphs, TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.estimate import Estimate
from tests.cases import cases
from tests.estimator_agents.agents_without_bus import agents_at, receive, values
from tests.estimator_agents.plain_link_faults import Network, simulate

H, TICKS = 0.1, 90
FUZZ = settings(
    derandomize=True,
    deadline=None,
    database=None,
    phases=(Phase.generate,),
    suppress_health_check=[HealthCheck.too_slow],
)
ALGORITHMS = {1: FirstOrder(0.9, 1.1), 2: SecondOrder(1.1, 0.9)}


def by_hand(order):
    def jump(left, dp, dv):
        (p, v) = left
        if order == 1:
            return [
                [x + 0.9 * d for x, d in zip(p, dp, strict=True)],
                [x + 1.1 * d for x, d in zip(v, dv, strict=True)],
            ]
        moved = [x + (1.1 * a + 0.9 * b) for x, a, b in zip(v, dp, dv, strict=True)]
        return [p, moved]

    return jump


spans = st.lists(
    st.tuples(st.integers(0, 800), st.integers(1, 300)).map(lambda s: (s[0], s[0] + s[1])),
    min_size=1,
    max_size=2,
)
pairs = st.tuples(st.sampled_from([0.0, 0.01, 0.5]), st.sampled_from([0.0, 0.02, 1.0]))
faults = st.fixed_dictionaries(
    {},
    optional={
        "loss": st.sampled_from([0.0, 0.1, 0.5, 1.0]),
        "delay": st.tuples(st.integers(0, 3), st.integers(0, 4)).map(lambda d: (d[0], sum(d))),
        "outages": spans,
        "noise": pairs,
        "quantisation": pairs,
    },
)


@st.composite
def networks(draw):
    n = draw(st.integers(1, 6))
    weights = st.sampled_from([0.0, 0.0, 0.3, 1.0, 2.5])

    def digraph():
        w = [[draw(weights) if j != i else 0.0 for j in range(n + 1)] for i in range(1, n + 1)]
        for i, row in enumerate(w):
            if not any(row):
                row[0 if i == 0 else i] = 1.0
        return w

    network = Network(
        digraph(), gaps=tuple(draw(st.lists(st.integers(5, 15), min_size=1, max_size=3)))
    )
    for since in sorted(draw(st.sets(st.integers(1, 40), max_size=3))):
        w = digraph()
        network.turns.append((since, w, digraph() if draw(st.booleans()) else w))
    last = network.turns[-1][0] if network.turns else 1
    network.repeat = draw(st.one_of(st.none(), st.integers(last, last + 20)))
    link = st.sampled_from(network.pairs())
    network.links = draw(st.dictionaries(link, faults, min_size=1))
    network.robots = draw(st.dictionaries(st.integers(1, n), spans, max_size=2))
    network.seed = draw(st.integers(0, 2**40))
    network.m = draw(st.integers(1, 3))
    network.missing = draw(st.sampled_from(["hold", "drop"]))
    return network


def topologies_of(network):
    def topology(w):
        full = np.array(w)
        return Topology.of(full[:, 1:], full[:, 0])

    exchanges, since = [InteractionGraphs.of(topology(network.w))], [1]
    for tick, positions, velocities in network.turns:
        one = topology(positions)
        exchanges.append(
            InteractionGraphs(one, one if velocities is positions else topology(velocities))
        )
        since.append(tick)
    if since[1:2] == [1]:
        exchanges, since = exchanges[1:], since[1:]
    return TopologySchedule.of(exchanges, since, network.repeat)


def start_of(network):
    rng = np.random.default_rng(network.seed)
    shape = (2, len(network.w), network.m)
    return Estimate(*rng.uniform(-25, 25, shape)), rng.uniform(-25, 25, (TICKS + 1, 2, network.m))


def by_field(fault):
    """Return a fault with its pairs as a link has them: by field, without zeros."""
    return {
        key: {field: of for field, of in zip(ESTIMATE, value, strict=True) if of}
        if key in {"noise", "quantisation"}
        else value
        for key, value in fault.items()
    }


def agents_of(network, robots, algorithm, start):
    """Return the agents of some robots of a network."""
    topologies, rows = topologies_of(network), robots - 1
    given = {link: LinkFault(**by_field(fault)) for link, fault in network.links.items()}
    ticks = Clock(tuple(accumulate(network.gaps)), 1, TICKS)
    links = Links(
        topologies,
        robots,
        given,
        network.robots,
        ticks=ticks,
        seed=network.seed,
        codecs=Codecs.of(Sizes(network.m)),
    )
    mine = Estimate(start.position[rows], start.velocity[rows])
    return agents_at(robots, topologies, algorithm, mine, links, network.missing, ticks=ticks)


def advance(parts, k, target):
    """Let the agents of all parts send, receive and jump at t_k; return what was sent."""
    lefts = [part.left(H) for part in parts]
    silent = parts[0].silent(k)
    for listener in parts:
        receive(listener, k, np.array([0]), target[:1], target[1:])
        for part, left in zip(parts, lefts, strict=True):
            says = ~np.isin(part.robots, silent)
            receive(listener, k, part.robots[says], left.position[says], left.velocity[says])
    for part, left in zip(parts, lefts, strict=True):
        part.jump(k, left)


def together(parts):
    """Return the estimates of all robots, (2, n, m), whoever has them."""
    robots = np.concatenate([part.robots for part in parts])
    rows = np.concatenate([np.stack([p.state.position, p.state.velocity], axis=1) for p in parts])
    return rows[np.argsort(robots)].swapaxes(0, 1)


def fault_records(faults):
    """Return fault records as tuples, sorted by robot and source."""
    names = ("robot", "source", "lost", "outage", "delay", "position", "velocity")
    return sorted(tuple(record[name].tolist() for name in names) for record in faults)


@settings(FUZZ, max_examples=cases(100, 20))
@given(network=networks(), order=st.sampled_from([1, 2]))
def test_agents_agree_with_plain_python_to_the_bit(network, order):
    start, targets = start_of(network)
    n = len(network.w)
    first = {
        i: [start.position[i - 1].tolist(), start.velocity[i - 1].tolist()] for i in range(1, n + 1)
    }
    story = simulate(network, by_hand(order), first, targets.tolist(), H, TICKS)
    agents = agents_of(network, np.arange(1, n + 1), ALGORITHMS[order], start)
    for k, (_, now, faults) in enumerate(story, start=1):
        advance([agents], k, targets[k])
        theirs = np.array([now[i] for i in range(1, n + 1)]).swapaxes(0, 1)
        assert together([agents]).tolist() == theirs.tolist(), f"at k = {k}"
        assert fault_records(agents.link_events) == faults
        assert set(agents.link_events["k"].tolist()) <= {k}
        assert set(agents.link_events["time_ns"].tolist()) <= {network.t(k)}


@settings(FUZZ, max_examples=cases(50, 6))
@given(network=networks(), data=st.data())
def test_any_partition_and_restart_gives_the_same_bits(network, data):
    start, targets = start_of(network)
    n = len(network.w)
    workers = np.array(data.draw(st.lists(st.integers(0, 2), min_size=n, max_size=n)))
    break_at = data.draw(st.integers(1, TICKS - 1))

    def layouts():
        robots = np.arange(1, n + 1)
        yield [robots]
        yield [robots[i : i + 1] for i in range(n)]
        yield [robots[workers == worker] for worker in np.unique(workers)]

    whole, apart, mixed = (
        [agents_of(network, robots, ALGORITHMS[1], start) for robots in parts]
        for parts in layouts()
    )
    for k in range(1, TICKS + 1):
        if k == break_at:
            lefts = {
                int(robot): part.save(row, part.state)
                for part in apart
                for row, robot in enumerate(part.robots)
            }
            mixed = [agents_of(network, part.robots, ALGORITHMS[1], start) for part in mixed]
            for part in mixed:
                part.state = part.restore([lefts[int(robot)] for robot in part.robots])
        for parts in (whole, apart, mixed):
            advance(parts, k, targets[k])
        bits = together(whole).tobytes()
        assert together(apart).tobytes() == bits, f"at k = {k}"
        assert together(mixed).tobytes() == bits, f"at k = {k}"
        faults = fault_records(whole[0].link_events)
        for parts in (apart, mixed):
            assert (
                sorted(fault for part in parts for fault in fault_records(part.link_events))
                == faults
            )


def plain(missing="hold", **given):
    """Return two robots of which 2 receives the target and robot 1, the latter with faults."""
    return Network([[1, 0, 0], [1, 3, 0]], {(1, 2): given}, m=1, missing=missing)


def jumps(network, ticks):
    """Return to where robot 2 jumps from 0 at each tick; the target is at 1, robot 1 at 4 + k."""
    zero = Estimate(np.zeros((1, 1)), np.zeros((1, 1)))
    start = Estimate(np.zeros((2, 1)), np.zeros((2, 1)))
    agents = agents_of(network, np.array([2]), FirstOrder(1.0, 1.0), start)
    story = []
    for k in range(1, ticks + 1):
        receive(agents, k, np.array([0]), np.ones((1, 1)), np.zeros((1, 1)))
        if 1 not in agents.silent(k):
            receive(agents, k, np.array([1]), np.full((1, 1), 4.0 + k), np.zeros((1, 1)))
        agents.jump(k, values(zero))
        story.append(float(agents.state.position[0, 0]))
    return story


def test_without_a_sample_hold_uses_the_last_and_drop_the_others():
    cut = {"outages": ((10, 20), (30, 50))}  # robot 1 says 5, 6, 7, 8, 9: only 6 and 9 are received
    assert jumps(plain("hold", **cut), 5) == [1, 4.75, 4.75, 4.75, 7.0]
    assert jumps(plain("drop", **cut), 5) == [1, 4.75, 1, 1, 7.0]


def test_a_delayed_sample_is_used_once_when_it_arrives():
    assert jumps(plain("hold", delay=(2, 2)), 4) == [1, 1, 4.0, 4.75]
    assert jumps(plain("drop", delay=(2, 2)), 4) == [1, 1, 4.0, 4.75]


def test_a_silent_robot_holds_its_samples_or_does_not_jump():
    for missing, story in {"hold": [4, 4, 4, 6.25], "drop": [4, 0, 0, 6.25]}.items():
        network = plain(missing)
        network.robots = {2: ((20, 40),)}
        assert jumps(network, 4) == story


def test_other_robots_do_not_wait_for_a_silent_one():
    for missing, story in {"hold": [4, 4, 5.5], "drop": [4, 1, 5.5]}.items():
        network = plain(missing)
        network.robots = {1: ((20, 30),)}
        assert jumps(network, 3) == story


def test_links_without_faults_change_no_bit():
    network = Network([[1, 0, 0.3], [0.7, 1, 0]])
    start, targets = start_of(network)
    robots = np.array([1, 2])
    with_links = agents_of(network, robots, ALGORITHMS[1], start)
    without = agents_at(robots, topologies_of(network), ALGORITHMS[1], start)
    for k in range(1, 20):
        for agents in (with_links, without):
            advance([agents], k, targets[k])
            assert agents.link_events is None or len(agents.link_events) == 0
        assert together([with_links]).tobytes() == together([without]).tobytes()
    assert without.silent(1) == []
    kept = agents_of(plain(delay=(1, 1)), robots, ALGORITHMS[1], values_of(2))
    saved = [kept.save(row, kept.state) for row in (0, 1)]
    alone = agents_at(robots, topologies_of(plain()), ALGORITHMS[1], values_of(2))
    with pytest.raises(InputError, match="robot 2 has 72 bytes, and without faults none"):
        alone.restore(saved)


def values_of(n):
    return Estimate(np.zeros((n, 1)), np.zeros((n, 1)))


def test_a_receive_buffer_of_other_links_is_refused():
    late, later = (
        agents_of(plain(delay=(d, d)), np.array([1, 2]), ALGORITHMS[1], values_of(2))
        for d in (1, 2)
    )
    saved = [late.save(row, late.state) for row in (0, 1)]
    with pytest.raises(InputError, match="memory of robot 2 has 72 bytes, and 96 were expected"):
        later.restore(saved)
