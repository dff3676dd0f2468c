"""The agents against the paper's matrix recursion, and against scalar sums written by hand."""

import numpy as np
import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.estimator_agents.algorithm import algorithm_names, load_algorithm
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.theory.recursion import linear_jump
from tests.bus.test_topology import PAPER
from tests.estimator_agents.paper import first_order, recursion, second_order, target

TICKS = 300


def initial(seed: int) -> Estimate:
    rng = np.random.default_rng(seed)
    return Estimate(rng.uniform(-25, 25, (6, 2)), rng.uniform(-25, 25, (6, 2)))


def estimates(agents: Agents, h: float, ticks: int) -> list[Estimate]:
    """Return the left limits at t_1 … of agents that hear one another and the target."""
    story = []
    for k in range(1, ticks + 1):
        left = agents.estimate.after(h)
        story.append(left)
        position, velocity = target(k * h)
        agents.hear(k, np.array([0]), position[None], velocity[None])
        agents.hear(k, agents.robots, left.position, left.velocity)
        assert agents.missing(k) == []
        agents.jump(k, left)
    return story


@pytest.mark.parametrize(
    ("algorithm", "matrix", "h"),
    [
        (FirstOrder(0.9, 1.1), first_order, 0.1),
        (FirstOrder(0.9, 1.1), first_order, 0.5),
        (SecondOrder(1.1, 0.9), second_order, 0.1),
        (SecondOrder(1.1, 0.9), second_order, 0.45),
    ],
    ids=["first 0.1", "first 0.5", "second 0.1", "second 0.45"],
)
def test_estimates_obey_the_matrix_recursion(algorithm, matrix, h):
    agents = Agents(
        np.arange(1, 7), TopologySchedule.constant(Topology.of(*PAPER)), algorithm, initial(3)
    )
    story = estimates(agents, h, TICKS)
    x1 = np.concatenate([story[0].position - target(h)[0], story[0].velocity - target(h)[1]])
    oracle = recursion(matrix(algorithm.alpha, algorithm.beta, h), x1, h, TICKS)
    for k, (left, x) in enumerate(zip(story, oracle, strict=True), start=1):
        position, velocity = target(k * h)
        expected = np.concatenate([x[:6] + position, x[6:] + velocity])
        ours = np.concatenate([left.position, left.velocity])
        np.testing.assert_allclose(ours, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


def test_robots_apart_jump_to_the_same_bits_as_together():
    topology, algorithm, start = (
        TopologySchedule.constant(Topology.of(*PAPER)),
        FirstOrder(0.9, 1.1),
        initial(5),
    )
    together = Agents(np.arange(1, 7), topology, algorithm, start)
    left = start.after(0.1)
    position, velocity = target(0.1)
    parts = []
    for robots in (np.array([1, 5]), np.array([2, 3, 4]), np.array([6])):
        rows = robots - 1
        part = Agents(robots, topology, algorithm, start)
        for agents in (part, together):
            agents.hear(1, np.array([0]), position[None], velocity[None])
            agents.hear(1, np.arange(1, 7), left.position, left.velocity)
        part.jump(1, Estimate(left.position[rows], left.velocity[rows]))
        parts.append((rows, part.estimate))
    together.jump(1, left)
    for rows, estimate in parts:
        assert estimate.position.tobytes() == together.estimate.position[rows].tobytes()
        assert estimate.velocity.tobytes() == together.estimate.velocity[rows].tobytes()


def test_a_robot_is_deaf_to_all_but_its_in_neighbours():
    topology, start = TopologySchedule.constant(Topology.of(*PAPER)), initial(5)
    left = start.after(0.1)
    heard_by = {}
    for loud in range(7):
        agents = Agents(np.arange(1, 7), topology, FirstOrder(0.9, 1.1), start)
        position = np.vstack([target(0.1)[0], left.position])
        velocity = np.vstack([target(0.1)[1], left.velocity])
        position[loud] += 1e3
        agents.hear(1, np.arange(7), position, velocity)
        agents.jump(1, left)
        heard_by[loud] = agents.estimate.position
    quiet = Agents(np.arange(1, 7), topology, FirstOrder(0.9, 1.1), start)
    quiet.hear(
        1,
        np.arange(7),
        np.vstack([target(0.1)[0], left.position]),
        np.vstack([target(0.1)[1], left.velocity]),
    )
    quiet.jump(1, left)
    moved = {
        loud: (np.flatnonzero((position != quiet.estimate.position).any(axis=1)) + 1).tolist()
        for loud, position in heard_by.items()
    }
    assert moved == {0: [3], 1: [2, 4], 2: [1, 5], 3: [1, 4, 5, 6], 4: [5], 5: [], 6: []}


def test_missing_names_the_silent_until_they_speak():
    agents = Agents(
        np.arange(1, 7),
        TopologySchedule.constant(Topology.of(*PAPER)),
        FirstOrder(0.9, 1.1),
        initial(1),
    )
    assert agents.missing(1) == [0, 1, 2, 3, 4]
    agents.hear(1, np.array([0, 2, 3]), np.zeros((3, 2)), np.zeros((3, 2)))
    assert agents.missing(1) == [1, 4]
    assert agents.missing(2) == [0, 1, 2, 3, 4]


def test_second_order_positions_are_continuous():
    start = initial(2)
    agents = Agents(
        np.arange(1, 7),
        TopologySchedule.constant(Topology.of(*PAPER)),
        SecondOrder(1.1, 0.9),
        start,
    )
    left = start.after(0.1)
    agents.hear(1, np.arange(7), np.ones((7, 2)), np.ones((7, 2)))
    agents.jump(1, left)
    assert agents.estimate.position is left.position
    assert not np.array_equal(agents.estimate.velocity, left.velocity)


class Endless(FirstOrder):
    """Its jumps are infinite, but for the first robot's."""

    def jump(self, estimate, heard):
        after = super().jump(estimate, heard)
        after.velocity[1:] = np.inf
        return after


def test_a_jump_that_is_no_number_is_told_with_algorithm_robot_and_tick():
    agents = Agents(
        np.arange(1, 7),
        TopologySchedule.constant(Topology.of(*PAPER)),
        Endless(0.9, 1.1),
        initial(1),
    )
    with pytest.raises(
        AlgorithmError, match=r"^algorithm Endless: jump returned inf for robot 2 at"
    ):
        estimates(agents, 0.1, 1)


def test_a_check_of_a_jump_that_is_no_number_says_so():
    with pytest.raises(AlgorithmError, match=r"^algorithm Endless: jump returned inf where it was"):
        linear_jump(Endless(0.9, 1.1))


def test_algorithms_are_found_by_name():
    assert {"dcea1", "dcea2"} <= set(algorithm_names())
    assert load_algorithm("dcea2", {"alpha": 1.1, "beta": 0.9}) == SecondOrder(1.1, 0.9)


def lone() -> Agents:
    """Return the agents of two robots of the example, whose links have no faults."""
    topologies = TopologySchedule.constant(Topology.of(*PAPER))
    return Agents(np.array([2, 5]), topologies, FirstOrder(0.9, 1.1), Estimate(*np.ones((2, 2, 2))))


def test_agents_without_faults_have_no_memory():
    agents = lone()
    assert agents.memory(0) == agents.memory(1) == b""
    assert agents.silent(3) == agents.faulty == []
    assert len(agents.link_events) == 0
    agents.recall(1, b"")
    with pytest.raises(InputError, match="the memory of robot 5 has 3 bytes, and without faults"):
        agents.recall(1, b"abc")


def test_what_a_robot_was_told_stays_as_it_was_when_more_is_told():
    agents = lone()
    sources = Topology.of(*PAPER).in_neighbours(5).tolist()
    for k in (1, 2):
        for j in sources:
            agents.hear(k, np.array([j]), np.full((1, 2), 10.0 * k + j), np.full((1, 2), 1.0 * k))
        if k == 1:
            first = agents.heard_by(5)
    assert list(first) == sources
    for j, (position, velocity) in first.items():
        assert position.tolist() == [10.0 + j] * 2
        assert velocity.tolist() == [1.0] * 2
    later = agents.heard_by(5)
    assert all(later[j][0].tolist() == [20.0 + j] * 2 for j in sources)
