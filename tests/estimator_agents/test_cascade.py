"""How far linear robots come from the target, against inputs that were searched for in the past."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import sparse
from scipy.linalg import expm
from scipy.optimize import linprog

from nrs_cosim.estimator_agents.theory.cascade import cascade_ball
from nrs_cosim.estimator_agents.theory.loop_motion import LoopMotion
from nrs_cosim.estimator_agents.theory.spectrum import spectrum_of
from nrs_cosim.estimator_agents.theory.step_responses import steps_of, steps_of_late
from nrs_cosim.estimator_agents.theory.tracking_bounds import Loop
from tests.cases import cases
from tests.estimator_agents.test_target_response import FUZZ, followed, late_steps
from tests.estimator_agents.test_worst_case import drawn


def kernels(recursion, robot, loop, axis, parts=12, past=1200):
    """Return what accelerations of a target in parts of the past, and τ_d, make of e and ė.

    (c, 2 m, J, 2) at c times within a period, the newest part first; and the parts' widths, (c, J),
    and what a target that always moved at 1 makes of them, (c, 2 m). So many parts are of half a
    period, the shortest right after it begins and before it ends; and so many periods are past.
    """
    m, n, h, mass = loop.m, recursion.n, recursion.h, loop.p3.lambda_M
    size = 2 * n + 2 * m + 1
    e, rate = slice(2 * n, 2 * n + m), slice(2 * n + m, size - 1)
    F, B = np.zeros((size, size)), np.zeros((size, 2))
    F[:n, n : 2 * n], F[e, rate] = np.eye(n), np.eye(m)
    F[rate, e], F[rate, rate] = -loop.kp / mass, -(loop.kd + loop.p3.lambda_f * np.eye(m)) / mass
    F[rate, robot], F[rate, n + robot] = loop.kp[:, axis] / mass, loop.kd[:, axis] / mass
    F[2 * n + m + axis, -1] = -loop.p3.lambda_f / mass
    B[n : 2 * n, 0] = B[2 * n + m + axis, 0] = -1
    B[-1, 0], B[2 * n + m + axis, 1] = 1, 1 / mass
    J = np.eye(size)
    J[: 2 * n, : 2 * n] = recursion.jump
    J[: 2 * n, -1] = np.repeat((recursion.keep - np.eye(2))[:, 1], n)
    half = np.diff(np.append(0, np.geomspace(h / 200, h / 2, parts)))
    widths = np.concatenate([half, half[::-1]])
    whole = np.block([[F, B], [np.zeros((2, size + 2))]])
    moved = expm(whole * widths[:, None, None])
    A, b = moved[:, :size, :size], moved[:, :size, size:]
    at = [J]
    given = [np.zeros((size, 0, 2))]
    for part in range(len(widths)):
        at.append(A[part] @ at[-1])
        before = np.tensordot(A[part], given[-1], axes=1)
        given.append(np.concatenate([b[part][:, None], before], axis=1))
    rows, found = np.eye(size)[2 * n : -1], []
    seen = range(0, len(widths) + 1, 3)
    begin = np.array([rows @ at[c] for c in seen])
    later, turn = [], begin
    for _ in range(past):
        later.append(np.tensordot(turn, given[-1], axes=1))
        turn = turn @ at[-1]
        if np.abs(turn[..., :-1]).max() < 1e-6 * np.abs(begin[..., :-1]).max():
            break
    past, old = np.concatenate(later, axis=2), np.tile(widths[::-1], len(later))
    for place, c in enumerate(seen):
        own = np.tensordot(rows, given[c], axes=1)
        found.append((np.concatenate([own, past[place]], 1), np.append(widths[:c][::-1], old)))
    return found, turn[..., -1]


def reached(recursion, robot, loop):
    """Return the largest ‖e‖₂ and ‖ė‖₂ that were found, where γ1 does not bind."""
    m, best = loop.m, np.zeros(2)
    by_axis = [kernels(recursion, robot, loop, axis)[0] for axis in range(m)]
    most = np.stack([np.full(m, loop.gammas[1]), loop.lambda_d])
    directions = np.concatenate([np.ones((1, m)), np.eye(m), np.linalg.eigh(loop.kp)[1].T])
    for at in zip(*by_axis, strict=True):
        J = max(one.shape[1] for one, _ in at)
        kernel = np.array([np.pad(one, ((0, 0), (0, J - one.shape[1]), (0, 0))) for one, _ in at])
        for half in range(2):
            part, c = kernel[:, half * m : (half + 1) * m], directions
            for _ in range(3):
                sign = np.sign(np.einsum("cr,arJu->caJu", c, part))
                errors = np.einsum("caJu,arJu,ua->cr", sign, part, most, optimize=True)
                c = errors / np.linalg.norm(errors, axis=1, keepdims=True)
            best[half] = max(best[half], np.linalg.norm(errors, axis=1).max())
    return best


def definite(rng, m, size):
    turned = np.linalg.qr(rng.normal(size=(m, m)))[0]
    K = turned @ np.diag(size * 10 ** rng.uniform(-0.7, 0.7, m)) @ turned.T
    return (K + K.T) / 2


def random_loop(rng, m, gamma_1, gamma_2, drag, coupled):
    mass, kp, kd = 10 ** rng.uniform([-1, 0, 0], [1, 2.5, 2.5])
    p3 = SimpleNamespace(lambda_m=mass, lambda_M=mass, lambda_c=0, lambda_g=0, lambda_f=drag)
    gains = [definite(rng, m, K) if coupled else K * np.eye(m) for K in (kp, kd)]
    lambda_d, root = tuple(10 ** rng.uniform(-1, 1, m)), m**0.5
    return Loop(p3, *gains, lambda_d, (gamma_1, gamma_2), root * gamma_1, root * gamma_2)


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("seed", range(cases(30, 1)))
def test_robots_come_no_farther_than_proven_and_near_to_it(seed, coupled):
    rng, ratios = np.random.default_rng([seed, coupled]), []
    for case in range(5):
        recursion, _, _, gamma_2 = drawn(rng, case % 2)
        loop = random_loop(rng, 1 + case % 3, 1e6, gamma_2, 0.0, coupled)
        found = cascade_ball(loop, steps_of(recursion), np.arange(recursion.n))
        most = np.max([reached(recursion, i, loop) for i in range(recursion.n)], axis=0)
        ratios.append([found.position / most[0], found.velocity / most[1]])
    assert np.min(ratios) >= 1 - 1e-6
    assert np.max(ratios) < 3
    assert np.median(ratios) < 1.2


def programme(kernel, widths, steady, gamma_1, gamma_2):
    """Return the most of kernel · a_0 over |a_0| ≤ γ2 where |υ_0| ≤ γ1 at the ends of parts."""
    J, steps = len(kernel), gamma_2 * widths
    change = sparse.diags_array([np.ones(J), -np.ones(J)], offsets=[0, 1], shape=(J, J + 1))
    cost = change.T @ (kernel / widths)
    cost[-1] += steady
    scale = np.abs(cost).max()
    found = linprog(
        -cost / scale,
        A_ub=sparse.vstack([change, -change]) / gamma_1,
        b_ub=np.tile(steps, 2) / gamma_1,
        bounds=(-gamma_1, gamma_1),
        method="highs",
    )
    return -found.fun * scale


@pytest.mark.parametrize("seed", range(cases(60, 3)))
def test_targets_whose_velocity_is_bounded_come_near_what_is_proven(seed):
    rng = np.random.default_rng([7, seed])
    recursion, _, gamma_1, gamma_2 = drawn(rng, seed)
    drag = rng.choice([0.0, 10 ** rng.uniform(-1, 1)])
    loop = random_loop(rng, 1, gamma_1, gamma_2, drag, coupled=False)
    found = cascade_ball(loop, steps_of(recursion), np.arange(recursion.n))
    most, torque = np.zeros(2), np.zeros(2)
    for robot in range(recursion.n):
        at, steady = kernels(recursion, robot, loop, 0, parts=4, past=100)
        for place in (0, len(at) // 2, len(at) - 1):
            kernel, widths = at[place]
            torque = np.maximum(torque, np.abs(kernel[..., 1]).sum(axis=1) * loop.lambda_d[0])
            for half in range(2):
                some = kernel[half, :, 0], widths, steady[place, half], gamma_1, gamma_2
                most[half] = max(most[half], programme(*some))
    bounds = np.array([found.position, found.velocity])
    assert np.all(most + torque <= bounds * (1 + 1e-6))
    assert np.all(bounds <= 3 * (most + torque))


def late_reached(late, gains, gamma_1, gamma_2, ticks=200, parts=3):
    """Return what |e| and |ė| of a robot come to, by pulses of acceleration in a period."""
    h, (mass, kp, kd) = late.step.h, gains
    width, t = h / parts, (np.arange(ticks) * h)[:, None]
    moved = np.maximum(t - h - width * (np.arange(parts) + 0.5), 0) * (t > h)
    z = np.stack([moved, 1.0 * (t > h) + 0 * moved, 0 * moved]) * width
    x = followed(late, z)[0] + z[:2].swapaxes(0, 1)[:, :, None]
    after = np.einsum("ab,kbnr->kanr", [[1, -h], [0, 1]], x[1:])
    F = np.zeros((4, 4))
    F[0, 1], F[2, 3], F[3] = 1, 1, [kp / mass, kd / mass, -kp / mass, -kd / mass]
    whole, middle = expm(F * h), expm(F * h / 2)
    state, found = np.zeros((4, *x.shape[2:])), []
    for k, reference in enumerate(after):
        state[:2] = reference
        now = []
        for ago, turn in ((0, np.eye(4)), (h / 2, middle)):
            errors = np.tensordot(turn, state, axes=1)[2:] - z[:2, k, None]
            errors[0] -= ago * z[1, k]
            now.append(errors)
        found.append(now)
        state = np.tensordot(whole, state, axes=1)
    response = np.array(found)[2:]  # (k, at, 2, n, parts)
    robot = np.abs(response - response[-1]).sum(axis=(0, 1, 2, 4)).argmax()
    kernels = response[:, :, :, robot, ::-1]
    widths, most = np.full(kernels[:, 0, 0].size, width), np.zeros(2)
    for at, half in np.ndindex(2, 2):
        kernel = kernels[:, at, half]
        some = kernel.ravel(), widths, kernel[-1, 0] / width, gamma_1, gamma_2
        most[half] = max(most[half], programme(*some))
    return most


@settings(FUZZ, max_examples=cases(300, 8))
@given(late_steps(), st.integers(0, 1000))
def test_robots_over_late_links_and_of_agents_that_keep_more_come_no_farther(late, seed):
    radius = late.radius(spectrum_of(late.topology))
    assume(radius < 0.9)
    rng, gamma_1, gamma_2 = np.random.default_rng(seed), 4.0, 2.0
    mass, kp, kd = 10 ** rng.uniform([-1, 0, 0], [1, 2, 2])
    assume(kp / kd > 1)
    p3 = SimpleNamespace(lambda_m=mass, lambda_M=mass, lambda_c=0, lambda_g=0, lambda_f=0)
    loop = Loop(p3, kp * np.eye(1), kd * np.eye(1), (0.0,), (gamma_1, gamma_2), gamma_1, gamma_2)
    steps = steps_of_late(late, radius)
    assert (steps is None) == ("acceleration" in late.step.fields)
    assume(steps is not None)
    found = cascade_ball(loop, steps, np.arange(late.topology.n))
    most = late_reached(late, (mass, kp, kd), gamma_1, gamma_2)
    assert np.all(most <= np.array([found.position, found.velocity]) * (1 + 1e-6))
    assert np.all([found.position, found.velocity] <= 3 * most)


def test_integrals_of_motions_are_their_integrals():
    rng = np.random.default_rng(3)
    for m in (1, 1, 2, 3):
        kp, kd = definite(rng, m, 20.0), definite(rng, m, 10 ** rng.uniform(-0.5, 2))
        motion = LoopMotion.of(kp, kd, 2.0, 0.5)
        step = 1e-2 / np.abs(np.linalg.eigvals(motion.F)).max()
        turn, at, found = expm(motion.F * step), np.eye(2 * m), np.zeros((2 * m, 2 * m))
        while np.abs(at).max() > 1e-7:
            found, at = found + step * np.abs(at + turn @ at) / 2, turn @ at
        np.testing.assert_allclose(motion.pushed(), found, rtol=3e-3)
        times = np.array([0.0, step, 1.0])
        np.testing.assert_allclose(motion.at(times)[2], expm(motion.F), atol=1e-12)
