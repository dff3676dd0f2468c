"""Between sampling times a state flows; a plant's reference is its position and velocity.

A plant continues a reference as a line, ε + τ υ, or with the acceleration that the agent keeps as
ε + τ υ + τ²/2 a, where it takes one. Where an estimate moves otherwise, or the plant takes none, it
is given the reference's chords over the output steps: of length s, and with |ε̈| ≤ a, it is then
off by a s²/8 in position and by a s/2 in velocity, and exact at the ends of each step in position.
"""

from collections.abc import Iterator

import numpy as np

from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.random_streams import random_stream
from nrs_cosim.estimator_agents.algorithm import Algorithm, class_of, overrides
from nrs_cosim.estimator_agents.values import Values

TRIED = (0.1, 0.7)
"""s after a jump at which a flow is looked at."""
ROUNDING = 1e-14
"""By how much numbers of about 1 may differ that are computed in another order."""


def follows_lines(algorithm: Algorithm, sizes: Sizes) -> bool:
    """Return whether position and velocity flow on a line, ε̇ = υ and υ̇ = 0, to the last bit.

    A flow of its own is tried, on numbers that are the same for all workers.
    """
    if not overrides(class_of(algorithm), "flow"):
        return True
    return all(
        np.array_equal(after.position, x.position + dt * x.velocity)
        and np.array_equal(after.velocity, x.velocity)
        for dt, x, after in _flows(algorithm, sizes)
    )


def acceleration_of(algorithm: Algorithm, sizes: Sizes) -> str | None:
    """Return the field that is a constant acceleration, under which position and velocity flow.

    It is that of the target's; None where no such field is kept, or the flow is another one.
    """
    for name, field in algorithm.STATE.items():
        if field.truth == "acceleration" and all(
            np.allclose(flowing, quadratic, rtol=ROUNDING, atol=ROUNDING)
            for dt, x, after in _flows(algorithm, sizes)
            for flowing, quadratic in (
                (after.position, x.position + dt * (x.velocity + dt / 2 * x[name])),
                (after.velocity, x.velocity + dt * x[name]),
                (after[name], x[name]),
            )
        ):
            return name
    return None


def _flows(algorithm: Algorithm, sizes: Sizes) -> Iterator[tuple[float, Values, Values]]:
    """Yield times, a state, and what it is such a time later."""
    rng = random_stream(0, "flow")
    x = Values(
        {name: rng.normal(size=(1, *field.size(sizes))) for name, field in algorithm.STATE.items()}
    )
    for dt in TRIED:
        yield dt, x, algorithm.flow(x, dt)


def chord_errors(acceleration: float, step: float) -> tuple[float, float]:
    """Return how far off chords over steps, s, are in position and velocity, for |ε̈| up to that."""
    return acceleration * step * step / 8, acceleration * step / 2
