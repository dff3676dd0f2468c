"""The bundled models against equations of motion written once more, in numpy, and DOP853."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.bundled.declaration import bundled_models, declaration
from tests.plant_fmu.fmpy_instances import Array, Open, Robot

MODELS = ("planar_robot", "two_link_arm")
VERSIONS = (2, 3)
H = 0.1
each_model = pytest.mark.parametrize("model", MODELS)
each_version = pytest.mark.parametrize("fmi", VERSIONS)


# The equations again


def arm_acceleration(
    q: Array,
    qd: Array,
    force: Array,
    m1: float = 0.5,
    m2: float = 1.5,
    J1: float = 5.0,
    J2: float = 5.0,
) -> Array:
    r1, r2, g = 1.0, 0.8, 9.8
    M11 = (m1 + m2) * r1**2 + m2 * r2**2 + 2 * m2 * r1 * r2 * np.cos(q[1]) + J1
    M12 = m2 * r2**2 + m2 * r1 * r2 * np.cos(q[1])
    M = np.array([[M11, M12], [M12, m2 * r2**2 + J2]])
    b = m2 * r1 * r2 * np.sin(q[1])
    C = np.array([[-b * qd[1], -b * (qd[0] + qd[1])], [b * qd[0], 0.0]])
    G2 = m2 * g * r2 * np.cos(q[0] + q[1])
    G = np.array([(m1 + m2) * g * r1 * np.cos(q[0]) + G2, G2])
    return np.linalg.solve(M, force - C @ qd - G)


def point_acceleration(_q: Array, qd: Array, force: Array) -> Array:
    return (force - 0.5 * qd) / 2.0


ACCELERATION: dict[str, Callable[[Array, Array, Array], Array]] = {
    "two_link_arm": arm_acceleration,
    "planar_robot": point_acceleration,
}


@dataclass(frozen=True)
class Drive:
    """All that acts on a robot at a time t; the reference moves on from reference_time."""

    position_ref: Array = field(default_factory=lambda: np.zeros(2))
    velocity_ref: Array = field(default_factory=lambda: np.zeros(2))
    reference_time: float = 1e30
    tau: Array = field(default_factory=lambda: np.zeros(2))
    kp: Array = field(default_factory=lambda: np.array([[200.0, 7.0], [-3.0, 150.0]]))
    kd: Array = field(default_factory=lambda: np.array([[300.0, 5.0], [2.0, 250.0]]))

    def reference(self, t: float) -> Array:
        return self.position_ref + max(0.0, t - self.reference_time) * self.velocity_ref

    def applied(self, t: float, q: Array, qd: Array) -> Array:
        return self.tau + self.kp @ (self.reference(t) - q) + self.kd @ (self.velocity_ref - qd)

    def disturbance(self, t: float) -> Array:
        return np.array([0.3 + 2 * np.sin(t), -0.2 * t + 2 * np.cos(2 * t) + np.sin(3 * t - 1)])

    def rates(self, model: str, t: float, x: Array) -> Array:
        q, qd = x[:2], x[2:]
        force = self.applied(t, q, qd) + self.disturbance(t)
        return np.concatenate([qd, ACCELERATION[model](q, qd, force)])


Q0, QD0 = np.array([0.4, -1.1]), np.array([2.0, -0.7])
SETTINGS = {
    "kp": Drive().kp,
    "kd": Drive().kd,
    "disturbance_offset": [0.3, 0.0],
    "disturbance_rate": [0.0, -0.2],
    "disturbance_amplitude": [[2, 0, 0, 0, 0, 0, 0, 0], [0, 2, 0, 1, 0, 0, 0, 0]],
    "disturbance_frequency": [[1, 0, 0, 0, 0, 0, 0, 0], [0, 2, 0, 3, 0, 0, 0, 0]],
    "disturbance_phase": [[0, 0, 0, 0, 0, 0, 0, 0], [0, np.pi / 2, 0, -1, 0, 0, 0, 0]],
    "q": Q0,
    "qd": QD0,
}
# What is set before step k, that is at t = k H, as (variable, value) in this order.
STORY: dict[int, tuple[tuple[str, Any], ...]] = {
    0: (
        ("position_ref", np.array([1.0, -0.5])),
        ("velocity_ref", np.array([0.5, 2.0])),
        ("reference_time", 0.0),
    ),
    5: (("velocity_ref", np.array([-1.0, 0.3])), ("position_ref", np.array([0.7, 0.6]))),
    9: (("tau", np.array([12.0, -30.0])), ("reference_time", 0.9)),
    12: (("velocity_ref", np.array([2.0, 2.0])),),
    16: (("position_ref", np.array([-1.0, 1.0])), ("reference_time", 9.0)),
}
STEPS = 20


@cache
def expected(model: str) -> Array:
    """(q, qd, tau_applied) at k H before what is set there, by DOP853."""
    drive, x, rows = Drive(), np.concatenate([Q0, QD0]), []
    for k in range(STEPS + 1):
        t = k * H
        rows.append(np.concatenate([x, drive.applied(t, x[:2], x[2:])]))
        for name, value in STORY.get(k, ()):
            drive = replace(drive, **{name: value})
        rates = solve_ivp(
            lambda t, x, drive=drive: drive.rates(model, t, x),
            (t, (k + 1) * H), x, "DOP853", rtol=1e-13, atol=1e-13,
        )  # fmt: skip
        x = rates.y[:, -1]
    return np.array(rows)


def tolerances(measured: Array, wanted: Array) -> Array:
    """The error in units of what the integrator allows per step."""
    return np.abs(measured - wanted) / (1e-9 * (1.0 + np.abs(wanted)))


# What a robot does in the story


def play(robot: Robot, first: int, last: int, parts: int = 1) -> Array:
    """Steps `first` to `last` of the story; (q, qd, tau_applied) before each."""
    rows = []
    for k in range(first, last):
        rows.append(outputs(robot))
        for name, value in STORY.get(k, ()):
            robot.set(name, value)
        for i in range(parts):
            robot.fmu.doStep(k * H + i * H / parts, H / parts)
    rows.append(outputs(robot))
    return np.array(rows)


def outputs(robot: Robot) -> Array:
    return np.concatenate([robot.get(name) for name in ("q", "qd", "tau_applied")])


# The archive


@each_version
@pytest.mark.parametrize("model", bundled_models())
def test_fmpy_validates_the_model(model: str, fmi: int) -> None:
    assert validate_fmu(str(build(model, fmi))) == []


@each_model
def test_both_versions_declare_the_same_numbers(model: str) -> None:
    two, three = (fmpy.read_model_description(build(model, fmi)) for fmi in VERSIONS)
    scalars = {v.valueReference: v for v in two.modelVariables}
    for v in three.modelVariables:
        first = scalars[v.valueReference]
        assert first.name.replace("[1,1]", "").replace("[1]", "") == v.name
        assert (first.unit, first.causality, first.variability, first.initial) == (
            v.unit, v.causality, v.variability, v.initial,
        )  # fmt: skip
    assert len(scalars) == sum(int(np.prod(v.shape)) for v in three.modelVariables)


@each_version
def test_the_archive_says_what_other_tools_look_for(fmi: int) -> None:
    with ZipFile(build("two_link_arm", fmi)) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        page = archive.read("documentation/index.html").decode()
        assert archive.read("documentation/licenses/license.txt").startswith(b"MIT License")
    assert root.get("version") == version("nrs-cosim")
    assert root.get("license") == "MIT"
    assert "<td>reference_time</td><td>input</td>" in page
    assert "Automatica" in page
    declared = {v.get("name"): v for v in root.find("ModelVariables")}
    limits = declared["relative_tolerance"]
    limits = limits if fmi == 3 else limits[0]
    assert (limits.get("min"), limits.get("max")) == ("1e-14", "1.0")
    if fmi == 2:
        for interface in ("CoSimulation", "ModelExchange"):
            assert root.find(interface).get("canNotUseMemoryManagementFunctions") == "true"
        assert declared["disturbance_terms[1]"].get("variability") == "fixed"


@pytest.mark.parametrize(("name", "limit"), [("tau_applied", 1e30), ("tau_missing", 0.0)])
def test_an_output_depends_on_what_is_declared_alone(robot: Open, name: str, limit: float) -> None:
    """Numerically, each known alone; in FMI 2, where the elements are variables."""
    root = fmpy.read_model_description(build("two_link_arm", 2))
    random = np.random.default_rng(3)
    with robot("two_link_arm", 2, "Model") as r:
        r.initialize(**SETTINGS, reference_time=-1.0, torque_limit=[limit, limit])
        r.fmu.enterContinuousTimeMode()
        inputs = [v for v in root.modelVariables if v.causality == "input"]
        for v in inputs:
            r.fmu.setReal([v.valueReference], [random.uniform(-1, 0)])
        x = random.uniform(-1, 1, 4)
        for output in [o for o in root.outputs if o.variable.name.startswith(name)]:
            reference = output.variable.valueReference
            declared = {v.name for v in output.dependencies}
            r.derivatives(0.5, x)
            (before,) = r.fmu.getReal([reference])
            for v in inputs:
                (old,) = r.fmu.getReal([v.valueReference])
                r.fmu.setReal([v.valueReference], [old + 0.25])
                (after,) = r.fmu.getReal([reference])
                assert (after != before) == (v.name in declared)
                r.fmu.setReal([v.valueReference], [old])


def test_units_follow_the_model() -> None:
    assert declaration("planar_robot").variable("kd").unit == "N.s/m"
    assert declaration("two_link_arm").variable("kd").unit == "N.m.s/rad"
    description = fmpy.read_model_description(build("two_link_arm"))
    base = {u.name: u.baseUnit for u in description.unitDefinitions}["N.m.s/rad"]
    assert (base.kg, base.m, base.s, base.rad) == (1, 2, -1, -1)


# Co-simulation


@each_version
@each_model
def test_co_simulation_follows_the_equations(robot: Open, model: str, fmi: int) -> None:
    with robot(model, fmi) as r:
        r.initialize(**SETTINGS)
        error = tolerances(play(r, 0, STEPS), expected(model))
    assert error[:, :4].max() < 1.0
    assert error[:, 4:].max() < 500.0  # tau_applied magnifies by kp + kd


@each_model
def test_both_versions_give_the_same_bits(robot: Open, model: str) -> None:
    played = []
    for fmi in VERSIONS:
        with robot(model, fmi) as r:
            r.initialize(**SETTINGS)
            played.append(play(r, 0, STEPS))
    assert np.array_equal(played[0], played[1])


def test_the_communication_step_does_not_matter(robot: Open) -> None:
    with robot("two_link_arm", 3) as r:
        r.initialize(**SETTINGS)
        error = tolerances(play(r, 0, STEPS, parts=7), expected("two_link_arm"))
    assert error[:, :4].max() < 1.0


@each_version
def test_a_passive_arm_conserves_energy(robot: Open, fmi: int) -> None:
    def energy(q: Array, qd: Array) -> float:
        m1, m2, r1, r2, J1, J2, g = 0.5, 1.5, 1.0, 0.8, 5.0, 5.0, 9.8
        y1 = r1 * np.sin(q[0])
        y2 = y1 + r2 * np.sin(q[0] + q[1])
        v1 = r1 * qd[0] * np.array([-np.sin(q[0]), np.cos(q[0])])
        turn = np.array([-np.sin(q[0] + q[1]), np.cos(q[0] + q[1])])
        v2 = v1 + r2 * (qd[0] + qd[1]) * turn
        kinetic = m1 * v1 @ v1 + m2 * v2 @ v2 + J1 * qd[0] ** 2 + J2 * qd[1] ** 2
        return float(kinetic / 2 + g * (m1 * y1 + m2 * y2))

    with robot("two_link_arm", fmi) as r:
        r.initialize(q=Q0, qd=QD0)
        energies = [energy(Q0, QD0)]
        for k in range(100):
            r.fmu.doStep(k * H, H)
            energies.append(energy(r.get("q"), r.get("qd")))
    assert np.ptp(energies) < 1e-7


# Model exchange


@each_version
@each_model
def test_derivatives_agree_with_the_equations(robot: Open, model: str, fmi: int) -> None:
    random = np.random.default_rng(1)
    inputs = {
        "position_ref": np.array([0.2, 0.4]),
        "velocity_ref": np.array([1.0, -3.0]),
        "reference_time": 4.0,
        "tau": np.array([5.0, 6.0]),
    }
    drive = Drive(**inputs)
    with robot(model, fmi, "Model") as r:
        r.initialize(**SETTINGS, **inputs)
        r.fmu.enterContinuousTimeMode()
        for t, x in zip(random.uniform(0, 9, 20), random.uniform(-9, 9, (20, 4)), strict=True):
            rates = r.derivatives(t, x)
            wanted = drive.rates(model, t, x)
            assert np.abs(rates - wanted).max() <= 1e-12 * np.abs(wanted).max()
            assert np.array_equal(np.concatenate([r.get("der(q)"), r.get("der(qd)")]), rates)


@each_version
@each_model
def test_fmpy_integrates_with_cvode(
    robot: Open, unpacked: Callable[[str, int], Path], model: str, fmi: int
) -> None:
    with robot(model, fmi) as r:
        r.initialize(q=Q0, qd=QD0)
        for k in range(10):
            r.fmu.doStep(k * H, H)
        wanted = r.get("q")
    start: dict[str, Any] = {"q": Q0, "qd": QD0}
    if fmi == 2:
        start = {f"{n}[{i + 1}]": values[i] for n, values in start.items() for i in range(2)}
    result = fmpy.simulate_fmu(
        str(unpacked(model, fmi)),
        fmi_type="ModelExchange",
        stop_time=1.0,
        relative_tolerance=1e-9,
        start_values=start,
        output=["q[1]", "q[2]"] if fmi == 2 else ["q"],
    )
    last = np.array(list(result[-1])[1:]).ravel()
    assert np.abs(last - wanted).max() < 1e-6


# Bad calls


def test_arrays_are_read_and_set_as_a_whole(robot: Open) -> None:
    with robot("two_link_arm", 3) as r:
        inside = r.references("q")[0] + 1
        assert "no variable" in r.refuses(lambda: r.fmu.getFloat64([inside]))
        assert r.refuses(lambda: r.set("q", [1.0])) == "too few values: q has 2, 1 are left"
        assert "1 values more" in r.refuses(lambda: r.set("q", [1.0, 2.0, 3.0]))


# Steps that cannot be made
