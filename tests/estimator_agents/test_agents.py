"""The agents against the paper's matrix recursion, and against scalar sums written by hand."""

import numpy as np
import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.installed import algorithm_names, load_algorithm
from nrs_cosim.estimator_agents.theory.recursion import linear_jump
from tests.bus.test_topology import PAPER
from tests.estimator_agents.agents_without_bus import agents_at, receive, values
from tests.estimator_agents.paper import first_order, recursion, second_order, target

TICKS = 300


def initial(seed: int) -> Estimate:
    rng = np.random.default_rng(seed)
    return Estimate(rng.uniform(-25, 25, (6, 2)), rng.uniform(-25, 25, (6, 2)))


def estimates(agents: Agents, h: float, ticks: int) -> list[Estimate]:
    """Return the left limits at t_1 … of agents that receive from one another and the target."""
    story = []
    for k in range(1, ticks + 1):
        left = agents.left(h)
        story.append(left)
        position, velocity = target(k * h)
        receive(agents, k, np.array([0]), position[None], velocity[None])
        receive(agents, k, agents.robots, left.position, left.velocity)
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
    agents = agents_at(
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


def test_robots_split_over_agents_jump_to_the_same_bits():
    topology, algorithm, start = (
        TopologySchedule.constant(Topology.of(*PAPER)),
        FirstOrder(0.9, 1.1),
        initial(5),
    )
    together = agents_at(np.arange(1, 7), topology, algorithm, start)
    left = start.after(0.1)
    position, velocity = target(0.1)
    parts = []
    for robots in (np.array([1, 5]), np.array([2, 3, 4]), np.array([6])):
        rows = robots - 1
        part = agents_at(robots, topology, algorithm, start)
        for agents in (part, together):
            receive(agents, 1, np.array([0]), position[None], velocity[None])
            receive(agents, 1, np.arange(1, 7), left.position, left.velocity)
        part.jump(1, values(left).at(rows))
        parts.append((rows, part.state))
    together.jump(1, values(left))
    for rows, estimate in parts:
        assert estimate.position.tobytes() == together.state.position[rows].tobytes()
        assert estimate.velocity.tobytes() == together.state.velocity[rows].tobytes()


def test_a_robot_ignores_all_but_its_in_neighbours():
    topology, start = TopologySchedule.constant(Topology.of(*PAPER)), initial(5)
    left = start.after(0.1)
    heard_by = {}
    for loud in range(7):
        agents = agents_at(np.arange(1, 7), topology, FirstOrder(0.9, 1.1), start)
        position = np.vstack([target(0.1)[0], left.position])
        velocity = np.vstack([target(0.1)[1], left.velocity])
        position[loud] += 1e3
        receive(agents, 1, np.arange(7), position, velocity)
        agents.jump(1, values(left))
        heard_by[loud] = agents.state.position
    quiet = agents_at(np.arange(1, 7), topology, FirstOrder(0.9, 1.1), start)
    receive(
        quiet,
        1,
        np.arange(7),
        np.vstack([target(0.1)[0], left.position]),
        np.vstack([target(0.1)[1], left.velocity]),
    )
    quiet.jump(1, values(left))
    moved = {
        loud: (np.flatnonzero((position != quiet.state.position).any(axis=1)) + 1).tolist()
        for loud, position in heard_by.items()
    }
    assert moved == {0: [3], 1: [2, 4], 2: [1, 5], 3: [1, 4, 5, 6], 4: [5], 5: [], 6: []}


def test_second_order_positions_are_continuous():
    start = initial(2)
    agents = agents_at(
        np.arange(1, 7),
        TopologySchedule.constant(Topology.of(*PAPER)),
        SecondOrder(1.1, 0.9),
        start,
    )
    left = start.after(0.1)
    receive(agents, 1, np.arange(7), np.ones((7, 2)), np.ones((7, 2)))
    agents.jump(1, values(left))
    assert agents.state.position is left.position
    assert not np.array_equal(agents.state.velocity, left.velocity)


class Endless(FirstOrder):
    """Its jumps are infinite, but for the first robot's."""

    def jump(self, estimate, disagreement):
        after = super().jump(estimate, disagreement)
        after.velocity[1:] = np.inf
        return after


def test_a_non_finite_jump_is_reported_with_algorithm_robot_and_tick():
    agents = agents_at(
        np.arange(1, 7),
        TopologySchedule.constant(Topology.of(*PAPER)),
        Endless(0.9, 1.1),
        initial(1),
    )
    with pytest.raises(
        AlgorithmError,
        match=r"^algorithm Endless: jump returned a velocity of inf for robot 2 at",
    ):
        estimates(agents, 0.1, 1)


def test_a_non_finite_jump_is_reported_by_check():
    with pytest.raises(AlgorithmError, match=r"^algorithm Endless: jump returned inf where it was"):
        linear_jump(Endless(0.9, 1.1))


def test_algorithms_are_found_by_name():
    assert {"dcea1", "dcea2"} <= set(algorithm_names())
    assert load_algorithm("dcea2", {"alpha": 1.1, "beta": 0.9}) == SecondOrder(1.1, 0.9)


ONES = Estimate(*np.ones((2, 2, 2)))


def lone_graph() -> TopologySchedule:
    return TopologySchedule.constant(Topology.of(*PAPER))


def lone() -> Agents:
    """Return the agents of two robots of the example, whose links have no faults."""
    return agents_at([2, 5], lone_graph(), FirstOrder(0.9, 1.1), ONES)


def test_agents_without_link_faults_keep_only_their_estimate():
    agents = lone()
    assert agents.silent(3) == []
    assert agents.link_events is None
    saved = [agents.save(row, agents.state) for row in (0, 1)]
    assert [len(one) for one in saved] == [saved[0].__len__()] * 2
    left = agents.restore(saved)
    assert {name: value.tolist() for name, value in left.items()} == {
        name: value.tolist() for name, value in agents.state.items()
    }


def test_a_checkpoint_of_another_algorithm_is_refused():
    agents, other = lone(), agents_at([2, 5], lone_graph(), SecondOrder(1, 1), ONES)
    saved = [other.save(row, other.state) for row in (0, 1)]
    with pytest.raises(InputError, match=r"^robot 2's checkpoint was not saved by algorithm First"):
        agents.restore(saved)
