"""FMUs that other tools export, built here, each of the paper's arm, against DOP853.

Each runs with no mapping at all, within its drive's stated error.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.plant_fmu.bundled.builder import write
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.recordings.export.tables import states
from nrs_cosim.recordings.mcap.reader import Reader
from tests.orchestrator.run_oracle import simulate
from tests.scenarios import paper

HERE = Path(__file__).parent


def python(*arguments, cwd):
    done = subprocess.run(
        [sys.executable, *map(str, arguments)], cwd=cwd, check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


def pythonfmu(folder):
    python("-m", "pythonfmu", "build", "-f", HERE / "pythonfmu_arm.py", "-d", folder,
           HERE / "arm.py", cwd=folder)  # fmt: skip
    return folder / "PythonArm.fmu"


def pythonfmu3(folder):
    python("-m", "pythonfmu3", "build", "-f", HERE / "pythonfmu3_arm.py", "-d", folder,
           HERE / "arm.py", cwd=folder)  # fmt: skip
    return folder / "ServoArm.fmu"


def casadi(folder):
    python(HERE / "casadi_arm.py", folder, cwd=folder)
    return folder / "CasadiArm.fmu"


RNG = np.random.default_rng(4)
NEAR_THE_TARGET = {
    f"initial.{name}": (np.array(target) + RNG.uniform(-0.5, 0.5, (6, 2))).tolist()
    for name, target in {
        "position": [0, -1], "velocity": [3, -2], "q": [0, -1], "qd": [3, -2],
    }.items()
}  # fmt: skip
"""From farther away a held torque's error is that of the first jolt, beyond what is stated."""

CASES = {
    "pythonfmu, torque held": (pythonfmu, {}, 5e-3),
    "pythonfmu3, reference-driven": (pythonfmu3, {"disturbance": None}, 1e-6),
    "CasADi, Model Exchange by CVODE": (casadi, {}, 1e-6),
    "CasADi, Model Exchange by RK4": (casadi, {"plant.solver": "rk4"}, 1e-6),
}


@pytest.mark.parametrize(("build", "change", "bound"), CASES.values(), ids=CASES.keys())
def test_an_arm_exported_by_another_tool_agrees_with_dop853(tmp_path, build, change, bound):
    fmu = build(tmp_path)
    near = {"run.duration": 3.0, "plant.fmu": fmu.name, **NEAR_THE_TARGET}
    file = paper(near, change, folder=tmp_path)
    outcome = run(file, tmp_path / "run.mcap")
    assert outcome.status == "completed", outcome.reason
    with Reader(outcome.path) as reader:
        table, q = beside_the_oracle(reader, 3)
    assert np.abs(table["position"] - q).max() < bound


STILL = {"axes": [{}, {}]}
FLEET = [
    {
        "id": 2,
        "plant": {"fmu": "planar_robot"},
        "initial": {"q": [1.0, 0.5], "qd": [0.0, 0.0]},
        "disturbance": STILL,
    },
    {"id": 3, "plant": {"fmu": "PythonArm.fmu"}},
    {"id": 4, "plant": {"fmu": "ServoArm.fmu"}, "disturbance": STILL},
    {"id": 5, "plant": {"fmu": "CasadiArm.fmu"}},
    {
        "id": 6,
        "plant": {"fmu": "arm2.fmu", "solver": "rk4", "isolate": False},
        "controller": {"kp": 200.0, "kd": [300.0, 300.0]},
    },
]


def test_six_robots_on_five_different_fmus(tmp_path):
    """Each arm is as far off DOP853 as its own drive; the point mass follows its own equation."""
    for build in (pythonfmu, pythonfmu3, casadi):
        build(tmp_path)
    write("two_link_arm", 2, tmp_path / "arm2.fmu")
    fleet = paper({"run.duration": 2.0, "robots": FLEET, **NEAR_THE_TARGET}, folder=tmp_path)
    outcome = run(fleet, tmp_path / "run.mcap")
    assert outcome.status == "completed", outcome.reason
    with Reader(outcome.path) as reader:
        table, q = beside_the_oracle(reader, 2)
        plants = {tuple(p["robots"]): p for p in json.loads(reader.metadata["nrs.run"]["plants"])}
    assert {robots: plant["drive"].split(" for ")[0] for robots, plant in plants.items()} == {
        (1,): "reference-driven Co-Simulation",
        (2,): "reference-driven Co-Simulation",
        (3,): "torque held",
        (4,): "reference-driven Co-Simulation",
        (5,): "Model Exchange, CVODE rtol 1e-09",
        (6,): "Model Exchange, RK4 step 0.005 s",
    }
    assert len({plant["sha256"] for plant in plants.values()}) == 6
    error = np.abs(table["position"] - q).max(axis=(0, 2))
    bounds = {1: 1e-7, 3: 5e-3, 4: 1e-6, 5: 1e-6, 6: 1e-6}
    assert all(error[robot - 1] < bound for robot, bound in bounds.items()), error
    assert np.abs(table["position"][:, 1] - point_mass(table[:, 1])).max() < 1e-7


def beside_the_oracle(reader, seconds):
    """Return the states at t_k, (ticks + 1, robots), beside q of the paper's arms.

    These start as the robots do, and are integrated by DOP853: (ticks + 1, robots, 2).
    """
    table = np.concatenate(list(states(reader)))
    table = table[np.lexsort((table["robot"], table["time_ns"]))].reshape(-1, 6)[::5]
    names = ("reference_position", "reference_velocity", "position", "velocity")
    _, q, _ = simulate(1, 0.9, 1.1, 0.1, seconds, *(table[0][name] for name in names))
    return table, q


def point_mass(rows):
    """Return q at t_k of m q̈ = kp (ε − q) + kd (υ − q̇) − d q̇ under the references recorded."""
    x, story = np.concatenate([rows["position"][0], rows["velocity"][0]]), [rows["position"][0]]
    for k in range(len(rows) - 1):
        velocity = rows["reference_velocity"][k + 1]
        start = rows["reference_position"][k + 1] - 0.1 * velocity

        def rates(t, x, start=start, velocity=velocity):
            effort = 200 * (start + t * velocity - x[:2]) + 300 * (velocity - x[2:])
            return np.concatenate([x[2:], (effort - 0.5 * x[2:]) / 2])

        x = solve_ivp(rates, (0, 0.1), x, method="DOP853", rtol=1e-11, atol=1e-11).y[:, -1]
        story.append(x[:2])
    return np.array(story)


def test_a_start_value_that_the_fmu_does_not_take_is_refused(tmp_path):
    """A derivative can be read for qd, but where it starts cannot be told."""
    casadi(tmp_path)
    derivative = {"qd": {"pattern": "der(q{i})"}}
    file = paper({"plant": {"fmu": "CasadiArm.fmu", "variables": derivative}}, folder=tmp_path)
    with pytest.raises(FmuError, match=r"qd of robot 1 was to start at .*initial\.qd"):
        run(file, tmp_path / "run.mcap")
