"""Rotations, by IEEE's + − × ÷ and √ alone and each sum in one order: what a URDF's C rests on.

Products of matrices by NumPy are BLAS's, whose order and fused operations follow the processor, and
so are norms; SciPy's rotations go by the C library's sin and cos. With k of length 1,

    R = cos θ + sin θ [k]× + (1 − cos θ) k kᵀ,    1 − cos θ = 2 sin²(θ/2).
"""

from collections.abc import Sequence
from math import copysign, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.mathematics import sine, sine_and_cosine

Array = NDArray[np.float64]


def multiplied(a: Array, b: Array) -> Array:
    """Return a b of a matrix (3, 3) and another one, or a vector (3,)."""
    first, second, third = (np.multiply.outer(a[:, k], b[k]) for k in range(3))
    total: Array = first + second + third
    return total


def length(v: Sequence[float] | Array) -> float:
    """Return ‖v‖₂ of a vector (3,)."""
    x, y, z = map(float, v)
    return sqrt(x * x + y * y + z * z)


def cross_matrix(v: Sequence[float] | Array) -> Array:
    """Return [v]×, (3, 3), with [v]× w = v × w."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(vector: Array) -> Array:
    """Return the rotation (3, 3) about a vector (3,) by its length, rad."""
    angle = length(vector)
    if not angle:
        return np.eye(3)
    k = vector / angle
    s, c = sine_and_cosine(angle)
    half = sine(angle / 2)
    found: Array = c * np.eye(3) + s * cross_matrix(k) + 2 * half * half * np.multiply.outer(k, k)
    return found


def rotation_of(rpy: Sequence[float]) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll), (3, 3), of roll, pitch and yaw, rad."""
    (sr, sp, sy), (cr, cp, cy) = sine_and_cosine(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_of(R: Array) -> tuple[float, float, float]:
    """Return roll, pitch and yaw, rad, of a rotation (3, 3).

    The yaw is found first, and the others beside it, so that all three are right together where a
    pitch of a quarter turn leaves one of them open.
    """
    yaw = angle_of(R[1, 0], R[0, 0])
    s, c = map(float, sine_and_cosine(yaw))
    pitch = angle_of(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = angle_of(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return roll, pitch, yaw


def angle_of(y: float, x: float) -> float:
    """Return the angle of (x, y), rad: a guess that is right to 0.004, and twice what it is off.

    It is off by δ of which tan δ = (y cos a − x sin a)/(x cos a + y sin a).
    """
    x, y = float(x), float(y)
    if not (x or y):
        return 0.0
    small, large = sorted((abs(x), abs(y)))
    t = small / large
    a = t * (pi / 4 + 0.273 * (1 - t))
    a = pi / 2 - a if abs(y) > abs(x) else a
    a = copysign(pi - a if x < 0 else a, y)
    for _ in range(2):
        s, c = map(float, sine_and_cosine(a))
        d = (y * c - x * s) / (x * c + y * s)
        a += d * (1 - d * d * (1 / 3 - d * d / 5))
    return a
