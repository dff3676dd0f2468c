"""Between two samples of a robot there are never fewer periods than is proven."""

import numpy as np
import pytest

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.event_triggered import EventTriggered
from nrs_cosim.estimator_agents.impulsive import Impulsive
from nrs_cosim.estimator_agents.theory.received_errors import largest_jumps, periods_between
from nrs_cosim.estimator_agents.theory.recursion import recursion_of

H = 0.1
CASES, ROBOTS, TICKS = 320, 4, 250


def bound(law, D, gamma_1, gamma_2, h=H):
    """Return the proven periods of each robot; D has the weights of robots, the target the rest."""
    n = len(D)
    whole = np.column_stack([1 - D.sum(axis=1), D])
    sink, source = np.nonzero(whole)
    topology = Topology.of_edges(n, source, sink + 1, whole[sink, source])
    recursion = recursion_of(FirstOrder(law.alpha, law.beta), topology, h)
    radius = max(abs(np.linalg.eigvals(recursion.matrix)))
    return periods_between(law, recursion, gamma_1, gamma_2, radius)


def simulated(alpha, beta, c0, d0, D, target, ticks, h=H):
    """Return who sends when, (ticks, cases, n), of robots that begin at the target.

    Gains and thresholds are (cases,), D is (cases, n, n), and the target is a function of time.
    """
    many, n, _ = D.shape
    of_target = 1 - D.sum(axis=2)
    alpha, beta, c0, d0 = (np.reshape(part, (-1, 1)) for part in (alpha, beta, c0, d0))
    x, v = (np.repeat(part[:, None], n, axis=1) for part in target(0.0))
    model_x, model_v = x.copy(), v.copy()
    sends = np.ones((ticks, many, n), bool)
    for k in range(1, ticks + 1):
        x, model_x = x + h * v, model_x + h * model_v
        if k > 1:
            sends[k - 1] = (abs(x - model_x) > c0) | (abs(v - model_v) > d0)
        now = sends[k - 1]
        model_x, model_v = np.where(now, x, model_x), np.where(now, v, model_v)
        at, rate = (part[:, None] for part in target(k * h))
        x = x + alpha * (np.einsum("bij,bj->bi", D, model_x) + of_target * at - x)
        v = v + beta * (np.einsum("bij,bj->bi", D, model_v) + of_target * rate - v)
    return sends


def least_gaps(sends):
    """Return the least number of ticks between two samples, (cases, n); infinite without two."""
    ticks = np.arange(len(sends)).reshape(-1, 1, 1)
    last = np.maximum.accumulate(np.where(sends, ticks, -(10**9)))
    gaps = np.where(sends[1:], ticks[1:] - last[:-1], np.inf)
    return gaps.min(axis=0)


def test_no_gap_of_random_systems_is_shorter_than_is_proven():
    rng = np.random.default_rng(14)
    D = rng.uniform(0.2, 1, (CASES, ROBOTS, ROBOTS + 1)) * (
        rng.random((CASES, ROBOTS, ROBOTS + 1)) < 0.5
    )
    for robot in range(ROBOTS):  # each receives one before it, so that the target reaches all
        D[np.arange(CASES), robot, rng.integers(0, robot + 1, CASES)] = 1.0
        D[:, robot, robot + 1] = 0.0
    D = D[:, :, 1:] / D.sum(axis=2, keepdims=True)
    alpha, beta = 10 ** rng.uniform(-1.5, 0, (2, CASES))
    c0, d0 = 10 ** rng.uniform(-2.5, 0.5, (2, CASES))
    omega, size = 10 ** rng.uniform(-1, 1, CASES), 10 ** rng.uniform(-2, 0.5, CASES)
    rate, shift = rng.normal(size=(2, CASES))

    def target(t):
        angle = omega * t + shift
        return size / omega**2 * np.sin(angle) + rate * t, size / omega * np.cos(angle) + rate

    gaps = least_gaps(simulated(alpha, beta, c0, d0, D, target, TICKS))
    proven = np.array(
        [
            bound(EventTriggered(*four), weights, abs(b) + a / w, a)
            for *four, weights, a, w, b in zip(
                alpha, beta, c0, d0, D, size, omega, rate, strict=True
            )
        ]
    )
    assert (gaps >= proven).all()
    assert (proven > 1).mean() > 0.2
    assert ((gaps == proven) & (proven > 1)).sum() > 10


@pytest.mark.parametrize(("c0", "d0"), [(9.0, 0.03), (9.0, 0.25), (0.013, 9.0), (0.5, 9.0)])
def test_one_robot_with_gains_of_1_sends_when_what_it_follows_has_moved_so_far(c0, d0):
    """It is where the target was: υ off by h γ2 a period, ε by h² γ2 (q²/2 + q) at most."""
    gamma_2, q = 0.4, 1
    while q * H * gamma_2 < d0 and H**2 * gamma_2 * (q**2 / 2 + q) < c0:
        q += 1
    law = EventTriggered(1.0, 1.0, c0, d0)
    assert bound(law, np.zeros((1, 1)), 100.0, gamma_2).tolist() == [q]

    def target(t):
        return np.array([gamma_2 * t**2 / 2]), np.array([gamma_2 * t])

    sends = simulated(1.0, 1.0, c0, d0, np.zeros((1, 1, 1)), target, 200)
    assert least_gaps(sends) >= q
    if c0 == 9:
        assert least_gaps(sends) in (q, q + 1)  # one more where it comes to d0, and not beyond it


def test_jumps_are_the_most_that_a_target_and_errors_of_the_worst_signs_make():
    D = np.array([[0, 0, 0.25], [1, 0, 0], [0.5, 0.5, 0]])
    whole = np.column_stack([1 - D.sum(axis=1), D])
    sink, source = np.nonzero(whole)
    topology = Topology.of_edges(3, source, sink + 1, whole[sink, source])
    recursion = recursion_of(FirstOrder(0.5, 0.8), topology, H)
    A, off = np.asarray(recursion.matrix), {"position": 0.2, "velocity": 0.1}
    radius = max(abs(np.linalg.eigvals(A)))
    found = largest_jumps(recursion, off, 100.0, 0.3, radius)
    gain = np.diag([0.5, 0.5, 0.5, 0.8, 0.8, 0.8])
    pull, received = gain @ (np.kron(np.eye(2), D) - np.eye(6)), gain @ np.kron(np.eye(2), D)
    F = np.kron([[1, H], [0, 1]], np.eye(3))
    errors = np.repeat([0.2, 0.1], 3)
    u = (np.arange(1000) + 0.5) / 1000 * H
    total, power = abs(received) @ errors, np.eye(6)
    for _ in range(400):
        total = total + abs(pull @ power @ F @ received) @ errors
        kernel = pull @ power @ np.kron(np.array([u, np.ones(1000)]), np.ones((3, 1)))
        total = total + 0.3 * abs(kernel).mean(axis=1) * H
        power = A @ power
    np.testing.assert_allclose(found.ravel(), total, rtol=1e-6)


def test_what_nobody_sends_is_never_sent_and_silence_ends_it():
    jumps = np.array([0.0]), np.array([0.0])
    assert EventTriggered(1.0, 1.0, 0.1, 0.1).periods_between(*jumps, h=H).tolist() == [1e10]
    ends = EventTriggered(1.0, 1.0, 0.1, 0.1, longest_silence=0.7)
    assert ends.periods_between(*jumps, h=H).tolist() == [7]
    all_is_sent = EventTriggered(1.0, 1.0, 0.0, 0.0)
    assert all_is_sent.periods_between(np.array([0.1]), np.array([0.1]), h=H).tolist() == [1]


def test_of_an_algorithm_that_always_sends_and_of_what_is_not_known_nothing_is_said():
    topology, off = Topology.of_edges(1, [0], [1], [1.0]), {"position": 1.0, "velocity": 1.0}
    recursion = recursion_of(FirstOrder(0.5, 0.5), topology, H)
    assert periods_between(FirstOrder(0.5, 0.5), recursion, 1.0, 1.0, 0.5) is None
    assert periods_between(EventTriggered(0.5, 0.5, 1, 1), None, 1.0, 1.0, 0.5) is None
    assert largest_jumps(recursion, off, 1.0, 1.0, 1.0) is None
    damped = recursion_of(Impulsive(0.5, 0.5), topology, H)
    assert largest_jumps(damped, off, 1.0, 1.0, 0.5) is None
