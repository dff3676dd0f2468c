"""What errors of received samples add is never exceeded, and by some of them reached."""

import numpy as np
import pytest

from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.dcea3 import ThirdOrder
from nrs_cosim.estimator_agents.event_triggered import EventTriggered
from nrs_cosim.estimator_agents.theory.linear_step import linear_step
from nrs_cosim.estimator_agents.theory.received_errors import largest_jumps, received_errors
from nrs_cosim.estimator_agents.theory.recursion import recursion_of
from tests.estimator_agents.agents_without_bus import meet
from tests.estimator_agents.test_bundled import made

H = 0.1
F_THIRD = np.array([[1, H, H**2 / 2], [0, 1, H], [0, 0, 1]])


def path(n):
    return Topology.of_edges(n, np.arange(n), np.arange(1, n + 1), np.ones(n))


def digraph(rng, n=8):
    """Return a random digraph that the target reaches."""
    edges = {(int(rng.integers(0, i)), i) for i in range(1, n + 1)}
    edges |= {(int(j), int(i)) for j, i in rng.integers([0, 1], n + 1, (12, 2)) if j != i}
    source, sink = np.array(sorted(edges, key=lambda edge: edge[::-1])).T
    return Topology.of_edges(n, source, sink, rng.uniform(0.5, 2, len(edges)))


def radius_of(recursion):
    return max(abs(np.linalg.eigvals(recursion.matrix)))


def added_of(law, topology, off):
    recursion = recursion_of(law, topology, H)
    given = dict(zip(("position", "velocity"), off, strict=True))
    found = received_errors(recursion, topology.D, given, radius_of(recursion)).sampled
    return np.array([found.position, found.velocity]), recursion


@pytest.mark.parametrize("n", [1, 2, 5])
def test_on_a_path_each_robot_adds_what_it_receives_wrongly(n):
    found, _ = added_of(FirstOrder(0.5, 0.5), path(n), [0.2, 0.0])
    np.testing.assert_allclose(found, [(n - 1) * 0.2, 0], atol=1e-12)
    # a velocity that is wrong by 0.3 moves an estimate by h 0.3 until it is received again
    found, _ = added_of(FirstOrder(1.0, 1.0), path(n), [0.0, 0.3])
    np.testing.assert_allclose(found[1], (n - 1) * 0.3, atol=1e-12)


@pytest.mark.parametrize(
    "law", [FirstOrder(0.9, 0.8), FirstOrder(1.1, 1.15), SecondOrder(1.1, 0.9)],
    ids=["nothing is negative", "first order", "second order"],
)  # fmt: skip
def test_errors_of_the_worst_signs_come_to_it_and_others_stay_within(law):
    rng = np.random.default_rng(2)
    topology, off = digraph(rng), np.array([0.2, 0.1])
    found, recursion = added_of(law, topology, off)
    n, A = recursion.n, np.asarray(recursion.matrix)
    B = np.kron(recursion.flow @ recursion.gain, recursion.D) * np.repeat(off, n)
    powers = [B]
    for _ in range(2000):
        powers.append(A @ powers[-1])
    kernels = np.array(powers)
    totals = np.abs(kernels).sum(axis=(0, 2)).reshape(2, n)
    np.testing.assert_allclose(found, totals.max(axis=1), rtol=1e-9)
    worst = int(totals[0].argmax())
    x = np.zeros(2 * n)
    for signs in np.sign(kernels[::-1, worst]):
        x = A @ x + B @ signs
    assert x[worst] == pytest.approx(found[0], rel=1e-9)
    x = np.zeros(2 * n)
    for _ in range(500):
        x = A @ x + B @ rng.uniform(-1, 1, 2 * n)
        assert (np.abs(x.reshape(2, n)).max(axis=1) <= found).all()


@pytest.mark.parametrize("seed", range(12))
def test_triggered_agents_stay_within_it_after_a_target_of_constant_velocity(seed):
    rng = np.random.default_rng(seed)
    topology, c0, d0 = digraph(rng), 0.05, 0.02
    law = EventTriggered(0.6, 0.6, c0, d0)
    nominal, off = law.nominal()
    assert (nominal, off) == (FirstOrder(0.6, 0.6), {"position": c0, "velocity": d0})
    bound, _ = added_of(nominal, topology, [c0, d0])
    start = {"position": 9 * rng.normal(size=(8, 1)), "velocity": 3 * rng.normal(size=(8, 1))}
    (agents,) = made(law, TopologySchedule.constant(topology), start)
    most, sent = np.zeros(2), 0
    for k in range(1, 801):
        left = agents.left(H)
        target = {"position": np.array([2 * k * H]), "velocity": np.array([2.0])}
        who = meet([agents], k, H, target)
        if k > 400:
            sent += len(who)
            apart = [abs(left[name] - target[name]).max() for name in ("position", "velocity")]
            most = np.maximum(most, apart)
    assert (most <= bound + 1e-9).all()
    assert most[0] > 0.1 * bound[0]
    assert sent < 0.2 * 8 * 400


@pytest.mark.parametrize(("n", "known"), [(100, True), (101, False)])
def test_of_more_than_100_robots_that_overshoot_nothing_is_said(n, known):
    star = Topology.of_edges(n, [0, *[1] * (n - 1)], np.arange(1, n + 1), np.ones(n))
    recursion, off = recursion_of(FirstOrder(1.1, 0.9), star, H), {"position": 1, "velocity": 1}
    assert (received_errors(recursion, star.D, off, 0.1) is not None) == known
    assert known or largest_jumps(recursion, off, 1.0, 1.0, 0.1) is None


def test_of_a_recursion_that_grows_nothing_is_said():
    recursion = recursion_of(FirstOrder(0.9, 0.9), path(3), H)
    assert received_errors(recursion, path(3).D, {"position": 1, "velocity": 1}, 1.0) is None


@pytest.mark.parametrize("law", [FirstOrder(0.9, 0.8), SecondOrder(1.1, 0.9)], ids=["1", "2"])
def test_of_a_period_of_whatever_is_kept_it_is_the_same(law):
    topology, off = digraph(np.random.default_rng(5)), {"position": 0.2, "velocity": 0.1}
    recursion = recursion_of(law, topology, H)
    radius = radius_of(recursion)
    expected = received_errors(recursion, topology.D, off, radius).sampled
    found = received_errors(linear_step(law, H), topology.D, off, radius).sampled
    assert found.position == pytest.approx(expected.position, rel=1e-9)
    assert found.velocity == pytest.approx(expected.velocity, rel=1e-9)


def test_of_a_third_order_errors_of_accelerations_add_too():
    law, n = ThirdOrder(1.0, 1.0, 1.0), 3
    off = {"position": 0.0, "velocity": 0.0, "acceleration": 0.5}
    found = received_errors(linear_step(law, H), path(n).D, off, 0.0).sampled
    # two of three receive it wrongly, one after the other: h²/2 and h times 0.5, and what it moves
    A, B = (np.kron(F_THIRD, part) for part in (np.eye(n, k=-1), np.eye(n, k=-1)))
    total, power = np.zeros(3 * n), B
    for _ in range(n):
        total += np.abs(power) @ np.repeat([0, 0, 0.5], n)
        power = A @ power
    np.testing.assert_allclose(
        [found.position, found.velocity], total.reshape(3, n)[:2].max(axis=1), rtol=1e-12
    )
