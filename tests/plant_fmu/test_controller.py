"""The control law of bundled models, written out once more and integrated by DOP853.

M and C of the two-link arm are those of its readme; its gravity is the gradient of its potential
energy by differences.
"""

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.plant_fmu.fmpy_instances import Array, Open
from tests.plant_fmu.test_bundled_models import each_version

M1, M2, R1, R2, J, G = 0.5, 1.5, 1.0, 0.8, 5.0, 9.8
POSITION, VELOCITY, ACCELERATION = np.array([[0.7, -0.4], [0.6, -1.2], [1.5, 2.5]])
Q0, QD0, TAU = np.array([[0.4, -1.1], [2.0, -0.7], [3.0, -2.0]])
KP = np.array([[90.0, 7.0], [-3.0, 60.0]])
KD = np.array([[40.0, 5.0], [2.0, 30.0]])
KI = np.array([[50.0, 0.0], [4.0, 35.0]])
SCALED = {"kp": np.diag([9.0, 16.0]), "kd": np.diag([6.0, 8.0])}
OPTIONS: dict[str, dict[str, Any]] = {
    "torque limit": {"torque_limit": np.array([25.0, 9.0])},
    "gravity": {"gravity_compensation": 1.0},
    "some gravity": {"gravity_compensation": 0.6},
    "feed-forward": {"acceleration_feedforward": 1.0},
    "scaled": {"inertia_scaling": 1.0, **SCALED},
    "computed torque": {"computed_torque": 1.0, **SCALED},
    "integral": {"ki": KI},
    "integral within a limit": {"ki": KI, "torque_limit": np.array([25.0, 9.0])},
    "all": {
        "inertia_scaling": 1.0,
        **SCALED,
        "ki": np.diag([5.0, 3.0]),
        "gravity_compensation": 1.0,
        "acceleration_feedforward": 1.0,
        "torque_limit": np.array([60.0, 30.0]),
    },
}
TIMES = np.arange(1, 9) * 0.25


def mass(q: Array) -> Array:
    b = M2 * R1 * R2 * np.cos(q[1])
    far = M2 * R2**2
    return np.array([[(M1 + M2) * R1**2 + far + 2 * b + J, far + b], [far + b, far + J]])


def coriolis(q: Array, qd: Array) -> Array:
    b = M2 * R1 * R2 * np.sin(q[1])
    return np.array([-b * qd[1] * (2 * qd[0] + qd[1]), b * qd[0] ** 2])


def potential(q: Array) -> float:
    height = R1 * np.sin(q[0])
    return G * (M1 * height + M2 * (height + R2 * np.sin(q[0] + q[1])))


def gravity(q: Array, by: float = 1e-3) -> Array:
    steps = by * np.eye(2)
    one = [(potential(q + s) - potential(q - s)) / (2 * by) for s in steps]
    two = [(potential(q + 2 * s) - potential(q - 2 * s)) / (4 * by) for s in steps]
    return (4 * np.array(one) - np.array(two)) / 3


def law(given: dict[str, Any], t: float, x: Array) -> tuple[Array, Array, Array]:
    """tau_applied, what is missing, and the rate of the integral."""
    q, qd, z = np.split(x, 3)
    e = POSITION + t * VELOCITY + t * t / 2 * ACCELERATION - q
    ed = VELOCITY + t * ACCELERATION - qd
    u = given.get("kp", KP) @ e + given.get("kd", KD) @ ed + given.get("ki", np.zeros((2, 2))) @ z
    if given.get("computed_torque"):
        asked = TAU + mass(q) @ (ACCELERATION + u) + coriolis(q, qd) + gravity(q)
    else:
        asked = TAU + (mass(q) @ u if given.get("inertia_scaling") else u)
        asked = asked + given.get("gravity_compensation", 0.0) * gravity(q)
        asked += given.get("acceleration_feedforward", 0.0) * mass(q) @ ACCELERATION
    limit = given.get("torque_limit", np.full(2, np.inf))
    applied = np.clip(asked, -limit, limit)
    beyond = np.where((asked - applied) * e > 0, np.abs(asked - applied) / (limit / 10), 0.0)
    return applied, asked - applied, e * np.clip(1 - beyond, 0.0, None)


def rates(given: dict[str, Any], t: float, x: Array) -> Array:
    q, qd, _ = np.split(x, 3)
    applied, _, integral = law(given, t, x)
    qdd = np.linalg.solve(mass(q), applied - coriolis(q, qd) - gravity(q))
    return np.concatenate([qd, qdd, integral])


@cache
def wanted(option: str) -> Array:
    """(q, qd, integral) at TIMES."""
    given, start = OPTIONS[option], np.concatenate([Q0, QD0, np.zeros(2)])
    # Where a limit begins to bind the law has a kink, and a step across it is off by more.
    longest = 0.05 if "torque_limit" in given else np.inf
    return solve_ivp(
        lambda t, x: rates(given, t, x), (0.0, TIMES[-1]), start, "DOP853",
        t_eval=TIMES, rtol=1e-11, atol=1e-11, max_step=longest,
    ).y.T  # fmt: skip


@each_version
@pytest.mark.parametrize("option", OPTIONS)
def test_an_option_is_the_law_that_is_written(robot: Open, fmi: int, option: str) -> None:
    given = OPTIONS[option]
    inputs = {
        "tau": TAU,
        "position_ref": POSITION,
        "velocity_ref": VELOCITY,
        "acceleration_ref": ACCELERATION,
        "reference_time": 0.0,
    }
    limited = 0
    with robot("two_link_arm", fmi) as r:
        r.set("relative_tolerance", 1e-12 if "torque_limit" in given else 1e-9)
        r.initialize(**{"kp": KP, "kd": KD, "q": Q0, "qd": QD0, **inputs, **given})
        for t, x in zip(TIMES, wanted(option), strict=True):
            r.fmu.doStep(t - 0.25, 0.25)
            integral = r.get("integral")
            assert np.abs(np.concatenate([r.get("q"), r.get("qd")]) - x[:4]).max() < 1e-7
            assert np.abs(integral - x[4:] * ("ki" in given)).max() < 1e-7
            applied, missing, _ = law(given, t, np.concatenate([r.get("q"), r.get("qd"), integral]))
            assert np.abs(r.get("tau_applied") - applied).max() < 1e-8
            assert np.abs(r.get("tau_missing") - missing).max() < 1e-8
            limited += bool(missing.any())
    assert (limited > 0) == ("torque_limit" in given)


def test_computed_torque_makes_the_error_that_of_an_oscillator(robot: Open) -> None:
    """e'' + 2 w e' + w^2 e = 0, at critical damping, whatever the arm does."""
    w = np.array([3.0, 4.0])
    with robot("two_link_arm", 3) as r:
        r.initialize(
            kp=np.diag(w**2), kd=np.diag(2 * w), computed_torque=1.0, q=Q0, qd=QD0,
            position_ref=POSITION, velocity_ref=VELOCITY, acceleration_ref=ACCELERATION,
            reference_time=0.0,
        )  # fmt: skip
        e0, ed0 = POSITION - Q0, VELOCITY - QD0
        for t in TIMES:
            r.fmu.doStep(t - 0.25, 0.25)
            e = (e0 + (ed0 + w * e0) * t) * np.exp(-w * t)
            target = POSITION + t * VELOCITY + t * t / 2 * ACCELERATION
            assert np.abs(target - r.get("q") - e).max() < 1e-8


@each_version
def test_integral_action_is_of_co_simulation_alone(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi, "Model") as r:
        r.set("ki", KI)
        assert r.refuses(r.initialize) == "ki: integral action is of co-simulation alone"


@pytest.mark.parametrize("options", [{"torque_limit": 4.0}, {"gravity_compensation": 1.0}])
def test_options_of_one_link(robot: Open, options: dict[str, float]) -> None:
    """(I + J + m c^2) qdd + m g c cos q = what the law applies."""
    m, c, inertia, drive, kp, kd = 1.0, 0.25, 0.02, 5.0, 20.0, 12.0

    def weight(q: Array) -> Array:
        return m * G * c * np.cos(q)

    def rates(_t: float, x: Array) -> list[Array]:
        q, qd = x
        asked = kp * (1.0 - q) - kd * qd + options.get("gravity_compensation", 0.0) * weight(q)
        limit = options.get("torque_limit", np.inf)
        return [qd, (np.clip(asked, -limit, limit) - weight(q)) / (inertia + drive + m * c * c)]

    wanted = solve_ivp(
        rates, (0.0, 2.0), [-0.5, 0.0], "DOP853", rtol=1e-11, atol=1e-11, max_step=0.02
    )
    with robot("n_link_arm", 3) as r:
        r.configure("n", 1)
        r.initialize(kp=kp, kd=kd, position_ref=1.0, q=-0.5, **options)
        r.fmu.doStep(0.0, 2.0)
        found = [r.get("q")[0], r.get("qd")[0]]
    assert np.abs(wanted.y[:, -1] - found).max() < 1e-7
