"""What a law needs of a plant's inertia and weight, asked of its equations: qdd = A tau + b(q, qd).

A = M⁻¹ is what unit torques add, and b what there is without any: at rest −M⁻¹ G(q). As in
controller.c, tau is u, or M u, and makes up for weight, or for all of b.
"""

from collections.abc import Callable

import numpy as np

from nrs_cosim.plant_fmu.plants import Array, Control

Accelerate = Callable[[Array, bool], Array]
"""(tau (m,), whether qd is 0) → qdd (m,)"""


def needs_model(control: Control) -> bool:
    """Whether a law wants more of a plant than its q and qd."""
    return bool(control.wanted() - {"torque_limit", "ki"})


def model_torque(control: Control, u: Array, acceleration: Array, accelerate: Accelerate) -> Array:
    """Return tau (m,) of the terms u (m,) and of the reference's acceleration (m,)."""
    m = len(u)
    none = np.zeros(m)
    moving = accelerate(none, False)
    inverse = np.column_stack([accelerate(push, False) - moving for push in np.eye(m)])
    scaled = control.inertia_scaling or control.computed_torque
    wanted = np.zeros(m)
    if scaled:
        wanted += u
    if control.acceleration_feedforward or control.computed_torque:
        wanted += acceleration
    if control.computed_torque:
        wanted -= moving
    elif control.gravity_compensation:
        wanted -= accelerate(none, True)
    torque = _solved(inverse, wanted)
    return torque if scaled else u + torque


def _solved(A: Array, b: Array) -> Array:
    """Return x (m,) of A x = b with A (m, m), by Gauss, the greatest of a column first."""
    # No library of linear algebra: each adds in an order of its own, some multiply and add in one.
    rows = np.column_stack([A, b])
    for k in range(len(b)):
        best = k + int(np.argmax(np.abs(rows[k:, k])))
        rows[[k, best]] = rows[[best, k]]
        rows[k] /= rows[k, k]
        others = np.arange(len(b)) != k
        rows[others] -= rows[others, k, None] * rows[k]
    return rows[:, -1]
