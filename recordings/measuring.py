"""The steady state is the last fifth of a run: how far the estimates and the robots are off there.

ε̄_i = ε_i − ε_0 and ῡ_i = υ_i − υ_0 are taken at the sampling times, left limits, in the ∞-norm;
e_i = q_i − ε_0 and ė_i = q̇_i − υ_0 on the output grid, in the 2-norm (paper, after equation 2.1).
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from recordings.reading import Reader
from recordings.tables import SAMPLES, STATES, rows

Array = NDArray[np.float64]
TargetAt = Callable[[Array], tuple[Array, Array]]
"""Position and velocity (rows, m) of the target at times in s (rows,)."""


@dataclass(frozen=True, slots=True)
class SteadyState:
    """Suprema over robots and the last fifth of a run; 0 where nothing was recorded there."""

    position_estimate: float = 0.0
    """sup ‖ε̄_i(t_k)‖∞"""
    velocity_estimate: float = 0.0
    """sup ‖ῡ_i(t_k)‖∞"""
    position_tracking: float = 0.0
    """sup ‖e_i‖₂"""
    velocity_tracking: float = 0.0
    """sup ‖ė_i‖₂"""


def steady_state(reader: Reader, target_at: TargetAt) -> SteadyState:
    """Measure the steady state of a recording against its target."""
    end = reader.end_ns or 0
    since = end - end // 5
    found = dict.fromkeys((field.name for field in fields(SteadyState)), 0.0)

    def note(name: str, errors: Array, order: float) -> None:
        norms = np.linalg.norm(errors, order, axis=1)
        found[name] = max(found[name], float(norms.max(initial=0.0)))

    for table, part in rows(reader, [SAMPLES, STATES], start_ns=since):
        records = part[part["robot"] > 0]
        position, velocity = target_at(records["t"])
        if table is SAMPLES:
            note("position_estimate", records["position"] - position, np.inf)
            note("velocity_estimate", records["velocity"] - velocity, np.inf)
        else:
            note("position_tracking", records["q"] - position, 2)
            note("velocity_tracking", records["qd"] - velocity, 2)
    return SteadyState(**found)
