"""FMUs from URDF files against Newton and Euler, written once more in numpy in world axes."""

import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from numpy.typing import NDArray

from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import experiment_of, measure
from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.archives.variables import find_quantity, joints_of
from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
from nrs_cosim.plant_fmu.bundled.urdf_fmu import GRAVITY, build_urdf
from nrs_cosim.plant_fmu.checking import subprocess_check
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.plants import Body, Control, Disturbance
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.command import nrs
from tests.plant_fmu.equations import Equations
from tests.plant_fmu.newton_euler import Oracle
from tests.plant_fmu.test_rigid_body import TURNING_SLIDER
from tests.scenarios import paper

Array = NDArray[np.float64]
CHECK_BUILT = subprocess_check.check_built
ROBOTS = Path(__file__).with_name("robots")
IIWA = ROBOTS / "lbr_iiwa_14.urdf"
ARM = ROBOTS / "two_link_arm.urdf"
GANTRY = ROBOTS / "gantry.urdf"
VERSIONS = (2, 3)


@pytest.fixture(scope="module", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    pytest.importorskip(
        "nrs_cosim.plant_fmu.bundled.rigid_body", reason="needs the packages of the extra urdf"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NRS_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


# The FMU as equations


Open = Callable[..., Equations]


@pytest.fixture
def equations(tmp_path: Path) -> Iterator[Open]:
    with ExitStack() as stack:

        def opened(path: Path, fmi: int = 3, gravity: Any = GRAVITY) -> Equations:
            folder = tmp_path / f"{path.stem}{fmi}"
            opened = Equations(build_urdf(read_urdf(path), fmi, gravity), folder)
            stack.callback(opened.fmu.freeInstance)
            return opened

        yield opened


def states(m: int, n: int) -> Iterator[tuple[Array, Array, Array]]:
    random = np.random.default_rng(14)
    for _ in range(n):
        yield random.uniform(-3, 3, m), random.uniform(-2, 2, m), random.uniform(-50, 50, m)


# The dynamics


@pytest.mark.parametrize("fmi", cases(VERSIONS, VERSIONS[-1:]))
@pytest.mark.parametrize("path", cases([ARM, IIWA, GANTRY], [IIWA]), ids=lambda path: path.stem)
def test_accelerations_agree_with_newton_euler(equations: Open, path: Path, fmi: int) -> None:
    oracle, fmu = Oracle(path), equations(path, fmi)
    for q, qd, tau in states(len(oracle.axes), 20):
        wanted = oracle.acceleration(q, qd, tau)
        error = np.abs(fmu.acceleration(q, qd, tau) - wanted).max()
        assert error <= 1e-11 * np.abs(wanted).max()


def test_the_two_link_arm_agrees_with_its_closed_form(equations: Open) -> None:
    m1, m2, r1, r2, J1, J2, g = 0.5, 1.5, 1.0, 0.8, 5.0, 5.0, 9.80665
    fmu = equations(ARM)
    for q, qd, tau in states(2, 20):
        c2, s2 = np.cos(q[1]), np.sin(q[1])
        M12 = m2 * r2**2 + m2 * r1 * r2 * c2 + J2
        M11 = (m1 + m2) * r1**2 + J1 + m2 * r1 * r2 * c2 + M12
        M = np.array([[M11, M12], [M12, m2 * r2**2 + J2]])
        b = m2 * r1 * r2 * s2
        C = np.array([[-b * qd[1], -b * (qd[0] + qd[1])], [b * qd[0], 0.0]])
        G2 = m2 * g * r2 * np.cos(q[0] + q[1])
        G = np.array([(m1 + m2) * g * r1 * np.cos(q[0]) + G2, G2])
        wanted = np.linalg.solve(M, tau - C @ qd - G)
        np.testing.assert_allclose(fmu.acceleration(q, qd, tau), wanted, rtol=1e-12, atol=1e-12)


def test_mass_gravity_and_bias_of_a_published_arm_agree(equations: Open) -> None:
    """M from the responses to unit torques, G and h from those to none."""
    oracle, fmu = Oracle(IIWA), equations(IIWA)
    zero = np.zeros(7)
    for q, qd, _ in states(7, 10):
        M = oracle.mass_matrix(q)
        free = fmu.acceleration(q, zero, zero)
        responses = np.column_stack([fmu.acceleration(q, zero, e) - free for e in np.eye(7)])
        np.testing.assert_allclose(M @ responses, np.eye(7), atol=1e-9)
        np.testing.assert_allclose(responses, responses.T, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(-M @ free, oracle.force(q, zero, zero), atol=1e-9)
        bias = oracle.force(q, qd, zero) + 0.5 * qd
        np.testing.assert_allclose(-M @ fmu.acceleration(q, qd, zero), bias, atol=1e-9)


def test_a_published_arm_holds_its_weight_within_the_efforts_of_its_joints() -> None:
    """Gravity by Newton and Euler; the URDF lets joints apply 300 N m."""
    archive = open_archive(build_urdf(read_urdf(IIWA)))
    for q, qd, _ in states(7, 2):
        weightless = Control(gravity_compensation=True, limited_by_effort=True)
        weight = Oracle(IIWA).force(q, 0 * qd, 0 * qd)
        with ExitStack() as stack:
            still = replace(passive(q, 0 * qd), control=weightless)
            plants = open_plants(stack, archive, [still], {})
            np.testing.assert_allclose(plants.tau[0], weight, atol=1e-9)
            plants.advance(0.0, 0.5)
            np.testing.assert_allclose(plants.q[0], q, atol=1e-8)
        with ExitStack() as stack:
            pulled = replace(still, kp=1e4 * np.eye(7), position=q + np.sign(qd))
            plants = open_plants(stack, archive, [pulled], {})
            assert plants.tau[0].tolist() == (300 * np.sign(qd)).tolist()


def test_gravity_has_the_given_direction(equations: Open) -> None:
    oracle, gravity = Oracle(ARM), (1.5, 0.3, -2.0)
    fmu = equations(ARM, gravity=gravity)
    for q, qd, tau in states(2, 5):
        wanted = oracle.acceleration(q, qd, tau, gravity)
        np.testing.assert_allclose(fmu.acceleration(q, qd, tau), wanted, rtol=1e-12)


def passive(q: Array, qd: Array) -> Body:
    m, zero = len(q), np.zeros(len(q))
    none = Disturbance(zero, zero, *np.zeros((3, m, 0)))
    return Body(1, {}, np.zeros((m, m)), np.zeros((m, m)), none, q, qd, zero, zero)


def test_without_torque_and_damping_energy_is_conserved(tmp_path: Path) -> None:
    path = tmp_path / "undamped.urdf"
    path.write_text(IIWA.read_text("utf-8").replace('damping="0.5"', ""), "utf-8")
    oracle = Oracle(path)
    q, qd, _ = next(states(7, 1))
    with ExitStack() as stack:
        archive = open_archive(build_urdf(read_urdf(path)))
        plants = open_plants(stack, archive, [passive(q, qd)], {})
        energies = [oracle.energy(q, qd)]
        for k in range(20):
            plants.advance(k * 0.05, 0.05)
            energies.append(oracle.energy(plants.q[0], plants.qd[0]))
    assert not np.allclose(plants.q[0], q, atol=0.1)
    assert np.ptp(energies) < 1e-6 * np.ptp([oracle.energy(q, 0 * qd), *energies])


# The archive


@pytest.mark.parametrize("fmi", VERSIONS)
def test_fmpy_validates_the_model(fmi: int) -> None:
    path = build_urdf(read_urdf(GANTRY), fmi)
    assert validate_fmu(str(path)) == []
    description = fmpy.read_model_description(path)
    assert description.modelName == "robot_3_armed_gantry"
    assert "joint limits and dry friction left out" in description.description
    q = next(v for v in description.modelVariables if v.name in {"q", "q[1]"})
    assert q.description == "position (right wrist, left slide, bridge, left pivot)"
    assert q.unit is None
    units = {v.name: v.unit for v in description.modelVariables}
    assert units["time"] == "s"


@pytest.mark.parametrize("fmi", VERSIONS)
def test_an_fmu_names_its_joints_and_their_kinds(fmi: int) -> None:
    archive = open_archive(build_urdf(read_urdf(GANTRY), fmi))
    named = joints_of(archive, find_quantity(archive, "q"))
    names = ["right wrist", "left slide", "bridge", "left pivot"]
    kinds = {joint.name: joint.kind for joint in read_urdf(GANTRY).joints}
    units = ["m" if kinds[name] == "prismatic" else "rad" for name in names]
    assert [(joint.name, joint.unit) for joint in named] == list(zip(names, units, strict=True))
    assert set(units) == {"rad", "m"}
    assert archive.urdf == read_urdf(GANTRY).text.decode()


def test_units_follow_the_joints() -> None:
    description = fmpy.read_model_description(build_urdf(read_urdf(IIWA)))
    units = {v.name: v.unit for v in description.modelVariables}
    assert (units["q"], units["tau"], units["kd"]) == ("rad", "N.m", "N.m.s/rad")


def test_a_rebuild_is_the_same_bytes(tmp_path: Path) -> None:
    program = (
        "import sys; from pathlib import Path; "
        "from nrs_cosim.plant_fmu.bundled.urdf import read_urdf; "
        "from nrs_cosim.plant_fmu.bundled.urdf_fmu import build_urdf; "
        "print(build_urdf(read_urdf(Path(sys.argv[1]))))"
    )
    built = []
    for seed in ("1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", program, str(GANTRY)],
            env={**os.environ, "NRS_CACHE": str(tmp_path / seed), "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        )
        built.append(Path(done.stdout.strip()))
    assert built[0].name == built[1].name
    assert built[0].read_bytes() == built[1].read_bytes()
    with zipfile.ZipFile(built[0]) as archive:
        assert b"forward_dynamics" in archive.read("sources/dynamics.c")
        assert not any(str(tmp_path).encode() in archive.read(name) for name in archive.namelist())


# The arm among others


def sine(amplitude: float, frequency: float) -> dict[str, list[dict[str, float]]]:
    return {"sines": [{"amplitude": amplitude, "frequency": frequency}]}


ARMS = {
    "run": {"duration": 12.0, "sampling_period": 0.1, "output_step": 0.05, "seed": 1},
    "controller": {
        "kp": [6000, 12000, 4000, 6000, 1000, 1000, 200],
        "kd": [600, 1200, 300, 400, 50, 30, 3],
    },
    "network": {"adjacency": [[0, 1, 0], [0, 0, 0], [1, 0, 0]], "pinning": [0, 1, 0]},
    "target.axes": [
        sine(0.5, 0.4),
        {"offset": 0.5, **sine(0.2, 0.5)},
        {"cosines": [{"amplitude": 0.3, "frequency": 0.3}]},
        {"offset": -1.2, **sine(0.3, 0.4)},
        sine(0.4, 0.6),
        {"offset": 0.8},
        {"rate": 0.1},
    ],
    "plant.fmu": "arm.fmu",
    "disturbance": None,
    "initial": {
        "position": {"uniform": [-0.5, 0.5]},
        "velocity": {"uniform": [-0.1, 0.1]},
        "q": {"uniform": [-0.5, 0.5]},
        "qd": {"uniform": [-0.1, 0.1]},
    },
}


def test_the_arm_runs_under_the_papers_algorithm(tmp_path: Path) -> None:
    """The gains hold the arm against gravity to some hundredths of a radian: |e| <= |G| / kp."""
    (tmp_path / "arm.fmu").write_bytes(build_urdf(read_urdf(IIWA)).read_bytes())
    outcome = run(paper(ARMS, folder=tmp_path), tmp_path / "run.mcap")
    assert (outcome.status, outcome.ticks) == ("completed", 120)
    with Reader(outcome.path) as reader:
        measured = measure(reader, experiment_of(reader))
    assert measured.position_estimate < 0.01
    assert measured.position_tracking < 0.02


# The command


def test_the_command_writes_an_fmu_and_warns(tmp_path: Path) -> None:
    output = tmp_path / "gantry.fmu"
    done = nrs("fmu", "from-urdf", str(GANTRY), "-o", str(output), "--fmi", "2")
    assert (done.returncode, done.stdout) == (0, f"{output}\n")
    assert done.stderr == (
        f"warning: {GANTRY}: joint 'left slide': its dry friction of 0.1 is left out (--friction)\n"
    )
    assert output.read_bytes() == build_urdf(read_urdf(GANTRY), 2).read_bytes()
    result = json.loads(nrs("fmu", "info", str(output), "--json").stdout)
    assert (result["name"], result["fmi_version"]) == ("robot_3_armed_gantry", "2.0")
    assert result["kinds"] == ["CoSimulation", "ModelExchange"]
    rows = {row.pop("name"): [*row.values()] for row in result["joints"]}
    assert rows == {
        "right wrist": [1, "continuous", "rad", None, None, None, None, None],
        "left slide": [2, "prismatic", "m", 0, 0.5, 10, 1, None],
        "bridge": [3, "prismatic", "m", None, None, 100, 1, None],
        "left pivot": [4, "revolute", "rad", -1, 1, 10, 1, None],
    }
    table = nrs("fmu", "info", str(output)).stdout.split("\n\n")[1]
    assert "position (joints 1-4)" in table
    assert "left slide" not in table


def test_a_urdf_that_fails_the_check_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The slider turns, and what generates its equations is made to forget all velocities."""
    from nrs_cosim.plant_fmu.bundled.rigid_body import _Tree  # noqa: PLC0415

    bias = _Tree.bias
    monkeypatch.setattr(_Tree, "bias", lambda tree, Qd, gravity: bias(tree, 0 * Qd, gravity))
    slider, output = tmp_path / "slider.urdf", tmp_path / "slider.fmu"
    slider.write_text(TURNING_SLIDER.format(f"0 {np.pi / 2} 0", "0 0 1"), "utf-8")
    done = nrs("fmu", "from-urdf", slider, "-o", output, "--gravity", "0,0,0")
    assert (done.returncode, done.stdout) == (1, "")
    wrong = "its FMU is not written, for 'power' does not hold: gains power that no torque gives"
    assert done.stderr.startswith(f"error: {slider}: {wrong}")
    assert not output.exists()


def test_an_fmu_that_takes_long_to_check_is_written_with_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patched = partial(CHECK_BUILT, deadline=0.0)
    monkeypatch.setattr(subprocess_check, "check_built", patched)
    output = tmp_path / "arm.fmu"
    done = nrs("fmu", "from-urdf", ARM, "-o", output)
    assert (done.returncode, done.stdout) == (0, f"{output}\n")
    unknown = "its FMU was not checked for 'mechanics': the check was not over after 0 s"
    assert done.stderr == f"warning: {ARM}: {unknown}\n"
    assert output.is_file()


def test_a_robot_that_is_too_stiff_to_be_stepped_is_written_with_a_warning(tmp_path: Path) -> None:
    """A finger of 1e-9 kg m2 and a damping of 1 N m s: 1e9 per s, as in many files of grippers."""
    body = '<mass value="1e-3"/><inertia ixx="1e-9" ixy="0" ixz="0" iyy="1e-9" iyz="0" izz="1e-9"/>'
    finger, output = tmp_path / "finger.urdf", tmp_path / "finger.fmu"
    finger.write_text(
        f'<robot name="finger"><link name="a"/><link name="b"><inertial>{body}</inertial></link>'
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        '<dynamics damping="1"/></joint></robot>',
        "utf-8",
    )
    done = nrs("fmu", "from-urdf", finger, "-o", output)
    assert (done.returncode, done.stdout) == (0, f"{output}\n")
    warnings = done.stderr.splitlines()
    assert warnings
    assert all(line.startswith(f"warning: {finger}: its FMU ") for line in warnings)
    assert output.is_file()


def test_a_crash_of_the_check_is_a_failure() -> None:
    """An archive that is gone when the check begins ends its process."""
    archive = open_archive(build_urdf(read_urdf(ARM)))
    checked = CHECK_BUILT(CheckTask(replace(archive, path=archive.path.with_name("gone.fmu"))))
    assert not checked.passes


@pytest.mark.parametrize("gravity", ["0,0", "0,0,nan", "0,0,1_0", "0,0,١"])
def test_gravity_must_be_three_numbers(tmp_path: Path, gravity: str) -> None:
    done = nrs("fmu", "from-urdf", str(ARM), "-o", str(tmp_path / "a.fmu"), "--gravity", gravity)
    assert done.returncode == 2
    assert done.stderr == (
        f"error: --gravity: expected three numbers like 0,0,-9.8, got {gravity!r}\n"
    )
    assert not list(tmp_path.iterdir())
