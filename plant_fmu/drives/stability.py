"""Beyond which step the loop diverges, though it converges in continuous time: ρ(Φ(T)) = 1.

Near rest a robot obeys q̈ = −F [q; q̇] with F = M⁻¹ [kp kd], and Φ(T) leads [q; q̇] from one step to
the next. With ki, in Model Exchange, it is q̈ = −F [q; q̇; z], ż = q, with F = M⁻¹ [kp kd ki]. For a
torque held over T on one axis the limit is min(2 M/kd, 2 kd/kp).
"""

from collections.abc import Callable

import numpy as np

from nrs_cosim.plant_fmu.plants import Array

Propagate = Callable[[float, Array], Array]
"""(T in s, F (m, 2 m), 1/s² and 1/s; or F (m, 3 m)) → Φ, as large as [q; q̇; z]"""

HALVINGS = 30
"""Of what the limit is sought in: it is known to a 10⁹th of that."""


def held(step: float, feedback: Array) -> Array:
    """Return Φ, (2 m, 2 m), for a torque held over a step, s, with F (m, 2 m)."""
    free, forced = _drift(step, len(feedback))
    return free - forced @ feedback


def heun(step: float, feedback: Array) -> Array:
    """Return Φ for the mean of the torques before and after a step with the first; as `held`."""
    free, forced = _drift(step, len(feedback))
    ahead = free - forced @ feedback
    return free - forced @ feedback @ (np.eye(len(free)) + ahead) / 2


def runge_kutta(step: float, feedback: Array) -> Array:
    """Return Φ for the classical Runge–Kutta method of order 4; as `held`."""
    h = step * _rates(feedback)
    one = np.eye(len(h))
    return one + h @ (one + h @ (one + h @ (one + h / 4) / 3) / 2)


def step_limit(feedback: Array, propagate: Propagate) -> float:
    """Return the step in s below which ρ(Φ) < 1, with F (m, 2 m).

    It is infinite for a law that does not damp by itself, for there it says nothing of a plant
    that does.
    """
    rates = np.linalg.eigvals(_rates(feedback))
    fastest = float(np.abs(rates).max())
    if not rates.real.max() < -1e-9 * fastest:  # 0 but for rounding
        return np.inf
    # Well beyond the limit of each method on one axis, which is at most 3 / |λ|.
    low, high = 0.0, 8 / fastest
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        if np.abs(np.linalg.eigvals(propagate(middle, feedback))).max() < 1:
            low = middle
        else:
            high = middle
    return low


def _rates(feedback: Array) -> Array:
    """Return the matrix of [q; q̇]' in continuous time."""
    m, n = feedback.shape
    rates = np.zeros((n, n))
    rates[:m, m : 2 * m] = np.eye(m)
    rates[m : 2 * m] = -feedback
    rates[2 * m :, :m] = np.eye(n - 2 * m, m)
    return rates


def _drift(step: float, m: int) -> tuple[Array, Array]:
    """Return what a step does to [q; q̇] by itself, and by an acceleration held over it."""
    one = np.eye(m)
    free = np.block([[one, step * one], [np.zeros((m, m)), one]])
    return free, np.concatenate([step**2 / 2 * one, step * one])
