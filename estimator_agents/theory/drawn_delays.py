"""How far any target takes estimates over links whose delays are drawn (statement W7).

Where r < 1 in statement D3, let X be the lim sup of |x|, by entries. While a sample is under way a
target within γ1 and γ2 has moved on by no more than that lets it, and in a period it does to x no
more than b, with that in it. So X ≤ M X + b, M = |F K| ⊗ I + |F G S| ⊗ D, and X ≤ (I − M)⁻¹ b.
"""

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import identity_like, kron
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.theory.all_times import at_all_times
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.estimator_agents.theory.late_states import Delays
from nrs_cosim.estimator_agents.theory.linear_step import NEAR, LinearStep
from nrs_cosim.estimator_agents.theory.solving import solve

Array = NDArray[np.float64]


def worst_of_drawn(
    step: LinearStep,
    topology: Topology,
    most: Delays,
    gammas: tuple[float, float],
    chord: float,
) -> tuple[EstimateBounds, EstimateBounds | None] | None:
    """Return bounds on the errors at sampling times, and at all times, of a step with r < 1.

    `most` is the longest delay of each edge, (E,). None where agents that are right do not stay so
    at a target that rests, or send what it does not.
    """
    E, F, h, (gamma_1, gamma_2) = step.truth, step.flow, step.h, gammas
    agreed = (step.own + step.received) @ E
    if not step.agrees or not np.allclose(agreed[:, 0], E[:, 0], atol=NEAR):
        return None
    moved = np.array([_moved(d * h, gammas) for d in most.tolist()]).T
    aged = np.array([np.bincount(topology.sink - 1, topology.normalised * one) for one in moved])
    still, ahead = np.array([0.0, gamma_1, gamma_2]), np.array(_moved(h, gammas))
    # E z(t_{k+1}) is E z(t_k), moved on straight, and what the target turns by in a period.
    straight = agreed - E @ [[1, h, 0], [0, 1, 0], [0, 0, 0]]
    turned = np.array([min(gamma_2 * h * h / 2, 2 * gamma_1 * h), ahead[1], gamma_2])

    def bounds(own: Array, received: Array, given: Array, X: Array) -> Array:
        late = np.abs(received @ E) @ aged
        mean = np.array([topology.D @ field for field in X])
        found: Array = np.abs(own) @ X + np.abs(received) @ mean + late + given[:, None]
        return found

    given = np.abs(straight) @ still + np.abs(E) @ turned
    M = kron(np.abs(step.own), identity_like(topology.D)) + kron(np.abs(step.received), topology.D)
    b = bounds(step.own, step.received, given, np.zeros((len(E), topology.n)))
    X = solve(identity_like(M) - M, b.ravel()).reshape(b.shape)
    back = np.linalg.inv(F)
    right = np.abs(back @ agreed - E) @ still
    after = bounds(back @ step.own, back @ step.received, right, X)
    position, velocity = X[:2].max(axis=1).tolist()
    return EstimateBounds(position, velocity), at_all_times(F, h, X, after, gamma_2, chord)


def _moved(seconds: float, gammas: tuple[float, float]) -> tuple[float, float, float]:
    """Return what z changes by at most meanwhile."""
    gamma_1, gamma_2 = gammas
    velocity = min(2 * gamma_1, gamma_2 * seconds)
    return gamma_1 * seconds, velocity, 2 * gamma_2 if seconds else 0.0
