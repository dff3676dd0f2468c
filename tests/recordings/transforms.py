"""Transforms of Foxglove and of ROS as matrices."""

from typing import Any

import numpy as np
import pytest


def matrix(transform: Any) -> np.ndarray:
    """The 4 x 4 matrix of a transform by a quaternion and a translation."""
    x, y, z, w = (getattr(transform.rotation, axis) for axis in "xyzw")
    assert x * x + y * y + z * z + w * w == pytest.approx(1)
    made = np.eye(4)
    made[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    made[:3, 3] = [getattr(transform.translation, axis) for axis in "xyz"]
    return made
