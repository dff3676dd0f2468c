"""What is proven of tracking, against the worst of linear plants, and searched targets of arms."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.theory.design import design
from nrs_cosim.estimator_agents.theory.estimates import (
    EstimateBounds,
    worst_case,
    worst_case_always,
)
from nrs_cosim.estimator_agents.theory.linear_loop import norm_1
from nrs_cosim.estimator_agents.theory.recursion import recursion_of
from nrs_cosim.estimator_agents.theory.reference_filter import filtered
from nrs_cosim.estimator_agents.theory.spectrum import spectral_radius, spectrum_of
from nrs_cosim.estimator_agents.theory.tracking import constants
from nrs_cosim.estimator_agents.theory.tracking_bounds import Loop, tracking_ball
from nrs_cosim.estimator_agents.waves import norm_supremum
from nrs_cosim.plant_fmu.bundled.bounds import bounds_of
from tests.bus.test_topology import PAPER
from tests.cases import cases
from tests.estimator_agents.test_worst_case import drawn
from tests.plant_fmu.test_bounds import two_link

PARTS = 6


def exact(recursion, robot, mass, kp, kd, gamma_2, lambda_d):
    """Return the worst |e| and |ė| of a robot on an axis, by what each part of the past adds.

    a_0 and τ_d are constant in parts of a period, which is some of what they may be.
    """
    n, step = recursion.n, recursion.h / PARTS
    size = 2 * n + 2
    flow = np.zeros((size, size))
    flow[:n, n : 2 * n] = np.eye(n)
    flow[-2, -1] = 1
    flow[-1, -2:] = -kp / mass, -kd / mass
    flow[-1, robot], flow[-1, n + robot] = kp / mass, kd / mass
    given = np.zeros((size, 2))
    given[n : 2 * n, 0] = given[-1, 0] = -1
    given[-1, 1] = 1 / mass
    moved = expm(np.block([[flow, given], [np.zeros((2, size + 2))]]) * step)
    A, B = moved[:size, :size], moved[:size, size:]
    jump = np.eye(size)
    jump[: 2 * n, : 2 * n] = recursion.jump
    rows, sums = np.eye(size)[-2:], np.zeros((2, 2))
    for part in range(200 * PARTS):
        sums += np.abs(rows @ B)
        rows = rows @ A
        if not (part + 1) % PARTS:
            rows = rows @ jump
        if np.abs(rows).max() < 1e-6:
            break
    return sums @ [gamma_2, lambda_d]


def ball(recursion, rho, loop):
    before = worst_case(recursion, *loop.gammas, rho)
    always = worst_case_always(recursion, *loop.gammas, rho, before)
    return tracking_ball(loop, always, lambda c: filtered(recursion, loop.gammas, always, c))


@pytest.mark.parametrize("seed", range(cases(6, 3)))
def test_linear_robots_come_no_farther_than_proven_and_to_a_third_of_it(seed):
    rng = np.random.default_rng(seed)
    ratios = []
    for case in range(50):
        recursion, rho, _, gamma_2 = drawn(rng, case % 2)
        mass, kp, kd, lambda_d = 10 ** rng.uniform([-1, 0, 0, -1], [1, 2.5, 2.5, 1])
        p3 = SimpleNamespace(lambda_m=mass, lambda_M=mass, lambda_c=0, lambda_g=0, lambda_f=0)
        loop = Loop(p3, kp * np.eye(1), kd * np.eye(1), (lambda_d,), (1e6, gamma_2), 1e6, gamma_2)
        found = ball(recursion, rho, loop)
        worst = np.max(
            [exact(recursion, i, mass, kp, kd, gamma_2, lambda_d) for i in range(recursion.n)], 0
        )
        assert worst[0] <= found.position * (1 + 1e-6)
        assert worst[1] <= found.velocity * (1 + 1e-6)
        ratios.append((found.position / worst[0], found.velocity / worst[1]))
    assert np.all(np.quantile(ratios, 0.5, axis=0) < 1.3)
    assert np.all(np.quantile(ratios, 0.75, axis=0) < 3)


@pytest.mark.parametrize("seed", range(3))
def test_norms_of_two_exponentials_are_their_integrals(seed):
    rng = np.random.default_rng(seed)
    for _ in range(100):
        real = -(10 ** rng.uniform(-1, 1, 2))
        if rng.random() < 0.5:
            poles = np.array([complex(real[0], 5 * real[1]), complex(real[0], -5 * real[1])])
            weights = rng.normal(size=2) @ [1, 1j] * np.ones(2)
            weights[1] = weights[0].conj()
            t = np.linspace(0, 40 / -real[0], 200_001)
        else:
            poles, weights = real.astype(complex), rng.normal(size=2).astype(complex)
            t = np.concatenate([[0], np.geomspace(1e-7, 40 / -real.max(), 50_001)])
        f = (weights[:, None] * np.exp(poles[:, None] * t)).sum(axis=0).real
        assert norm_1(weights, poles) == pytest.approx(np.trapezoid(np.abs(f), t), rel=2e-3)


def test_the_norm_of_a_target_on_a_circle_is_that_of_one_axis():
    omega, z = np.array([1.0, 2.0]), np.array([[1.0, 1j], [0.0, 0.0]])
    assert norm_supremum(np.zeros(2), omega, z) == pytest.approx(1)
    assert norm_supremum(np.array([2.0, -2.0]), omega, z) == pytest.approx(1 + 8**0.5)
    rng, t = np.random.default_rng(0), np.linspace(0, 2 * np.pi, 20_001)
    for _ in range(50):
        m, c = int(rng.integers(1, 4)), rng.normal(size=3)
        z = rng.normal(size=(2, m)) + 1j * rng.normal(size=(2, m))
        wave = (z[:, None] * np.exp(1j * omega[:, None, None] * t[:, None])).imag.sum(axis=0)
        most = np.linalg.norm(wave + c[:m], axis=1).max()
        assert norm_supremum(c[:m], omega, z) == pytest.approx(most, rel=1e-6)


# Arms


def accelerations(q, qd, torque):
    """Return q̈, (c, 2), of many two-link arms, from the matrices of one at two postures."""
    (bent, _, _), (straight, _, level) = (
        two_link(np.array([0.0, angle]), np.zeros(2)) for angle in (np.pi / 2, 0.0)
    )
    apart = straight[0, 1] - bent[0, 1]
    c, s = np.cos(q[:, 1]), np.sin(q[:, 1])
    near, far, beside = bent[0, 0] + 2 * apart * c, bent[1, 1], bent[0, 1] + apart * c
    second = level[1] * np.cos(q.sum(axis=1))
    first = (level[0] - level[1]) * np.cos(q[:, 0]) + second
    left = torque[:, 0] + apart * s * (2 * qd[:, 0] + qd[:, 1]) * qd[:, 1] - first
    right = torque[:, 1] - apart * s * qd[:, 0] ** 2 - second
    total = near * far - beside**2
    return np.stack([far * left - beside * right, near * right - beside * left], 1) / total[:, None]


def test_arms_are_two_link_arms():
    rng = np.random.default_rng(2)
    for _ in range(20):
        q, qd, torque = rng.uniform(-3, 3, (3, 2))
        M, C, G = two_link(q, qd)
        ours = accelerations(q[None], qd[None], torque[None])[0]
        np.testing.assert_allclose(ours, np.linalg.solve(M, torque - C @ qd - G), atol=1e-12)


def searched(recursion, kp, kd, seed, gammas, swing=2.0, parts=20, ticks=200):
    """Return the largest ‖e‖₂ and ‖ė‖₂ of robot 2's arms behind targets that turn now and then."""
    rng, count, h = np.random.default_rng(seed), 60, recursion.h
    n, step = recursion.n, h / parts
    period = rng.uniform(1, 4 * gammas[0] / gammas[1], (count, 2))
    period[:30], phase = 4 * gammas[0] / gammas[1], rng.random((count, 2))
    late = rng.uniform(0, 10, (count, 2))
    speed = np.where(phase < 0.5, 4 * phase - 1, 3 - 4 * phase) * gammas[1] * period / 4
    speed += (gammas[0] - gammas[1] * period / 4) * rng.choice([-1, 1], (count, 2))
    place = rng.uniform(-3, 3, (count, 2))
    q, qd, x, most = place, speed, np.zeros((2, n, count, 2)), np.zeros(2)

    def motion(q, qd, push, at, rate):
        return accelerations(q, qd, push - (q - at) @ kp - (qd - rate) @ kd)

    for k in range(ticks):
        x = (recursion.jump @ x.reshape(2 * n, -1)).reshape(x.shape)
        estimates, velocities = place + x[0], speed + x[1]
        at, rate = estimates[1], velocities[1]
        for part in range(parts):
            t = k * h + part * step
            pull = gammas[1] * np.sign(np.sin(2 * np.pi * (t / period + phase)))
            push = swing * np.sign(np.sin(t + late))
            half, then = at + step / 2 * rate, at + step * rate
            a = motion(q, qd, push, at, rate)
            b = motion(q + step / 2 * qd, qd + step / 2 * a, push, half, rate)
            c = motion(q + step / 2 * qd + step**2 / 4 * a, qd + step / 2 * b, push, half, rate)
            d = motion(q + step * qd + step**2 / 2 * b, qd + step * c, push, then, rate)
            q = q + step * qd + step**2 / 6 * (a + b + c)
            qd = qd + step / 6 * (a + 2 * b + 2 * c + d)
            place = place + step * speed + step**2 / 2 * pull
            speed, at = speed + step * pull, then
            if k > 100:
                errors = (np.linalg.norm(q - place, axis=1), np.linalg.norm(qd - speed, axis=1))
                most = np.maximum(most, np.max(errors, axis=1))
        x = np.stack([estimates + h * velocities - place, velocities - speed])
    return most


@pytest.mark.parametrize(
    ("kp", "kd", "near"),
    [
        (200 * np.eye(2), 300 * np.eye(2), 3),
        ([[200, 10], [10, 200]], [[300, -20], [-20, 300]], 5),
    ],
)
def test_arms_come_no_farther_than_proven_and_to_a_part_of_it(kp, kd, near):
    kp, kd, topology = np.array(kp, float), np.array(kd, float), Topology.of(*PAPER)
    algorithm, gammas, root = FirstOrder(0.9, 1.1), (3.0, 1.0), 2**0.5
    recursion = recursion_of(algorithm, topology, 0.1)
    rho = spectral_radius(algorithm.modes(spectrum_of(topology), 0.1))
    p3 = bounds_of("two_link_arm", {}, 2)
    loop = Loop(p3, kp, kd, (2.0, 2.0), gammas, root * gammas[0], root * gammas[1])
    found, most = ball(recursion, rho, loop), searched(recursion, kp, kd, 1, gammas)
    assert found.position / near <= most[0] <= found.position
    assert found.velocity / near <= most[1] <= found.velocity


def test_a_ball_is_proven_where_theorems_2_and_3_want_larger_gains_and_not_below_mu_2():
    p3 = bounds_of("two_link_arm", {}, 2)
    always = EstimateBounds(0.1, 0.1)

    def found(kd):
        loop = Loop(p3, 5 * np.eye(2), kd * np.eye(2), (0.0, 0.0), (3.0, 1.0), 4.0, 1.0)
        return tracking_ball(loop, always, lambda c: filtered(None, (3.0, 1.0), always, c))

    assert found(1.01 * p3.lambda_c * 4.0) is not None
    assert found(0.99 * p3.lambda_c * 4.0) is None


def designed_linear(rng):
    """Return what a design promises of a linear robot, and the worst that it comes to."""
    gamma_2, lambda_d, mass = 10 ** rng.uniform([-1, -1, -1], [0, 1, 1])
    wanted = EstimateBounds(*10 ** rng.uniform(-2, 0, 2))
    p3 = SimpleNamespace(lambda_m=mass, lambda_M=mass, lambda_c=0, lambda_g=0, lambda_f=0)
    gammas, one = (1e6, gamma_2), np.eye(1)
    loop = Loop(p3, one, one, (lambda_d,), gammas, 1e6, gamma_2)
    algorithm, topology = FirstOrder(*rng.uniform(0.7, 1, 2)), Topology.of([[0, 0], [1, 0]], [1, 0])
    of = constants(p3, 1, lambda_d, 1.0, gamma_2)

    def known(h):
        recursion = recursion_of(algorithm, topology, h)
        rho = spectral_radius(algorithm.modes(spectrum_of(topology), h))
        always = worst_case_always(recursion, *gammas, rho)
        return always, lambda rate: filtered(recursion, gammas, always, rate)

    found = design([(of, loop)], wanted, 0.5, lambda _: None, known).proven
    recursion = recursion_of(algorithm, topology, found.period)
    gains = mass, found.kp, found.kd
    each = [exact(recursion, robot, *gains, gamma_2, lambda_d) for robot in range(2)]
    return wanted, np.max(each, axis=0)


def test_linear_robots_of_designs_keep_the_accuracy():
    rng = np.random.default_rng(8)
    for _ in range(6):
        wanted, worst = designed_linear(rng)
        assert worst[0] <= wanted.position * (1 + 1e-6)
        assert worst[1] <= wanted.velocity * (1 + 1e-6)
