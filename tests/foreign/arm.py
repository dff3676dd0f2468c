"""The paper's arm in plain Python, for FMUs that other tools export; RK4 with a step of 5 ms.

It runs inside those FMUs, apart from the project, and so imports nothing of it.
"""

from math import cos, sin

M1, M2, R1, R2, J1, J2, G = 0.5, 1.5, 1.0, 0.8, 5.0, 5.0, 9.8


def rates(t, x, torque):
    """Return d/dt (q1, q2, qd1, qd2) at a time, under torque(t, x) on both joints."""
    q1, q2, d1, d2 = x
    m11 = (M1 + M2) * R1**2 + M2 * R2**2 + 2 * M2 * R1 * R2 * cos(q2) + J1
    m12 = M2 * R2**2 + M2 * R1 * R2 * cos(q2)
    m22 = M2 * R2**2 + J2
    b = M2 * R1 * R2 * sin(q2)
    far = M2 * G * R2 * cos(q1 + q2)
    t1, t2 = torque(t, x)
    f1 = t1 + b * d2 * d1 + b * (d1 + d2) * d2 - (M1 + M2) * G * R1 * cos(q1) - far
    f2 = t2 - b * d1 * d1 - far
    det = m11 * m22 - m12 * m12
    return [d1, d2, (m22 * f1 - m12 * f2) / det, (m11 * f2 - m12 * f1) / det]


def advance(t, dt, x, torque):
    """Return the state (q1, q2, qd1, qd2) after dt."""
    n = max(1, round(dt / 0.005))
    h = dt / n
    for i in range(n):
        s = t + i * h
        k1 = rates(s, x, torque)
        k2 = rates(s + h / 2, [a + h / 2 * b for a, b in zip(x, k1, strict=True)], torque)
        k3 = rates(s + h / 2, [a + h / 2 * b for a, b in zip(x, k2, strict=True)], torque)
        k4 = rates(s + h, [a + h * b for a, b in zip(x, k3, strict=True)], torque)
        x = [
            a + h / 6 * (b + 2 * c + 2 * d + e)
            for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)
        ]
    return x
