"""How far robots stay from the target, proven: T0 to T3 of docs/theory.md.

T0: V = ½ ėᵀMė + ½ eᵀKp e + ε [tᵀMė + (D − 1)/σ²], t = e/D, D² = 1 + σ² eᵀKd e, for some ε and σ: a
    ball for any symmetric gains with λ_min(Kd) > λ_c ‖υ_0‖₂.
T1: e = f + n, where f is what the loop makes of its reference without mass (`reference_filter`);
    of gains that are not diagonal, with one rate c, and (Kp − c Kd) g pushes n as well.
T2: M ë = … − Kd ė + Kd ḟ − Kp n: ‖ė‖₂ comes to the push over kd, times what M's spread costs.
T3: of ½ nᵀKd n + nᵀMė, n comes to what the robot itself is pushed by over kp.
From T0's ball on, T2 and T3 take turns: each makes what the other has no larger.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite, sqrt

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.estimator_agents.theory.linear_loop import linear_ball
from nrs_cosim.estimator_agents.theory.tracking import PlantConstants

Array = NDArray[np.float64]
Filtered = Callable[[float], EstimateBounds]
"""Returns the most of |f| and |ḟ| on an axis of a rate, per s."""

CROSS, WIDTH = np.geomspace(1e-4, 1e2, 25), np.geomspace(1e-3, 1e3, 25)
"""Of ε, in units of kp/kd, and of σ √kd."""
TURNS, STILL = 200, 1e-9
"""How often T2 and T3 are applied at most; and the relative change at which they end."""


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """A robot under PD control, what disturbs it, and what its target may do."""

    p3: PlantConstants
    kp: Array
    """(m, m), symmetric and positive definite, as kd."""
    kd: Array
    lambda_d: tuple[float, ...]
    """(m,) N m, of the disturbance on each axis."""
    gammas: tuple[float, float]
    """γ1 and γ2."""
    speed: float
    """sup ‖υ_0‖₂"""
    pull: float
    """sup ‖a_0‖₂"""

    @property
    def m(self) -> int:
        """The number of joints."""
        return len(self.kp)


def tracking_ball(loop: Loop, always: EstimateBounds, filtered: Filtered) -> EstimateBounds | None:
    """Return radii of balls into which e and ė come; None where none is proven.

    `always` is of the estimates, on each axis, at all times.
    """
    p3 = loop.p3
    kp, kd = (np.linalg.eigvalsh(K).astype(np.float64) for K in (loop.kp, loop.kd))
    if not (p3.lambda_m > 0 and kp[0] > 0 and 0 < kd[0] > p3.lambda_c * loop.speed):
        return None
    diagonal = all(np.array_equal(K, np.diag(np.diag(K))) for K in (loop.kp, loop.kd))
    rates: Array = np.diag(loop.kp) / np.diag(loop.kd)
    beside = 0.0
    if not diagonal:
        rates = np.full(loop.m, np.trace(loop.kp) / np.trace(loop.kd))
    each = [filtered(rate) for rate in rates]  # of NumPy, of whom none is too large to be squared
    positions = np.array([one.position for one in each])
    velocities = np.array([one.velocity for one in each])
    f, slow = float(np.linalg.norm(positions)), float(np.linalg.norm(velocities))
    pushed = float(np.linalg.norm(np.diag(loop.kd) * velocities)) if diagonal else kd[-1] * slow
    if not diagonal:
        uneven = np.linalg.norm(loop.kp - rates[0] * loop.kd, 2)
        beside = float(uneven * np.linalg.norm(positions + always.position))
    lambda_d = float(np.linalg.norm(loop.lambda_d))
    own = lambda_d + p3.lambda_M * loop.pull + p3.lambda_g
    swing = sum(
        most * min(float(np.linalg.norm(np.abs(K).sum(axis=1))), K_max * sqrt(loop.m))
        for K, K_max, most in (
            (loop.kp, kp[-1], always.position),
            (loop.kd, kd[-1], always.velocity),
        )
    )
    X, Y = _ball(loop, kp, kd, own + swing)
    if not (isfinite(X) and isfinite(Y)):
        return None
    spread = sqrt(p3.lambda_M / p3.lambda_m)
    weighed = spread * sqrt(kd[-1] / kd[0])
    oblique = (weighed + 1 / weighed) / 2
    half = np.linalg.cholesky(loop.kd)
    least = float(np.linalg.eigvalsh(np.linalg.solve(half, np.linalg.solve(half, loop.kp).T))[0])
    n = X + f
    for _ in range(TURNS):
        before = X, Y
        turning = p3.lambda_c * (Y + loop.speed)
        push = own + beside + turning * loop.speed + p3.lambda_f * (Y + loop.speed)
        given = push + kp[-1] * n + pushed
        Y = min(Y, spread * given / kd[0], oblique * (given + turning * Y) / kd[0])
        p = (push + turning * Y) / sqrt(kd[0])
        mixed = p3.lambda_M * Y
        zeta = (p + sqrt(p * p + 4 * least * mixed * (Y + slow))) / (2 * least)
        kinetic = mixed / sqrt(kd[0])
        zeta = kinetic + sqrt(kinetic * kinetic + zeta * zeta + 2 * kinetic * zeta)
        n = min(n, zeta / sqrt(kd[0]))
        X = min(X, f + n)
        if before[0] * (1 - STILL) <= X and before[1] * (1 - STILL) <= Y:
            break
    exact = linear_ball(loop, always, each)
    if exact is not None:
        X, Y = min(X, exact.position), min(Y, exact.velocity)
    return EstimateBounds(float(X), float(Y))


def _ball(loop: Loop, kp: Array, kd: Array, own: float) -> tuple[float, float]:
    """Return T0's radii, each the least over ε and σ; infinite where there is none."""
    p3, speed = loop.p3, loop.speed
    mu_2 = p3.lambda_c * speed
    push = own + (mu_2 + p3.lambda_f) * speed
    epsilon = (CROSS * kp[0] / kd[0])[:, None]
    sigma = (WIDTH / sqrt(kd[0]))[None, :]
    with np.errstate(all="ignore"):
        spread = sqrt(kd[-1] / kd[0]) * p3.lambda_M
        a = kd[0] - mu_2 - epsilon * (spread + p3.lambda_c / (sigma * sqrt(kd[0])))
        mixed = epsilon * (2 * mu_2 + p3.lambda_f)
        b = epsilon * kp[0] - mixed**2 / (2 * a)
        gained = push**2 / (2 * a)
        Y = (push + np.sqrt(push**2 + 2 * a * (epsilon * push) ** 2 / (4 * b))) / a
        # (b X − ε push) X ≥ gained D(X), and D(X) ≤ 1 + σ √kd X: the root of a parabola
        steep = epsilon * push + gained * sigma * sqrt(kd[-1])
        X = (steep + np.sqrt(steep**2 + 4 * b * gained)) / (2 * b)
        t = np.minimum(X, 1 / (sigma * sqrt(kd[0])))
        W = p3.lambda_M * Y * (Y / 2 + epsilon * t) + kp[-1] * X**2 / 2
        W += epsilon * np.minimum(kd[-1] * X**2 / 2, sqrt(kd[-1]) * X / sigma)
        stiff = kp[0] / 2 - epsilon**2 * p3.lambda_M
        holds = (a > 0) & (b > 0) & (stiff > 0)
        positions = np.where(holds, np.sqrt(W / stiff), np.inf)
        velocities = np.where(holds, 2 * np.sqrt(W / p3.lambda_m), np.inf)
    found = (np.where(np.isnan(one), np.inf, one).min() for one in (positions, velocities))
    X, Y = map(float, found)
    return X, Y
