"""A target that is an FMU: what its samples say of a velocity that is not its position's."""

import shutil
from math import pi

import numpy as np
import pytest

from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.orchestrator.scenario.smoothness import expect_smooth
from nrs_cosim.plant_fmu.errors import FmuError
from tests.cases import cases
from tests.plant_fmu import hinge
from tests.scenarios import write


def compared(motion, step=0.1, end=2.0):
    """Return what is said of a motion t -> (position, velocity), and the times of all samples."""
    asked = []

    def sample(times):
        asked.append(times)
        rows = np.array([motion(t) for t in times])
        return rows[:, :1], rows[:, 1:]

    times = [k * step for k in range(round(end / step) + 1)]
    moved = sample(times)
    try:
        expect_smooth("ball.fmu", times, *moved, sample)
    except FmuError as error:
        return str(error), asked
    return "", asked


def bouncing(at, before=-1.0, after=0.5):
    """Return a motion whose velocity jumps."""
    return lambda t: (before * (t - at), before) if t < at else (after * (t - at), after)


@pytest.mark.parametrize("at", [0.749, 0.75, 0.7512, 0.8])
@pytest.mark.parametrize("step", [0.1, 0.01, 0.001])
def test_a_velocity_jump_is_reported_with_its_time(at, step):
    message, _ = compared(bouncing(at), step)
    assert message.startswith("ball.fmu: velocity_1 at t = ")
    assert "velocity_1 jumps from -1 to 0.5 at t = 0." in message
    assert message.endswith("; a target must be continuously differentiable")
    assert "step" not in message
    time = float(message.partition("0.5 at t = ")[2].partition(" s;")[0])
    assert time == pytest.approx(at, abs=step / 512 + 1e-6)


@pytest.mark.parametrize("step", [0.02, 0.01])
def test_a_position_in_stairs_is_reported_as_a_jump(step):
    def motion(t):
        stair = np.floor(t / 0.1 + 1e-9) * 0.1
        return np.exp(-stair), -np.exp(-stair)

    message, _ = compared(motion, step)
    assert "position_1 jumps from 1 to 0.904837 at t = 0.0" in message
    assert message.endswith(
        "as it does where an FMU steps at times of its own; a target must be continuously "
        "differentiable"
    )


def test_a_shorter_step_is_advised_only_where_it_helps():
    def motion(t):
        return np.sin(2 * pi * t), 2 * pi * np.cos(2 * pi * t)

    message, _ = compared(motion, 0.2)
    assert message.endswith("; take a shorter target.step: 0.05 s")
    assert compared(motion, 0.05) == ("", [[k * 0.05 for k in range(41)]])


def test_a_step_still_too_long_is_reported():
    def motion(t):
        return np.sin(20 * pi * t + 0.1) / 20, pi * np.cos(20 * pi * t + 0.1)

    message, asked = compared(motion, 0.09, 1.8)
    assert message.endswith("; take a shorter target.step: 0.0225 s or less")
    assert np.diff(asked[-1]) == pytest.approx(0.0225)


@pytest.mark.parametrize("step", [0.1, 0.01])
def test_an_unrelated_velocity_asks_for_the_variables(step):
    message, _ = compared(lambda t: (np.sin(t), np.sin(t)), step)
    assert message.endswith("; name them in target.variables")


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
@pytest.mark.parametrize("fmi", cases([2, 3], [2]))
def test_an_fmu_that_bounces_off_a_wall_is_refused_as_target(tmp_path, fmi):
    hinge.build(fmi, tmp_path)
    target = {
        "kind": "fmu",
        "fmu": f"hinge{fmi}.fmu",
        "variables": {"position": "q", "velocity": "qd"},
        "parameters": {"wall": 1.0, "q": 1.0, "qd": -0.8},
    }
    with pytest.raises(ScenarioError) as error:
        read_scenario(write(tmp_path / "s.toml", {"target": target}))
    message = str(error.value)
    assert f"s.toml: target.fmu: {tmp_path}/hinge{fmi}.fmu: velocity_1 at t = " in message
    assert "velocity_1 jumps from -0.8 to 0.4 at t = 1.2" in message


def test_without_resampling_both_remedies_are_named():
    times = [0.0, 1.0, 2.0]
    still, moving = np.zeros((3, 1)), np.ones((3, 1))
    with pytest.raises(
        FmuError, match=r"; take a shorter target.step, or name them in target.variables"
    ):
        expect_smooth("ball.fmu", times, still, moving, None)
