"""The PD law of several robots against its equation, a term at a time."""

import numpy as np
import pytest

from nrs_cosim.plant_fmu.drives.pd_law import Law
from nrs_cosim.plant_fmu.plants import Body, Disturbance

RNG = np.random.default_rng(45)
ROWS, M = 3, 2
NO_ACCELERATION = np.zeros((ROWS, M))


def random_body(robot, waves=2):
    kp, kd = RNG.uniform(1, 9, (2, M, M))
    disturbance = Disturbance(
        *RNG.normal(size=(2, M)), *(RNG.normal(size=(M, waves)) for _ in range(3))
    )
    return Body(robot, {}, kp, kd, disturbance, *RNG.normal(size=(4, M)))


BODIES = [random_body(1), random_body(2, waves=0), random_body(3, waves=1)]


def expected(bodies, t, since, position, velocity, state, acceleration=NO_ACCELERATION):
    """Return tau and tau_d of each robot, as the equation has them."""
    tau, waves = np.zeros((2, ROWS, M))
    for row, body in enumerate(bodies):
        q, qd = state[row, :M], state[row, M:]
        s, a = t - since, acceleration[row]
        moved, rate = position[row] + s * velocity[row] + s**2 / 2 * a, velocity[row] + s * a
        tau[row] = body.kp @ (moved - q) + body.kd @ (rate - qd)
        d = body.disturbance
        waves[row] = d.offset + d.rate * t
        waves[row] += (d.amplitude * np.sin(d.frequency * t + d.phase)).sum(axis=1)
    return tau, waves


def test_torque_and_effort_are_those_of_the_equation():
    law, state = Law(BODIES), RNG.normal(size=(ROWS, 2 * M))
    position, velocity = (
        np.array([getattr(b, x) for b in BODIES]) for x in ("position", "velocity")
    )
    curves = {0.0: (), 0.4: (), 0.9: (RNG.normal(size=(ROWS, M)),), 1.7: ()}
    for since, acceleration in curves.items():
        if since:
            position, velocity = RNG.normal(size=(2, ROWS, M))
            law.hold(since, position, velocity, *acceleration)
        for t in (since, since + 0.25):
            reference = position, velocity, state, *acceleration
            tau, disturbance = expected(BODIES, t, since, *reference)
            assert law.torque(t, state) == pytest.approx(tau, rel=1e-12, abs=1e-12)
            assert law.effort(t, state) == pytest.approx(tau + disturbance, rel=1e-12, abs=1e-12)


def test_references_are_copied():
    law, state = Law(BODIES), np.zeros((ROWS, 2 * M))
    position, velocity, acceleration = RNG.normal(size=(3, ROWS, M))
    law.hold(0.5, position, velocity, acceleration)
    kept = expected(BODIES, 0.75, 0.5, position, velocity, state, acceleration.copy())[0]
    position[:], velocity[:], acceleration[:] = 9e9, 9e9, 9e9
    assert law.torque(0.75, state) == pytest.approx(kept, rel=1e-12)
    assert np.abs(law.reference).max() < 1e3


def test_torques_are_added_from_left_to_right_to_the_last_bit():
    law, state = Law(BODIES), RNG.normal(size=(ROWS, 2 * M))
    for row, body in enumerate(BODIES):
        for axis, torque in enumerate(law.torque(0.0, state)[row].tolist()):
            kp, kd = body.kp[axis].tolist(), body.kd[axis].tolist()
            held = kp[0] * body.position[0] + kp[1] * body.position[1]
            held += kd[0] * body.velocity[0] + kd[1] * body.velocity[1]
            q = state[row].tolist()
            back = ((kp[0] * q[0] + kp[1] * q[1]) + kd[0] * q[2]) + kd[1] * q[3]
            assert torque == held - back
