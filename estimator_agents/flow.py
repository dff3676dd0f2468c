"""Between sampling times a state flows; a plant's reference is its position and velocity.

An FMU continues a reference as a line, ε + τ υ. Where an estimate does not move so, the plant is
given its chords over the output steps: of length s, and with |ε̈| ≤ a, the reference is then off by
a s²/8 in position and by a s/2 in velocity, and exact at the ends of each step in position.
"""

import numpy as np

from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.random_streams import random_stream
from nrs_cosim.estimator_agents.algorithm import Algorithm, class_of, overrides
from nrs_cosim.estimator_agents.values import Values

TRIED = (0.1, 0.7)
"""s after a jump at which a flow is looked at."""


def follows_lines(algorithm: Algorithm, sizes: Sizes) -> bool:
    """Return whether position and velocity flow on a line, ε̇ = υ and υ̇ = 0, to the last bit.

    A flow of its own is tried, on numbers that are the same for all workers.
    """
    if not overrides(class_of(algorithm), "flow"):
        return True
    rng = random_stream(0, "flow")
    x = Values(
        {name: rng.normal(size=(1, *field.size(sizes))) for name, field in algorithm.STATE.items()}
    )
    for dt in TRIED:
        after = algorithm.flow(x, dt)
        line = x.position + dt * x.velocity
        if not np.array_equal(after.position, line) or not np.array_equal(
            after.velocity, x.velocity
        ):
            return False
    return True


def chord_errors(acceleration: float, step: float) -> tuple[float, float]:
    """Return how far off chords over steps, s, are in position and velocity, for |ε̈| up to that."""
    return acceleration * step * step / 8, acceleration * step / 2
