"""μ, ϱ and δ of Theorems 2 and 3, and inequality (1.9), against sums written by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nrs_cosim.estimator_agents.theory.design import design
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.estimator_agents.theory.tracking import (
    Drive,
    balls,
    constants,
    push,
    worst_tracking,
)
from nrs_cosim.estimator_agents.theory.tracking_bounds import Loop, tracking_ball
from nrs_cosim.plant_fmu.bundled.bounds import bounds_of
from tests.plant_fmu.test_bounds import two_link

P3 = bounds_of("two_link_arm", {}, 2)
LAMBDA_D, GAMMA_1, GAMMA_2 = 2 * np.sqrt(2), 3.0, 1.0
OF = constants(P3, 2, LAMBDA_D, GAMMA_1, GAMMA_2)
DRIVE = Drive.of(200 * np.eye(2), 300 * np.eye(2))
LOOP = Loop(P3, np.eye(2), np.eye(2), (2.0, 2.0), (GAMMA_1, GAMMA_2), GAMMA_1 * 2**0.5, 2**0.5)


def test_constants_of_the_example_agree_with_hand_calculation():
    assert OF.mu_1 == pytest.approx(
        LAMBDA_D + P3.lambda_M * 2**0.5 + P3.lambda_c * 18 + P3.lambda_g, rel=1e-12
    )
    assert OF.mu_2 == OF.rho_1 == pytest.approx(P3.lambda_c * 3 * 2**0.5, rel=1e-12)
    assert OF.rho_2 == pytest.approx(2 * OF.mu_2 + P3.lambda_M + 2**0.5 * P3.lambda_c, rel=1e-12)


def test_inequality_1_9_holds_at_random_states():
    rng = np.random.default_rng(9)
    for _ in range(2000):
        q, qd = rng.uniform(-np.pi, np.pi, 2), rng.normal(scale=5, size=2)
        t = rng.uniform(0, 100)
        ups, a = np.array([2 + np.cos(t), -2 + np.sin(t)]), np.array([-np.sin(t), np.cos(t)])
        M, C, G = two_link(q, qd)
        eps_bar, ups_bar = rng.normal(size=(2, 2))
        phi = 2 * np.array([np.sin(t), np.cos(2 * t)]) - M @ a - C @ ups - G
        phi += 200 * eps_bar + 300 * ups_bar
        mu_3 = 200 * np.linalg.norm(eps_bar) + 300 * np.linalg.norm(ups_bar)
        most = OF.mu_1 + OF.mu_2 * np.linalg.norm(qd - ups) + mu_3
        assert np.linalg.norm(phi) <= most


def test_theorem_2_gives_the_balls_and_gains_of_the_paper():
    found = balls(OF, DRIVE, EstimateBounds(0.1, 0.2))
    rho_3 = OF.mu_1 + 2**0.5 * (200 * 0.1 + 300 * 0.2)
    assert push(OF, DRIVE, EstimateBounds(0.1, 0.2)) == pytest.approx(rho_3)
    assert found.position == pytest.approx(rho_3 / (200 - OF.rho_1))
    assert found.velocity == pytest.approx(rho_3 / (300 - OF.rho_2))
    for kp, kd in ((0.99 * 2 * P3.lambda_M, 300), (200, 0.99 * OF.rho_2)):
        weak = Drive.of(kp * np.eye(2), kd * np.eye(2))
        assert not all(c.holds for c in OF.conditions(weak))
        assert balls(OF, weak, EstimateBounds(0.1, 0.2)) is None


def test_the_worst_of_robots_is_the_largest_and_none_if_one_has_none():
    pairs = [EstimateBounds(1.0, 4.0), EstimateBounds(2.0, 3.0)]
    assert worst_tracking(pairs) == EstimateBounds(2.0, 4.0)
    assert worst_tracking([*pairs, None]) is None


def known(bound, made=None):
    """Return estimates within a bound, and loops that make no more of them."""
    return None if bound is None else (bound, lambda _: made or bound)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_a_designed_period_keeps_the_bound_and_a_tenth_more_does_not(share):
    """With bounds on the estimates that are h and 2 h, on both sides of the third of (6.1)."""
    wanted = EstimateBounds(0.7, 0.9)
    found = design([(OF, LOOP)], wanted, share, lambda h: EstimateBounds(h, 2 * h), lambda _: None)
    paper = found.paper
    drive = Drive(paper.kp, paper.kp, paper.kd, paper.kd)
    kept = balls(OF, drive, EstimateBounds(paper.period, 2 * paper.period))
    assert kept.position <= wanted.position * (1 + 1e-6)
    assert kept.velocity <= wanted.velocity * (1 + 1e-6)
    room = OF.mu_1 * (1 - share) / (share * 2**0.5)
    longer = 1.1 * paper.period
    assert paper.kp * paper.period + paper.kd * 2 * paper.period <= room
    assert paper.kp * longer + paper.kd * 2 * longer > room
    assert found.proven.period is None
    assert (found.proven.status, found.proven.bounds_from) == ("no bounds", None)


@pytest.mark.parametrize(
    ("known_from", "status"), [(0, "no period is short enough"), (0.5e-3, "not computed")]
)
def test_no_period_is_called_short_enough_only_if_short_ones_have_bounds(known_from, status):
    """With bounds that stay as large at any period, and of short ones are known or not."""

    def of(h, bound):
        return bound if h >= known_from else None

    found = design(
        [(OF, LOOP)],
        EstimateBounds(0.7, 0.9),
        0.5,
        lambda h: of(h, EstimateBounds(10, 10)),
        lambda h: known(of(h, EstimateBounds(10, 10))),
    )
    for gains in (found.paper, found.proven):
        assert (gains.period, gains.status) == (None, status)
        assert gains.bounds_from == pytest.approx((known_from and 1e-3) or 1e-9)
    near = design(
        [(OF, LOOP)],
        EstimateBounds(0.7, 0.9),
        0.5,
        lambda h: EstimateBounds(h, h) if h >= 1e-6 else None,
        lambda h: known(EstimateBounds(h, h) if h >= 1e-6 else None),
    )
    assert near.paper.status == near.proven.status == "found"


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
@pytest.mark.parametrize(
    "wanted", [EstimateBounds(0.7, 0.9), EstimateBounds(0.001, 100.0), EstimateBounds(5.0, 0.01)]
)
def test_a_design_is_within_the_proven_balls_and_a_longer_period_is_not(wanted, share):
    found = design(
        [(OF, LOOP)], wanted, share, lambda _: None, lambda h: known(EstimateBounds(h, 2 * h))
    ).proven

    def keeps(h):
        loop = replace(LOOP, kp=found.kp * np.eye(2), kd=found.kd * np.eye(2))
        ball = tracking_ball(loop, *known(EstimateBounds(h, 2 * h)))
        return ball.position <= wanted.position and ball.velocity <= wanted.velocity

    assert keeps(found.period)
    assert not keeps(1.1 * found.period)


def test_a_design_for_different_robots_keeps_the_bound_of_each():
    wanted, other = EstimateBounds(0.2, 0.9), replace(LOOP, lambda_d=(9.0, 0.0))
    found = design(
        [(OF, LOOP), (OF, other)],
        wanted,
        0.5,
        lambda _: None,
        lambda h: known(EstimateBounds(h, h)),
    ).proven
    for robot in (LOOP, other):
        loop = replace(robot, kp=found.kp * np.eye(2), kd=found.kd * np.eye(2))
        ball = tracking_ball(loop, *known(EstimateBounds(found.period, found.period)))
        assert ball.position <= wanted.position
        assert ball.velocity <= wanted.velocity


# With friction, which no robot of the examples has


def test_constants_with_friction_agree_with_hand_calculation():
    """Four joints, so that √m = 2: a speed of 10 and a pull of 4."""
    p3 = SimpleNamespace(lambda_m=0.5, lambda_M=3.0, lambda_c=0.25, lambda_g=7.0, lambda_f=1.5)
    of = constants(p3, 4, 11.0, 5.0, 2.0)
    assert (of.m, of.lambda_m, of.lambda_M) == (4, 0.5, 3.0)
    assert of.mu_1 == pytest.approx(11 + 3 * 4 + 0.25 * 100 + 7 + 1.5 * 10)
    assert of.mu_2 == pytest.approx(0.25 * 10)
    assert of.rho_1 == pytest.approx(2.5 + 1.5 / 2)
    assert of.rho_2 == pytest.approx(2 * 2.5 + 3 + 2 * 0.25 + 1.5 / 2)


def test_friction_alone_reaches_the_limit_of_inequality_1_9():
    """F = λ_f I, and the target is as fast as it may be on each axis: ‖F υ_0‖₂ is μ1."""
    p3 = SimpleNamespace(lambda_m=1.0, lambda_M=0.0, lambda_c=0.0, lambda_g=0.0, lambda_f=0.7)
    of = constants(p3, 3, 0.0, 2.0, 1.0)
    assert of.mu_1 == pytest.approx(np.linalg.norm(0.7 * np.eye(3) @ [2.0, -2.0, 2.0]))
    rng = np.random.default_rng(19)
    for _ in range(200):
        friction = np.linalg.qr(rng.normal(size=(3, 3)))[0] * 0.7
        assert np.linalg.norm(friction @ rng.uniform(-2, 2, 3)) <= of.mu_1


def test_the_eigenvalues_of_gains_are_those_of_their_symmetric_parts_and_of_their_norms():
    kp, kd = np.array([[5.0, 1.0], [-1.0, 3.0]]), np.array([[2.0, 4.0], [0.0, 7.0]])
    drive = Drive.of(kp, kd)
    assert drive.kp_min == pytest.approx(3.0)
    assert drive.kd_min == pytest.approx(4.5 - np.hypot(2.5, 2.0))
    for most, K in ((drive.kp_max, kp), (drive.kd_max, kd)):
        assert most == pytest.approx(np.sqrt(np.linalg.eigvalsh(K.T @ K).max()))
