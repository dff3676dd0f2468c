"""A robot of constant mass and viscous drag under diagonal PD gains (statement T4).

On each axis μ ë + (kd + d) ė + kp e = φ + kp ε̄ + kd ῡ, φ = τ_d − μ a_0 − d υ_0. With the impulse
response g of the left side, |e| is at most ‖g‖₁ times what is on the right, and comes to that; and
with f of `reference_filter`

    e = f + g ∗ (φ − d ḟ) − μ ġ ∗ ḟ,   ė = ġ ∗ φ + (kd ġ + kp g) ∗ ḟ,

which knows what of ε̄ and ῡ is one motion. Norms ‖·‖₁ are integrals of exponentials, exactly.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds

if TYPE_CHECKING:
    from nrs_cosim.estimator_agents.theory.tracking_bounds import Loop

Complex = NDArray[np.complex128]

APART = 1e-6
"""Relative: what two equal poles are moved apart by."""


def linear_ball(
    loop: "Loop", always: EstimateBounds, each: Sequence[EstimateBounds]
) -> EstimateBounds | None:
    """Return radii of balls of e and ė; None of a robot that is not linear, or of other gains.

    `each` has the most of |f| and |ḟ| on each axis.
    """
    p3, kp, kd = loop.p3, np.diag(loop.kp), np.diag(loop.kd)
    diagonal = np.array_equal(loop.kp, np.diag(kp)) and np.array_equal(loop.kd, np.diag(kd))
    if p3.lambda_c or p3.lambda_g or p3.lambda_m != p3.lambda_M or not diagonal:
        return None
    mass, drag = p3.lambda_M, p3.lambda_f
    position, velocity = np.zeros(loop.m), np.zeros(loop.m)
    for axis, f in enumerate(each):
        stiff, damped = float(kp[axis]), float(kd[axis])
        poles = _poles(mass, damped + drag, stiff)
        g = np.array([1, -1]) / (mass * (poles[0] - poles[1]))
        speed = g * poles
        own = loop.lambda_d[axis] + mass * loop.gammas[1] + drag * loop.gammas[0]
        whole = own + stiff * always.position + damped * always.velocity
        size, speeds = norm_1(g, poles), norm_1(speed, poles)
        followed = norm_1(damped * speed + stiff * g, poles)
        position[axis] = min(
            size * whole,
            f.position + size * (own + drag * f.velocity) + mass * speeds * f.velocity,
        )
        velocity[axis] = min(speeds * whole, speeds * own + followed * f.velocity)
    return EstimateBounds(float(np.linalg.norm(position)), float(np.linalg.norm(velocity)))


def _poles(mass: float, damping: float, stiffness: float) -> Complex:
    """Return both roots of mass s² + damping s + stiffness, (2,), never the same."""
    middle = -damping / (2 * mass)
    apart = np.sqrt(complex(middle * middle - stiffness / mass))
    if abs(apart) < APART * abs(middle):
        apart = complex(APART * abs(middle))
    if apart.imag:
        return np.array([middle + apart, middle - apart])
    low = middle - apart
    return np.array([stiffness / (mass * low), low])


def norm_1(weights: Complex, poles: Complex) -> float:
    """Return ∫ |Σ w_i e^{p_i t}| dt over all t ≥ 0, of a real sum of two exponentials that decay.

    Real ones cross 0 once at most. Of a pair, every half-wave is e^{π Re p/|Im p|} of the last.
    """

    def beyond(t: float) -> float:
        """Return the integral from t on."""
        return -float((weights / poles * np.exp(poles * t)).sum().real)

    p = poles[0]
    if p.imag:
        first = (np.pi / 2 - np.angle(weights[0])) / p.imag % (np.pi / abs(p.imag))
        wave = np.pi / abs(p.imag)
        one = beyond(first) - beyond(first + wave)
        return abs(beyond(0.0) - beyond(first)) + abs(one) / (1 - float(np.exp(p.real * wave)))
    low, high = weights.real
    if high and low / high < 0:
        crossed = float(np.log(-high / low) / (poles[0] - poles[1]).real)
        if crossed > 0:
            return abs(beyond(0.0) - beyond(crossed)) + abs(beyond(crossed))
    return abs(beyond(0.0))
