"""Honest robots stay within what is proven, whatever they are sent, and come to the target."""

import numpy as np
import pytest

from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.theory.honest_hull import honest_hull
from nrs_cosim.estimator_agents.theory.robustness import out_of_reach
from nrs_cosim.estimator_agents.wmsr import Wmsr
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.cli.theory_text import convergence_rows
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.export.tables import states
from nrs_cosim.recordings.mcap.reader import Reader
from tests.estimator_agents.agents_without_bus import agents_at
from tests.scenarios import example

H, N, M = 0.1, 6, 2


def by_hand(times, start, target):
    """Return least and largest positions and velocities, step by step."""
    low, high = start.position.min(axis=0), start.position.max(axis=0)
    slow, fast = start.velocity.min(axis=0), start.velocity.max(axis=0)
    least, largest = low, high
    for k, h in enumerate(np.diff(times)):
        low, high = low + h * slow, high + h * fast
        least, largest = np.minimum(least, low), np.maximum(largest, high)
        low, high = np.minimum(low, target.position[k]), np.maximum(high, target.position[k])
        least, largest = np.minimum(least, low), np.maximum(largest, high)
        slow = np.minimum(slow, target.velocity[k])
        fast = np.maximum(fast, target.velocity[k])
    return np.stack([least, largest], axis=1), np.stack([slow, fast], axis=1)


def case(rng, ticks):
    times = np.cumsum([0.0, *rng.uniform(0.05, 0.2, ticks)])
    start = Estimate(*rng.normal(size=(2, N, M)))
    slope, turn = rng.normal(size=(2, M))
    position = slope * times[1:, None] + np.sin(times[1:, None] + turn)
    return times, start, Estimate(position, slope + np.cos(times[1:, None] + turn))


def test_it_is_what_comes_out_step_by_step():
    rng = np.random.default_rng(0)
    for _ in range(300):
        times, start, target = case(rng, int(rng.integers(1, 12)))
        found = honest_hull(times, start, target)
        position, velocity = by_hand(times, start, target)
        np.testing.assert_allclose(found.position, position, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.velocity, velocity, rtol=1e-12, atol=1e-12)


def lied_to(rng, F, target, ticks, start, reach=0):
    """Run honest robots 1 … N − F among liars that send anything; return all their left limits."""
    while True:
        received = rng.random((N, N + 1)) < 0.8
        received[:, 1:][np.eye(N, dtype=bool)] = False
        sink, source = np.nonzero(received)
        topology = Topology.of_edges(N, source, sink + 1, np.ones(len(sink)))
        if not reach or out_of_reach(topology, reach) == 0:
            break
    honest, liars = np.arange(1, N + 1 - F), np.arange(N + 1 - F, N + 1)
    own = Estimate(start.position[: N - F], start.velocity[: N - F])
    agents = agents_at(honest, TopologySchedule.constant(topology), Wmsr(F), own, missing="drop")
    found = []
    for k in range(1, ticks + 1):
        left = agents.left(H)
        found.append(np.stack([left.position, left.velocity]))
        agents.receive(k, honest, left)
        size = 10.0 ** rng.integers(-1, 4, (F, M))
        lie = {name: size * rng.normal(size=(F, M)) for name in ("position", "velocity")}
        agents.receive(k, liars, lie)
        at = {name: getattr(target, name)[None, k - 1] for name in ("position", "velocity")}
        agents.receive(k, np.array([0]), at)
        agents.jump(k, left)
    return np.array(found)


@pytest.mark.parametrize("F", [1, 2])
def test_whatever_liars_send_honest_robots_stay_within_it(F):
    rng, ticks = np.random.default_rng(F), 30
    times = np.arange(ticks + 1) * H
    for _ in range(25):
        _, start, target = case(rng, ticks)
        own = Estimate(start.position[: N - F], start.velocity[: N - F])
        hull = honest_hull(times, own, target)
        found = lied_to(rng, F, target, ticks, start)
        for part, bounds in zip(found.swapaxes(0, 1), (hull.position, hull.velocity), strict=True):
            assert (part >= bounds[:, 0] - 1e-12).all()
            assert (part <= bounds[:, 1] + 1e-12).all()


def test_they_come_to_a_target_that_moves_straight_and_reaches_all_often_enough():
    rng, ticks = np.random.default_rng(9), 300
    rate = np.array([1.0, -2.0])
    t = np.arange(1, ticks + 1)[:, None] * H
    target = Estimate(3 + rate * t, np.broadcast_to(rate, (ticks, M)))
    for _ in range(3):
        start = Estimate(*rng.normal(size=(2, N, M)))
        found = lied_to(rng, 1, target, ticks, start, reach=3)
        np.testing.assert_allclose(found[-1, 0], [target.position[-1]] * (N - 1), atol=1e-6)


def test_one_robot_alone_that_receives_the_target_is_left_out_by_all_others():
    """Of F = 1 it is an outlier, and the others stay where they are; the condition says so."""
    pairs = [(j, i) for i in range(1, 5) for j in range(1, 5) if i != j]
    source, sink = np.array([(0, 1), *pairs]).T
    topology = Topology.of_edges(4, source, sink, np.ones(len(source)))
    start = Estimate(np.zeros((4, 1)), np.zeros((4, 1)))
    robots = np.arange(1, 5)
    agents = agents_at(robots, TopologySchedule.constant(topology), Wmsr(1), start)
    for k in range(1, 50):
        left = agents.left(H)
        agents.receive(k, robots, left)
        agents.receive(k, [0], {"position": np.ones((1, 1)), "velocity": np.zeros((1, 1))})
        agents.jump(k, left)
    assert (agents.state.position[1:] == 0).all()
    out = Wmsr(1).graph_conditions(topology, frozenset())[-1]
    assert (out.source, out.left, out.holds) == ("the bound of statement B2", 3, False)


def test_check_says_it_and_a_run_keeps_to_it(tmp_path):
    moving = {"target.axes": [{"offset": 1.0, "rate": 0.5}, {"offset": -1.0}], "run.duration": 5.0}
    experiment = example("byzantine_wmsr", moving)
    found = check(experiment)
    assert [condition.holds for condition in found.conditions[:3]] == [True] * 3
    shown = convergence_rows(found)["honest"]
    assert shown.startswith("positions stay within [")
    assert shown.endswith("in this run, whatever liars send (statement B1)")
    with Reader(run(experiment, tmp_path / "run.mcap").path) as reader:
        table = np.concatenate([*states(reader)])
    honest = table[table["robot"] != 4]
    as_json = found.as_json()["honest"]
    for name in ("position", "velocity"):
        low, high = np.array(as_json[name]).T
        reference = honest[f"reference_{name}"]
        assert (reference >= low - 1e-12).all()
        assert (reference <= high + 1e-12).all()
    assert np.ptp(as_json["position"][0]) < 12
    for change in (
        {"algorithm.F": 0},
        {"faults.links": [{"loss": 0.1}]},
        {"algorithm": {"name": "dcea1", "alpha": 0.5, "beta": 0.5}},
    ):
        assert check(example("byzantine_wmsr", moving, change)).hull is None
