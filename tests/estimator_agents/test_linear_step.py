"""What a period of a linear algorithm is follows from its code; of others nothing is said."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import modes
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.dcea3 import ThirdOrder
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.impulsive import Impulsive
from nrs_cosim.estimator_agents.kalman_consensus import KalmanConsensus
from nrs_cosim.estimator_agents.pi_consensus import PIConsensus
from nrs_cosim.estimator_agents.sliding import Sliding
from nrs_cosim.estimator_agents.theory.aperiodic import Periods, radius_bounds
from nrs_cosim.estimator_agents.theory.declared_modes import expect_modes
from nrs_cosim.estimator_agents.theory.delays import LateStep
from nrs_cosim.estimator_agents.theory.estimates import steady_motion
from nrs_cosim.estimator_agents.theory.linear_step import linear_step, radius_of_list
from nrs_cosim.estimator_agents.theory.recursion import linear_jump, recursion_of
from nrs_cosim.estimator_agents.values import Values
from tests.estimator_agents.agents_without_bus import agents_at, meet
from tests.estimator_agents.paper import HARMONIC, PAPER, D, target

H = 0.4
SPECTRUM = np.linalg.eigvals(D).astype(complex)
LAWS = [FirstOrder(0.9, 1.1), SecondOrder(1.1, 0.9), Impulsive(0.6, 0.9)]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_of_those_that_only_jump_it_is_what_their_jump_says(law):
    keep, gain = linear_jump(law)
    F = np.array([[1, H], [0, 1]])
    step = linear_step(law, H)
    np.testing.assert_allclose(step.own, F @ (keep - gain), atol=1e-12)
    np.testing.assert_allclose(step.received, F @ gain, atol=1e-12)


def same(found, expected):
    """Assert that two spectra are the same, in any order."""
    found, expected = list(found), list(expected)
    assert len(found) == len(expected)
    for one in expected:
        nearest = min(range(len(found)), key=lambda i: abs(found[i] - one))
        assert abs(found.pop(nearest) - one) < 1e-6


@pytest.mark.parametrize(
    "law", [*LAWS, PIConsensus(0.7, 1.0, 0.3)], ids=lambda law: type(law).__name__
)
def test_modes_are_those_that_are_declared(law):
    same(linear_step(law, H).modes(SPECTRUM), modes(law, (SPECTRUM,), H))


def test_of_third_order_modes_are_those_of_each_gain():
    law = ThirdOrder(0.7, 0.6, 0.5)
    found = linear_step(law, H).modes(SPECTRUM)
    same(found, np.concatenate([1 - gain * (1 - SPECTRUM) for gain in (0.7, 0.6, 0.5)]))
    assert max(abs(found)) == pytest.approx(0.853553390593, abs=1e-10)


def test_the_whole_recursion_is_that_of_robots_which_are_run_together():
    """By hand: what comes of each unit state of 6 robots after a period, without a target."""
    law, n, s = ThirdOrder(0.7, 0.6, 0.5), 6, 3
    step = linear_step(law, H)
    A = np.kron(step.own, np.eye(n)) + np.kron(step.received, D)
    gains = np.diag([0.7, 0.6, 0.5])
    F = np.array([[1, H, H**2 / 2], [0, 1, H], [0, 0, 1]])
    by_hand = np.kron(F @ (np.eye(s) - gains), np.eye(n)) + np.kron(F @ gains, D)
    np.testing.assert_allclose(A, by_hand, atol=1e-12)


def test_gains_of_one_forget_all_on_a_path_after_as_many_periods_as_it_has_robots():
    step = linear_step(ThirdOrder(1, 1, 1), H)
    path = np.eye(3, k=-1)
    A = np.kron(step.own, np.eye(3)) + np.kron(step.received, path)
    power = np.linalg.matrix_power(A, 2)
    assert abs(power).max() > 0.1
    assert abs(A @ power).max() < 1e-12


def test_what_no_robot_sees_is_left_out():
    @dataclass(frozen=True)
    class Counting(PIConsensus):
        kappa: float = 0.0

    found = linear_step(Counting(0.5, 0.5), H).modes(np.zeros(1, complex))
    same(found, [0.5, 0.5])


class Shifted(ThirdOrder):
    def receive(self, now, x, received):
        return super().receive(now, x.replace(velocity=x.velocity + 1e-3), received)


class Summing(ThirdOrder):
    def receive(self, now, x, received):  # noqa: ARG002
        pull = received.sum(received.difference("position", x.position))
        return x.replace(position=x.position + 0.1 * pull)


class Fading(ThirdOrder):
    def receive(self, now, x, received):
        return x.replace(
            position=x.position + received.disagreement("position", x.position) / now.k
        )


class Saturating(ThirdOrder):
    def receive(self, now, x, received):  # noqa: ARG002
        return x.replace(position=x.position + np.clip(
            received.disagreement("position", x.position), -1e3, 1e3))  # fmt: skip


class Noisy(ThirdOrder):
    def receive(self, now, x, received):  # noqa: ARG002
        return x.replace(position=x.position + now.uniform("noise", x.position.shape[1]))


class Crossing(ThirdOrder):
    def receive(self, now, x, received):  # noqa: ARG002
        return x.replace(position=np.roll(x.position, 1, axis=1))


class Planar(ThirdOrder):
    def receive(self, now, x, received):  # noqa: ARG002
        return x.replace(position=x.position @ np.eye(2))


class Trimming(ThirdOrder):
    def receive(self, now, x, received):  # noqa: ARG002
        difference = received.difference("position", x.position)
        return x.replace(position=x.position + received.maximum(difference))


OTHERS: list[Any] = [Shifted, Summing, Fading, Saturating, Noisy, Crossing, Planar, Trimming]


@pytest.mark.parametrize("kind", OTHERS, ids=lambda kind: kind.__name__)
def test_of_what_is_not_of_that_form_nothing_is_said(kind):
    assert linear_step(kind(0.7, 0.6, 0.5), H) is None


def test_of_what_is_not_linear_or_measures_nothing_is_said():
    assert linear_step(Sliding(0.3, 0.3), H) is None
    assert linear_step(KalmanConsensus(1.0, 0.01), H) is None


def test_what_it_is_given_are_values_of_one_robot():
    seen = []

    class Looking(ThirdOrder):
        def receive(self, now, x, received):
            seen.append((type(x), x.position.shape[0], len(received.row), now.robots.tolist()))
            return super().receive(now, x, received)

    linear_step(Looking(0.7, 0.6, 0.5), H)
    assert {one[:2] for one in seen} == {(Values, 1)}
    assert {one[2] for one in seen} == {1, 3}


TOPOLOGY = Topology.of(*PAPER)


def still(step):
    """Return the recursion over links that are not late."""
    return LateStep(step, TOPOLOGY, np.zeros(len(TOPOLOGY.source), np.int64))


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_of_those_that_only_jump_the_steady_state_is_that_of_their_recursion(law):
    found = still(linear_step(law, 0.1)).steady_motion(HARMONIC)
    expected = steady_motion(recursion_of(law, TOPOLOGY, 0.1), HARMONIC, 0.9)
    np.testing.assert_allclose(found.at(7), expected.at(7), rtol=1e-9)
    assert found.bound.position == pytest.approx(expected.bound.position, rel=1e-9)


@pytest.mark.parametrize(
    "law",
    [PIConsensus(0.7, 1.0, 0.3), ThirdOrder(0.7, 0.6, 0.5)],
    ids=lambda law: type(law).__name__,
)
def test_the_steady_state_of_those_that_keep_more_is_where_agents_go(law):
    h, ticks = 0.1, 400
    rng = np.random.default_rng(3)
    start = {name: rng.normal(size=(6, 2)) for name in ("position", "velocity")}
    schedule = TopologySchedule.constant(TOPOLOGY)
    agents = agents_at(np.arange(1, 7), schedule, law, start)
    for k in range(1, ticks + 1):
        left = agents.left(h)
        position, velocity = target(k * h)
        acceleration = np.array([-np.sin(k * h), np.cos(k * h)])
        sent = {"position": position, "velocity": velocity, "acceleration": acceleration}
        meet([agents], k, h, {name: sent[name] for name in law.SENT})
    errors = np.array([left.position - position, left.velocity - velocity])
    motion = still(linear_step(law, h)).steady_motion(HARMONIC)
    np.testing.assert_allclose(motion.at(ticks)[:2], errors, atol=1e-9)


def test_a_target_that_sends_what_no_agent_does_has_no_steady_state_here():
    class Odd(ThirdOrder):
        def send(self, now, x):  # noqa: ARG002
            sent = Values({**x, "acceleration": 2 * x.acceleration})
            return x, sent, None

    step = linear_step(Odd(0.7, 0.6, 0.5), H)
    assert not step.agrees
    assert still(step).steady_motion(HARMONIC) is None


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_of_periods_in_a_list_the_factor_is_that_of_their_product(law):
    gaps = (0.1, 0.35, 0.2)
    expected = radius_bounds(law, SPECTRUM, Periods(gaps, 0.0))
    assert radius_of_list(law, SPECTRUM, gaps) == pytest.approx(expected.upper, rel=1e-9)
    assert np.isnan(radius_of_list(Sliding(1, 1), SPECTRUM, gaps))


def test_of_a_list_of_periods_each_step_is_of_its_own():
    law, gaps = PIConsensus(0.7, 1.0, 0.3), (0.1, 0.35)
    product = np.eye(18)
    for h in gaps:
        step = linear_step(law, h)
        product = (np.kron(step.own, np.eye(6)) + np.kron(step.received, D)) @ product
    radius = max(abs(np.linalg.eigvals(product))) ** (1 / len(gaps))
    assert radius_of_list(law, SPECTRUM, gaps) == pytest.approx(radius, rel=1e-6)


def test_modes_that_its_code_has_not_are_the_algorithm_s_error():
    class Sunny(ThirdOrder):
        def modes(self, spectrum, h):
            return super().modes(spectrum, h) / 2

    expect_modes(ThirdOrder(0.7, 0.6, 0.5), H)
    expect_modes(PIConsensus(0.7, 1.0, 0.3), H)
    with pytest.raises(
        AlgorithmError, match=r"modes of s = 0 at h = 0.4 s are .*, but its code has"
    ):
        expect_modes(Sunny(0.7, 0.6, 0.5), H)


def test_a_law_that_takes_the_age_of_samples_or_counts_them_is_known_to_do_so():
    class Ahead(FirstOrder):
        def receive(self, now, x, received):
            ahead = (received.age * now.h)[:, None] * received.samples.velocity
            return x.replace(
                position=x.position
                + self.alpha * received.mean(ahead + received.difference("position", x.position))
            )

    class Summing(FirstOrder):
        def receive(self, now, x, received):  # noqa: ARG002
            pull = received.sum(received.weight * received.difference("position", x.position))
            return x.replace(position=x.position + self.alpha * pull)

    found = [linear_step(law(0.7, 0.6), H) for law in (FirstOrder, Ahead, Summing)]
    assert [step.ageless for step in found] == [True, False, True]
    assert [step.alone is None for step in found] == [False, False, True]
    np.testing.assert_allclose(found[0].alone, [[1, H], [0, 1]], atol=1e-12)
