"""An FMU that nothing drives: a mass under sines, whose motion is known in closed form.

m = 1, no drag, and the force [−sin t, cos t] from q = [0, −1], q̇ = [3, −2]: the paper's target.
"""

import re
import shutil

import numpy as np
import pytest

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.plant_fmu.archives.archive import find_archive, open_archive
from nrs_cosim.plant_fmu.archives.families import NamePattern
from nrs_cosim.plant_fmu.errors import FmuError, StepError
from nrs_cosim.plant_fmu.motion import fmu_motion
from tests.guard import LIMIT
from tests.orchestrator.run_oracle import target
from tests.plant_fmu import hinge
from tests.plant_fmu.faulty_fmu import FAULTS
from tests.plant_fmu.fmpy_instances import Robot
from tests.plant_fmu.rewritten_fmus import renamed, rewritten

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

TIMES = [0.025 * j for j in range(401)]
PARAMETERS = {
    "q": [0.0, -1.0],
    "qd": [3.0, -2.0],
    "m": 1.0,
    "d": 0.0,
    "disturbance_amplitude": [[-1.0, *[0.0] * 7], [1.0, *[0.0] * 7]],
    "disturbance_frequency": [[1.0, *[0.0] * 7], [1.0, *[0.0] * 7]],
    "disturbance_phase": [[0.0] * 8, [np.pi / 2, *[0.0] * 7]],
    "relative_tolerance": 1e-12,
}
NAMES = {"position": "q", "velocity": "qd"}
DEADLINE = 30.0


def expected(times=TIMES):
    return np.moveaxis([np.array(target(t)) for t in times], 1, 0)


def only(kind, text):
    """Leave an interface alone in a description."""
    other = {"CoSimulation": "ModelExchange", "ModelExchange": "CoSimulation"}[kind]
    short = re.sub(rf"<{other} [^>]*/>", "", text)
    return re.sub(rf"<{other} [^>]*[^/]>.*?</{other}>", "", short, flags=re.DOTALL)


def test_a_bundled_models_motion_agrees_with_its_formula():
    moved = fmu_motion(find_archive("planar_robot", None), PARAMETERS, NAMES, TIMES, None)
    np.testing.assert_allclose(moved, expected(), rtol=0, atol=1e-10)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(("kind", "error"), [("CoSimulation", 1e-10), ("ModelExchange", 1e-9)])
def test_the_motion_of_a_third_party_fmu_is_found_by_variable_name(tmp_path, fmi, kind, error):
    """`lead.position` and `lead.velocity`: scalars in FMI 2, arrays in FMI 3."""

    def edit(text):
        for ours, theirs in (("position", "q"), ("velocity", "qd")):
            text = re.sub(rf'name="{theirs}(["\[])', rf'name="lead.{ours}\1', text)
        return only(kind, text)

    path = rewritten(tmp_path / "lead.fmu", fmi, edit, "planar_robot")
    given = {
        {"q": "lead.position", "qd": "lead.velocity"}.get(name, name): value
        for name, value in PARAMETERS.items()
    }
    archive = open_archive(path)
    assert archive.kinds == (kind,)
    assert not archive.ours
    moved = fmu_motion(archive, given, {}, TIMES, DEADLINE)
    np.testing.assert_allclose(moved, expected(), rtol=0, atol=error)


def test_the_motion_has_the_bits_of_the_fmus_outputs(unpacked):
    """FMPy, stepped from time to time, to the last bit."""
    moved = fmu_motion(find_archive("planar_robot", None), PARAMETERS, NAMES, TIMES, None)
    robot = Robot("planar_robot", 3, unpacked("planar_robot", 3), "Slave")
    robot.initialize(**PARAMETERS)
    for row, t in enumerate(TIMES):
        if row:
            before = TIMES[row - 1]
            robot.fmu.doStep(before, t - before)
        assert robot.get("q").tolist() == moved[0][row].tolist()
        assert robot.get("qd").tolist() == moved[1][row].tolist()
    robot.fmu.freeInstance()


@pytest.mark.parametrize("fmi", [2, 3])
def test_events_of_model_exchange_are_handled(tmp_path, fmi):
    """A joint under tau = 3, whose inertia doubles at t = 0.4 s; and one that ends the run."""
    archive = open_archive(hinge.build(fmi, tmp_path))
    times = [0.05 * j for j in range(17)]
    parameters = {"tau": 3.0, "load": 1.0, "t_load": 0.4}
    q, qd = fmu_motion(archive, parameters, NAMES, times, None)
    t = np.array(times)
    late = np.maximum(t - 0.4, 0)
    np.testing.assert_allclose(qd[:, 0], 3 * t - 1.5 * late, rtol=0, atol=1e-9)
    np.testing.assert_allclose(q[:, 0], 1.5 * t**2 - 0.75 * late**2, rtol=0, atol=1e-9)
    with pytest.raises(StepError, match=r"target \(.*\) at t = .*the FMU ended the simulation"):
        fmu_motion(archive, {"end": 1.0, "t_load": 0.2}, NAMES, times, None)


def test_a_velocity_may_be_the_derivative_of_the_position(tmp_path):
    def edit(text):
        text = renamed(text, lambda stem, i: {"q": "position"}.get(stem, stem) + f"[{i[0]}]")
        return text.replace("der(q[", "der(position[")

    path = rewritten(tmp_path / "lead.fmu", 2, edit)
    moved = fmu_motion(open_archive(path), {"position": [0.3, 0.0]}, {}, [0.0, 0.1, 0.2], None)
    other = fmu_motion(
        find_archive("two_link_arm", None), {"q": [0.3, 0.0]}, NAMES, [0.0, 0.1, 0.2], None
    )
    np.testing.assert_allclose(moved, other, rtol=0, atol=1e-8)
    assert np.abs(moved[1]).max() > 0.1


BAD = {
    "nothing is found": ({}, "has no variable 'position'"),
    "no such velocity": ({"position": "q", "velocity": "speed"}, "has no variable 'speed'"),
    "what to write": ({}, "Write in the scenario's [target]: variables.position = "),
    "an input": (
        {"position": "position_ref"},
        "variables.position = position_ref: an input, which nothing sets",
    ),
    "another size": (
        {"position": "q", "velocity": NamePattern("disturbance_amplitude[{i}]")},
        "has no variable 'disturbance_amplitude[{i}]'",
    ),
    "too few": (
        {"position": "q", "velocity": "qd[0:1]"},
        "velocity takes 2 numbers here, but the FMU has 1",
    ),
    "a force": (
        {"position": "tau", "velocity": "qd"},
        "'tau' for position is in 'N': expected rad",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_wrong_target_variables_are_named(case):
    names, message = BAD[case]
    with pytest.raises(FmuError) as error:
        fmu_motion(find_archive("planar_robot", None), {}, names, TIMES, None)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("segfault", "at t = 0.5 s: the FMU crashed with SIGSEGV, in step"),
        ("hang", f"did not return within {LIMIT:g} s (target.deadline), in step"),
        ("nan", "its outputs are not finite: [nan, "),
        ("end", "ended with the wish to end the simulation"),
    ],
)
def test_an_error_of_the_fmu_is_an_error_of_the_target(faulty, tmp_path, fault, cause):
    shutil.copy(faulty, tmp_path / "faulty.fmu")
    parameters = {"fault": FAULTS.index(fault), "fault_time": 0.55}
    times = [0.0, 0.25, 0.5, 0.75]
    with pytest.raises(StepError) as error:
        fmu_motion(open_archive(tmp_path / "faulty.fmu"), parameters, NAMES, times, LIMIT)
    assert "target (" in str(error.value)
    assert cause in str(error.value)


def test_an_error_before_the_first_step_is_bad_input(faulty, tmp_path):
    shutil.copy(faulty, tmp_path / "faulty.fmu")
    parameters = {"fault": FAULTS.index("segfault"), "fault_time": -1.0}
    with pytest.raises(CosimError, match=r"target: the FMU crashed with SIGSEGV"):
        fmu_motion(open_archive(tmp_path / "faulty.fmu"), parameters, NAMES, [0.0, 1.0], LIMIT)


def test_inputs_of_a_target_fmu_keep_their_start_values():
    """An arm that nobody drives falls from where it is held: q̈ = −M⁻¹ G at first."""
    archive = find_archive("two_link_arm", None)
    moved = fmu_motion(archive, {"q": [0.3, 0.0]}, NAMES, [0.0, 1e-3], None)
    mass = np.array([[2 + 0.96 + 2.4 + 5, 0.96 + 1.2], [0.96 + 1.2, 0.96 + 5]])
    gravity = 9.8 * np.cos(0.3) * np.array([2 + 1.2, 1.2])
    np.testing.assert_allclose(moved[1][1], -np.linalg.solve(mass, gravity) * 1e-3, rtol=1e-5)
