"""An oracle for the whole run, written from the paper alone: NumPy equations, DOP853, dense sums.

It shares no code with the project: not the C model, not the agents, not the clock.
"""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

M1, M2, R1, R2, J1, J2, G = 0.5, 1.5, 1.0, 0.8, 5.0, 5.0, 9.8
KP, KD = 200.0, 300.0

W = np.array(
    [
        [0, 0, 1, 1, 0, 0, 0],
        [0, 1, 0, 0, 0, 0, 0],
        [1, 0, 0, 0, 0, 0, 0],
        [0, 1, 0, 1, 0, 0, 0],
        [0, 0, 1, 1, 1, 0, 0],
        [0, 0, 0, 1, 0, 0, 0],
    ],
    float,
)
"""w_ij of the paper's example with the target as column 0."""


def target(t):
    """Return ε_0(t), υ_0(t)."""
    return (
        np.array([2 * t + np.sin(t), -2 * t - np.cos(t)]),
        np.array([2 + np.cos(t), -2 + np.sin(t)]),
    )


def acceleration(t, q, qd, tau):
    """Return q̈ of n arms, (n, 2), under a torque and the example's disturbance."""
    q1, q2 = q.T
    d1, d2 = qd.T
    c2, s2 = np.cos(q2), np.sin(q2)
    mass = np.empty((len(q), 2, 2))
    mass[:, 0, 0] = (M1 + M2) * R1**2 + M2 * R2**2 + 2 * M2 * R1 * R2 * c2 + J1
    mass[:, 0, 1] = mass[:, 1, 0] = M2 * R2**2 + M2 * R1 * R2 * c2
    mass[:, 1, 1] = M2 * R2**2 + J2
    b = M2 * R1 * R2 * s2
    coriolis = np.stack([-b * d2 * d1 - b * (d1 + d2) * d2, b * d1 * d1], axis=1)
    far = M2 * G * R2 * np.cos(q1 + q2)
    gravity = np.stack([(M1 + M2) * G * R1 * np.cos(q1) + far, far], axis=1)
    disturbance = 2 * np.array([np.sin(t), np.cos(2 * t)])
    force = tau + disturbance - coriolis - gravity
    return np.linalg.solve(mass, force[..., None])[..., 0]


def simulate(order, alpha, beta, h, duration, *start):
    """Return t_k = k h (K+1,), and what `along` returns."""
    times = np.array([k * h for k in range(round(duration / h) + 1)])
    return times, *along(order, alpha, beta, times, *start)


def along(order, alpha, beta, times, position, velocity, q, qd):
    """Return q (K+1, n, 2) and the estimates before the jumps (K+1, 2, n, 2) at t_0 … t_K."""
    share = W / W.sum(axis=1, keepdims=True)
    joints, estimates = [q], [(position, velocity)]
    for t0, t1 in pairwise(times):

        def rhs(t, x, t0=t0, position=position, velocity=velocity):
            q, qd = x.reshape(2, -1, 2)
            tau = KP * (position + (t - t0) * velocity - q) + KD * (velocity - qd)
            return np.concatenate([qd, acceleration(t, q, qd, tau)]).ravel()

        x0 = np.concatenate([q, qd]).ravel()
        end = solve_ivp(rhs, (t0, t1), x0, method="DOP853", rtol=1e-11, atol=1e-11).y[:, -1]
        q, qd = end.reshape(2, -1, 2)
        position = position + (t1 - t0) * velocity
        joints.append(q)
        estimates.append((position, velocity))
        e0, v0 = target(t1)
        dp = share @ np.vstack([e0, position]) - position
        dv = share @ np.vstack([v0, velocity]) - velocity
        if order == 1:
            position, velocity = position + alpha * dp, velocity + beta * dv
        else:
            velocity = velocity + alpha * dp + beta * dv
    return np.array(joints), np.array(estimates)
