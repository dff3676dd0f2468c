"""The reference of a bundled model is a function of its inputs and the time, and of nothing else.

A point mass without drag is asked for it: with kp = 1 and q = 0 it is tau_applied, and its motion
under the law has a closed form. Importers set inputs as often as they like, or once.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from scipy.linalg import expm

from tests.plant_fmu.fmpy_instances import Array, Open, Robot
from tests.plant_fmu.test_bundled_models import each_version

POSITION, VELOCITY, ACCELERATION = np.array([[1.0, 2.0], [0.5, -1.0], [4.0, -8.0]])
MASS, KP, KD, END = 2.0, 40.0, 8.0, 2.0
INPUTS = {
    "position_ref": POSITION,
    "velocity_ref": VELOCITY,
    "acceleration_ref": ACCELERATION,
    "reference_time": np.array([0.0]),
}


def position(r: Robot) -> Array:
    return r.get("tau_applied") + r.get("q")


@each_version
@pytest.mark.parametrize("since", [-1.0, 5.0, 5.75, 1e30])
def test_a_reference_moves_on_from_its_time(robot: Open, fmi: int, since: float) -> None:
    with robot("planar_robot", fmi) as r:
        r.initialize(start=5.0, kp=np.eye(2), **INPUTS | {"reference_time": since})
        for t in (5.0, 5.5, 6.0):
            s = max(0.0, t - since)
            wanted = POSITION + s * VELOCITY + s * s / 2 * ACCELERATION
            assert np.allclose(position(r), wanted, rtol=1e-13, atol=1e-13)
            assert np.array_equal(r.get("position_ref"), POSITION)
            r.fmu.doStep(t, 0.5)


@each_version
def test_rates_do_not_depend_on_what_was_evaluated_before(robot: Open, fmi: int) -> None:
    x = np.array([0.4, -1.0, 2.0, 0.3])

    def rates(*before: float) -> Array:
        with robot("planar_robot", fmi, "Model") as r:
            r.initialize(kp=KP * np.eye(2), kd=KD * np.eye(2), **INPUTS)
            r.fmu.enterContinuousTimeMode()
            for t in (*before, 1.0):
                r.set("velocity_ref", np.cos(t) * np.ones(2))
                wanted = r.derivatives(t, x)
            return wanted

    assert np.array_equal(rates(), rates(0.0, 1.5, 3.0))


@each_version
def test_setting_unchanged_inputs_changes_no_bit(robot: Open, fmi: int) -> None:
    ends = []
    for often in (False, True):
        with robot("planar_robot", fmi) as r:
            r.initialize(kp=KP * np.eye(2), kd=KD * np.eye(2), **INPUTS)
            for k in range(20):
                for name, value in INPUTS.items() if often else ():
                    r.set(name, value)
                r.fmu.doStep(k * 0.1, 0.1)
            ends.append(np.concatenate([r.get("q"), r.get("qd")]))
    assert np.array_equal(*ends)


def wanted(moves: bool) -> Array:
    """q at END of m e'' + kd e' + kp e = m a from rest, by the exponential of its matrix."""
    ends = []
    for p, v, a in zip(POSITION, VELOCITY, ACCELERATION, strict=True):
        # Of [q, qd, eps, ups, a]: a reference that stands still has no flow, and its ups stays.
        A = np.zeros((5, 5))
        A[0, 1] = 1.0
        A[1] = np.array([-KP, -KD, KP, KD, 0.0]) / MASS
        if moves:
            A[2, 3] = A[3, 4] = 1.0
        ends.append((expm(A * END) @ [0.0, 0.0, p, v, a])[0])
    return np.array(ends)


@each_version
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
@pytest.mark.parametrize("as_signal", [False, True], ids=["start value", "signal"])
@pytest.mark.parametrize("moves", [False, True], ids=["stands", "moves"])
def test_fmpy_comes_to_the_same_motion_however_it_sets_inputs(
    unpacked: Callable[[str, int], Path], fmi: int, kind: str, as_signal: bool, moves: bool
) -> None:
    # FMPy takes no signals of several shapes at once, so that the time is a start value.
    signals = {name: INPUTS[name] for name in INPUTS if name != "reference_time"}
    values = {"kp": KP * np.eye(2), "kd": KD * np.eye(2), "m": MASS, "d": 0.0}
    values |= {"reference_time": 0.0} if moves else {}
    values |= {} if as_signal else signals
    result = fmpy.simulate_fmu(
        str(unpacked("planar_robot", fmi)),
        fmi_type=kind,
        stop_time=END,
        output_interval=0.1,
        relative_tolerance=1e-9,
        start_values=scalars(values, fmi),
        input=signal(signals, fmi) if as_signal else None,
        output=["q[1]", "q[2]"] if fmi == 2 else ["q"],
    )
    last = np.array(list(result[-1])[1:], float).ravel()
    assert np.allclose(last, wanted(moves), atol=1e-6, rtol=0)


def scalars(values: dict[str, Any], fmi: int) -> dict[str, Any]:
    """The values as FMPy takes them: flat in FMI 3, and of each element in FMI 2."""
    named: dict[str, Any] = {}
    for name, value in values.items():
        array = np.asarray(value)
        if fmi == 3 or not array.shape:
            named[name] = array.ravel() if array.shape else value
            continue
        for index in np.ndindex(array.shape):
            named[f"{name}[{','.join(str(i + 1) for i in index)}]"] = array[index]
    return named


def signal(inputs: dict[str, Array], fmi: int) -> Array:
    """The inputs as signals that are constant."""
    values = scalars(inputs, fmi)
    kinds = [(name, float, np.shape(value)) for name, value in values.items()]
    rows = [(t, *values.values()) for t in (0.0, END)]
    return np.array(rows, dtype=[("time", float), *kinds])
