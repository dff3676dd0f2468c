"""The limit of a step against closed forms, and its probing on a plant of known inertia."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from nrs_cosim.plant_fmu.drives.probe import expect_stable
from nrs_cosim.plant_fmu.drives.stability import held, heun, runge_kutta, step_limit
from nrs_cosim.plant_fmu.errors import FmuError, StepError
from nrs_cosim.plant_fmu.plants import Array, Body, Disturbance

INERTIA = np.array([[3.0, 1.0], [1.0, 2.0]])


@pytest.mark.parametrize(("kp", "kd", "mass"), [(10, 100, 2), (200, 1, 5), (0.1, 300, 5.08)])
def test_the_limit_of_a_held_torque_on_one_axis_agrees_with_the_closed_form(
    kp: float, kd: float, mass: float
) -> None:
    limit = step_limit(np.array([[kp, kd]]) / mass, held)
    assert limit == pytest.approx(min(2 * mass / kd, 2 * kd / kp), rel=1e-6)


def test_the_limit_of_a_damped_speed_agrees_with_the_closed_form() -> None:
    """Where kp hardly matters: |1 - z + z²/2| < 1 and |1 - z + z²/2 - z³/6 + z⁴/24| < 1."""
    feedback = np.array([[1e-3, 10.0]])
    assert step_limit(feedback, heun) == pytest.approx(2 / 10, rel=1e-3)
    assert step_limit(feedback, runge_kutta) == pytest.approx(2.785294 / 10, rel=1e-3)


def test_a_control_law_without_damping_has_no_limit() -> None:
    assert step_limit(np.array([[10.0, 0.0]]), held) == np.inf


class Block:
    """A plant without gravity that refuses postures beyond 1 rad, in closed form."""

    def __init__(self) -> None:
        self.q = self.qd = self.tau = np.zeros((1, 2))
        self.refused = 0

    def start_again(self, bodies: Sequence[Body]) -> None:
        (body,) = bodies
        if np.abs(body.q).max() > 1:
            self.refused += 1
            raise StepError("beyond its joints' limits")
        self.q, self.qd, self._torque = body.q[None], body.qd[None], body.disturbance.offset

    def hold(self, position: Array, velocity: Array) -> None:  # noqa: ARG002
        raise AssertionError("the limit is probed by pushes alone")

    def advance(self, start: float, step: float) -> None:  # noqa: ARG002
        self.qd = self.qd + step * np.linalg.solve(INERTIA, self._torque)


def test_inertia_is_probed_where_the_plant_allows_it() -> None:
    none, wave = np.zeros(2), np.zeros((2, 0))
    body = Body(
        robot=3,
        parameters={},
        kp=np.eye(2),
        kd=100 * np.eye(2),
        disturbance=Disturbance(none, none, wave, wave, wave),
        q=none,
        qd=none,
        position=none,
        velocity=none,
    )
    limit = 2 * np.linalg.eigvalsh(INERTIA)[0] / 100
    probe = Block()
    expect_stable(probe, [body], held, "control_step", 0.99 * limit)
    with pytest.raises(FmuError, match=rf"about {limit:.2g} s estimated for robot 3"):
        expect_stable(probe, [body], held, "control_step", 1.01 * limit)
    assert probe.refused > 0
    with pytest.raises(FmuError, match=r"joints.* before the run"):
        expect_stable(probe, [replace(body, q=none + 2)], held, "control_step", limit)
