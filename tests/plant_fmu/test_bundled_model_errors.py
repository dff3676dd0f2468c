"""What the bundled models refuse: accesses, calls, states, tolerances, and steps that diverge."""

import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fmpy import fmi2
from fmpy.fmi1 import FMICallException

from nrs_cosim.plant_fmu.bundled.declaration import declaration
from tests.plant_fmu.fmpy_instances import Open, Robot
from tests.plant_fmu.test_bundled_models import H, each_version


@each_version
def test_a_state_of_another_fmu_is_refused(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi) as r, robot("two_link_arm", fmi, "Model") as model:
        state = r.fmu.getFMUState()
        bytes_ = bytes(r.fmu.serializeFMUState(state))
        r.fmu.freeFMUState(state)
        refuse = r.fmu.deserializeFMUState
        assert "got 9" in r.refuses(lambda: refuse(bytes_[:9]))
        assert "not one of this FMU" in r.refuses(lambda: refuse(b"x" + bytes_[1:]))
        assert "other kind" in model.refuses(lambda: model.fmu.deserializeFMUState(bytes_))
        assert "no state" in r.refuses(lambda: r.fmu.setFMUState(None))


@each_version
def test_undeclared_accesses_of_variables_are_refused(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi) as r:
        setter = r.fmu.setReal if fmi == 2 else r.fmu.setFloat64
        getter = r.fmu.getReal if fmi == 2 else r.fmu.getFloat64
        assert r.refuses(lambda: getter([9999])) == "no variable has the value reference 9999"
        assert r.refuses(lambda: setter([9999], [1.0])) == (
            "no variable has the value reference 9999"
        )
        assert r.refuses(lambda: r.set("tau", [np.nan, 0.0])) == "setting tau to nan"
        for name in ("time", "der(q)", "tau_applied", "disturbance_terms"):
            value = np.zeros(declaration("two_link_arm").variable(name).size)
            assert r.refuses(lambda name=name, value=value: r.set(name, value)) == (
                f"setting {name} is not allowed before initialization"
            )
        r.initialize()
        for name in ("q", "m1"):
            value = np.zeros(declaration("two_link_arm").variable(name).size)
            assert r.refuses(lambda name=name, value=value: r.set(name, value)) == (
                f"setting {name} is not allowed in step mode"
            )


@each_version
def test_a_set_that_is_refused_leaves_no_trace(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi) as r:
        setter = r.fmu.setReal if fmi == 2 else r.fmu.setFloat64
        names = ["tau", "position_ref", "m1"]
        references = [reference for name in names for reference in r.references(name)]
        before = saved(r)
        for last in (np.nan, -1.0, np.inf):
            r.refuses(lambda last=last: setter(references, [1.0, 2.0, 3.0, 4.0, last]))
            assert saved(r) == before
        assert r.said[-2] == "m1: expected 0 to inf, got -1"


def saved(r: Robot) -> bytes:
    state = r.fmu.getFMUState()
    serialized = bytes(r.fmu.serializeFMUState(state))
    r.fmu.freeFMUState(state)
    return serialized


@each_version
def test_altered_states_are_refused(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi) as r:
        r.initialize(tau=[1.25, 2.0], relative_tolerance=1e-7)
        r.fmu.doStep(0.0, H)
        whole = saved(r)

        def altered(old: bytes, new: bytes) -> Callable[[], None]:
            assert whole.count(old) == 1
            return lambda: r.fmu.deserializeFMUState(whole.replace(old, new))

        def number(value: float) -> bytes:
            return np.array(value).tobytes()

        step_mode = (16).to_bytes(4, sys.byteorder)
        kind_and_mode = (1).to_bytes(4, sys.byteorder) + step_mode
        for mode in (0, 4, 48, 64, 12345, -1 % 2**32):
            bad = kind_and_mode[:4] + mode.to_bytes(4, sys.byteorder)
            assert "the state has the mode" in r.refuses(altered(kind_and_mode, bad))
        for bad in (np.nan, np.inf):
            assert "setting tau" in r.refuses(altered(number(1.25), number(bad)))
        assert "relative_tolerance: expected" in r.refuses(altered(number(1e-7), number(0.0)))
        assert "the time nan" in r.refuses(altered(number(H), number(np.nan)))
        assert saved(r) == whole


@each_version
def test_what_a_state_claims_of_calculated_numbers_is_not_trusted(robot: Open, fmi: int) -> None:
    with robot("planar_robot", fmi) as r:
        r.initialize(disturbance_amplitude=np.ones((2, 8)), disturbance_offset=[3.0, 0.0])
        r.fmu.doStep(0.0, H)
        whole = saved(r)
        eight = np.array([8.0, 8.0]).tobytes()
        assert whole.count(eight) == 1
        for claim in (1e6, np.nan, -1.0):
            bad = whole.replace(eight, np.array([claim, claim]).tobytes())
            r.fmu.setFMUState(r.fmu.deserializeFMUState(bad))
            assert r.get("disturbance_terms").tolist() == [8.0, 8.0]


@each_version
def test_nothing_is_computed_past_the_stop_time(robot: Open, fmi: int) -> None:
    def stopping(r: Robot, start: float, stop: float) -> None:
        if fmi == 2:
            r.fmu.setupExperiment(startTime=start, stopTime=stop)
            r.fmu.enterInitializationMode()
        else:
            r.fmu.enterInitializationMode(startTime=start, stopTime=stop)

    with robot("planar_robot", fmi) as r:
        assert "stop time is 0" in r.refuses(lambda: stopping(r, 1.0, 0.0))
        stopping(r, 0.0, 0.3)
        r.fmu.exitInitializationMode()
        before = saved(r)
        message = r.refuses(lambda: r.fmu.doStep(0.0, 0.4))
        assert message == "a step to t = 0.40000000000000002 s, past the stop time " + (
            "0.29999999999999999 s"
        )
        assert saved(r) == before
        time = 0.0
        for _ in range(3):
            r.fmu.doStep(time, 0.1)
            time += 0.1  # 0.30000000000000004 in the end
    with robot("planar_robot", fmi, "Model") as r:
        stopping(r, 0.0, 0.3)
        r.fmu.exitInitializationMode()
        r.fmu.enterContinuousTimeMode()
        r.derivatives(0.4, np.zeros(4))  # a solver may look ahead
        assert "past the stop time" in r.refuses(r.fmu.completedIntegratorStep)
        assert "past the stop time" in r.refuses(r.fmu.enterEventMode)


@each_version
def test_calls_in_the_wrong_state_are_refused(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi) as r:
        step = r.fmu.doStep
        assert r.refuses(lambda: step(0.0, H)) == "a step is not allowed before initialization"
        assert "leaving initialization" in r.refuses(r.fmu.exitInitializationMode)
        r.initialize()
        assert "entering init" in r.refuses(r.fmu.enterInitializationMode) or fmi == 3
        assert "the instance is at t = 0 s" in r.refuses(lambda: step(0.5, H))
        for h in (0.0, -H, np.nan, np.inf):
            assert "does not advance time" in r.refuses(lambda h=h: step(0.0, h))
        r.fmu.terminate()
        assert r.refuses(lambda: step(0.0, H)) == "a step is not allowed after termination"
    with robot("two_link_arm", fmi, "Model") as r:
        assert "continuous-time" in r.refuses(r.fmu.enterContinuousTimeMode)
        r.initialize()
        assert "3" in r.refuses(lambda: r.fmu.getContinuousStates((fmi2.fmi2Real * 3)(), 3))


@each_version
def test_unknown_value_references_are_refused(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi) as r:
        getter = r.fmu.getInteger if fmi == 2 else r.fmu.getInt32
        assert "no variables of type" in r.refuses(lambda: getter([0]))
        assert "no directional" in r.refuses(
            lambda: r.fmu.getDirectionalDerivative([1], [2], [1.0])
        )
        if fmi == 3:
            assert "no clocks" in r.refuses(lambda: r.fmu.getClock([0]))


@each_version
def test_the_instantiation_token_of_another_fmu_is_refused(
    unpacked: Callable[[str, int], Path], fmi: int
) -> None:
    with pytest.raises(Exception, match="Failed to instantiate"):
        Robot("two_link_arm", fmi, unpacked("two_link_arm", fmi), "Slave", token="another")


@each_version
def test_a_null_instance_is_an_error(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi) as r:
        component, r.fmu.component = r.fmu.component, None
        for call in (
            lambda: r.fmu.doStep(0.0, H),
            lambda: r.get("q"),
            lambda: r.set("tau", [0.0, 0.0]),
            r.fmu.getFMUState,
            r.fmu.reset,
        ):
            with pytest.raises(FMICallException, match=r"\(error\)"):
                call()
        r.fmu.component = component


@each_version
def test_a_diverging_step_reports_the_time(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi) as r:
        r.initialize(J1=0.0, J2=0.0, m1=0.0, m2=0.0)
        assert r.refuses(lambda: r.fmu.doStep(0.0, H)) == "at t = 0 s: a derivative is not finite"
    with robot("planar_robot", fmi) as r:
        r.initialize(d=-1e4, qd=[1.0, 1.0])
        message = r.refuses(lambda: r.fmu.doStep(0.0, 1.0))
        assert message.startswith("at t = 0.1")
        assert message.endswith("a derivative is not finite")
        assert np.isfinite(r.get("qd")).all()


@each_version
def test_a_step_that_never_ends_is_aborted(robot: Open, fmi: int) -> None:
    with robot("planar_robot", fmi) as r:
        r.initialize(integrator=8.0, kd=1e12 * np.eye(2), qd=[1.0, 1.0])
        message = r.refuses(lambda: r.fmu.doStep(0.0, 1000.0))
        assert "too many internal steps" in message
        assert np.isfinite(r.get("qd")).all()


@each_version
def test_an_impossible_tolerance_is_refused(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi) as r:
        assert r.refuses(lambda: r.initialize(relative_tolerance=1e-20)) == (
            "relative_tolerance: expected 1e-14 to 1, got 1e-20"
        )


@each_version
def test_a_non_finite_derivative_is_named_by_its_joint_from_one(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi, "Model") as r:
        r.initialize()
        r.fmu.enterContinuousTimeMode()
        x = np.array([0.0, 1.0, 0.0, 1e200])
        message = r.refuses(lambda: r.derivatives(1.5, x))
        assert re.fullmatch(r"at t = 1\.5 s: derivative 3 of 4 is -?(inf|nan)", message)
