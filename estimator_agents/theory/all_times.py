"""What errors of references come to at all times, from what they are at most around sampling times.

On lines ε̄_i is convex between sampling times, but for what the target does, which bounds at both
ends have in them, and ῡ_i likewise. Where agents move on at an acceleration a_i of their own, that
bends both, as |a_i − a_0(t)| ≤ |a_i − a_0(t_k)| + 2 γ2 = s: by h² s/8 and h s/2 at most (statement
W6).
"""

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.flow import chord_errors
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds

Array = NDArray[np.float64]


def is_straight(flow: Array, h: float) -> bool:
    """Return whether positions and velocities, the first two fields, move on along lines."""
    return np.array_equal(flow[:2], np.eye(2, len(flow)) + h * np.eye(2, len(flow), 1) * [[1], [0]])


def at_all_times(
    flow: Array, h: float, before: Array, after: Array, gamma_2: float, chord: float
) -> EstimateBounds | None:
    """Return it, from bounds right before and right after sampling times, (s, n) each.

    Robots are given chords of curves over `chord`, s, where that is not 0. None of other flows.
    """
    position, velocity = np.maximum(before[:2], after[:2]).max(axis=1).tolist()
    if is_straight(flow, h):
        return EstimateBounds(position, velocity)
    curved = np.array([[1, h, h * h / 2], [0, 1, h], [0, 0, 1]])
    if flow.shape != (3, 3) or not np.allclose(flow, curved, rtol=1e-12, atol=0):
        return None
    off = float(after[2].max())
    bent, chords = off + 2 * gamma_2, chord_errors(off + gamma_2, chord)
    return EstimateBounds(
        position + h * h / 8 * bent + chords[0], velocity + h / 2 * bent + chords[1]
    )
