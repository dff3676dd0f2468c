"""The n-link arm against Newton's law for its links in joint coordinates, in numpy, and DOP853.

The sizes of its variables are set through FMPy, in Configuration Mode.
"""

import zipfile
from dataclasses import dataclass
from functools import partial
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from nrs_cosim.plant_fmu.bundled.builder import build
from tests.plant_fmu.fmpy_instances import Array, Open, Robot

H = 0.1
each_size = pytest.mark.parametrize("n", [1, 2, 3, 7, 16])


# The equations again


def turned(v: Array) -> Array:
    """By a right angle; v (..., 2)."""
    return np.stack([-v[..., 1], v[..., 0]], axis=-1)


@dataclass(frozen=True)
class Arm:
    """Links (n,) whose motion is worked out in the plane, and projected on the joints."""

    m: Array
    r: Array
    c: Array
    I: Array  # noqa: E741
    J: Array
    g: float = 9.8

    def places(self, q: Array) -> tuple[Array, Array, Array]:
        """Directions of the links, their joints, and their centres of mass (n, 2)."""
        angle = np.cumsum(q)
        along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ends = np.cumsum(self.r[:, None] * along, axis=0)
        joints = np.vstack([np.zeros(2), ends[:-1]])
        return along, joints, joints + self.c[:, None] * along

    def jacobian(self, q: Array) -> Array:
        """d centre_i / d q_k (n, n, 2): turning joint k carries all links from k on."""
        _, joints, centres = self.places(q)
        carried = np.tri(len(q))[:, :, None]
        return carried * turned(centres[:, None] - joints[None, :])

    def mass_matrix(self, q: Array) -> Array:
        J, carried = self.jacobian(q), np.tri(len(q))
        moving = np.einsum("i,ijx,ikx->jk", self.m, J, J)
        return moving + carried.T @ (self.I[:, None] * carried) + np.diag(self.J)

    def acceleration(self, q: Array, qd: Array, force: Array) -> Array:
        along, _, _ = self.places(q)
        inward = -(np.cumsum(qd)[:, None] ** 2) * along
        joints = np.cumsum(self.r[:, None] * inward, axis=0) - self.r[:, None] * inward
        needed = joints + self.c[:, None] * inward + [0.0, self.g]
        bias = np.einsum("i,ijx,ix->j", self.m, self.jacobian(q), needed)
        return np.linalg.solve(self.mass_matrix(q), force - bias)

    def energy(self, q: Array, qd: Array) -> float:
        _, _, centres = self.places(q)
        kinetic = qd @ self.mass_matrix(q) @ qd / 2
        return float(kinetic + self.g * self.m @ centres[:, 1])

    def settings(self) -> dict[str, Array | float]:
        return {"m": self.m, "r": self.r, "c": self.c, "I": self.I, "J": self.J, "g": self.g}


@dataclass(frozen=True)
class Drive:
    """All that acts on an arm; the reference starts at time 0, and each harmonic is a sine."""

    tau: Array
    position_ref: Array
    velocity_ref: Array
    reference_time: float
    kp: Array
    kd: Array
    disturbance_offset: Array
    disturbance_rate: Array
    disturbance_amplitude: Array
    disturbance_frequency: Array
    disturbance_phase: Array

    def applied(self, t: float, q: Array, qd: Array) -> Array:
        reference = self.position_ref + t * self.velocity_ref
        return self.tau + self.kp @ (reference - q) + self.kd @ (self.velocity_ref - qd)

    def rates(self, arm: Arm, t: float, x: Array) -> Array:
        q, qd = np.split(x, 2)
        waves = np.sin(self.disturbance_frequency * t + self.disturbance_phase)
        disturbance = (
            self.disturbance_offset
            + self.disturbance_rate * t
            + (self.disturbance_amplitude * waves).sum(axis=1)
        )
        force = self.applied(t, q, qd) + disturbance
        return np.concatenate([qd, arm.acceleration(q, qd, force)])

    def settings(self) -> dict[str, Array | float]:
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


def some_arm(n: int) -> Arm:
    m, r, c, inertia, J = np.random.default_rng(n).uniform(0.5, 1.5, (5, n))
    return Arm(m, r, r * c - 0.3, 0.1 * inertia, J)


def some_drive(n: int) -> Drive:
    random = np.random.default_rng(100 + n)

    def numbers(*columns: int) -> Array:
        return random.uniform(-2, 2, (n, *columns))

    return Drive(
        tau=numbers(),
        position_ref=numbers(),
        velocity_ref=numbers(),
        reference_time=0.0,
        kp=20.0 * (np.eye(n) + 0.1 * numbers(n)),
        kd=5.0 * (np.eye(n) + 0.1 * numbers(n)),
        disturbance_offset=numbers(),
        disturbance_rate=numbers(),
        disturbance_amplitude=numbers(8),
        disturbance_frequency=numbers(8),
        disturbance_phase=numbers(8),
    )


def some_state(n: int) -> Array:
    return np.random.default_rng(200 + n).uniform(-1.5, 1.5, 2 * n)


def tolerances(measured: Array, wanted: Array) -> Array:
    """The error in units of what the integrator allows per step."""
    return np.abs(measured - wanted) / (1e-9 * (1.0 + np.abs(wanted)))


def state(robot: Robot) -> Array:
    return np.concatenate([robot.get("q"), robot.get("qd")])


def start(robot: Robot, x: Array, *result: Arm | Drive) -> None:
    """Initializes at the state x (2 n,) after n and all that is told have been set."""
    q, qd = np.split(x, 2)
    if robot.fmi == 3:
        robot.configure("n", len(q))
    settings = {name: value for each in result for name, value in each.settings().items()}
    robot.initialize(**settings, q=q, qd=qd)


# The description


def test_the_n_link_arm_declares_its_sizes_by_n() -> None:
    description = fmpy.read_model_description(build("n_link_arm"))
    variables = {v.name: v for v in description.modelVariables}
    n = variables["n"]
    assert (n.type, n.causality, n.variability) == ("UInt64", "structuralParameter", "fixed")
    with zipfile.ZipFile(build("n_link_arm")) as archive:  # FMPy does not read the limits
        (element,) = ElementTree.fromstring(archive.read("modelDescription.xml")).iter("UInt64")
    assert (element.get("start"), element.get("min"), element.get("max")) == ("3", "1", "16")
    sized = {v.name: [d.valueReference for d in v.dimensions] for v in variables.values()}
    one = [n.valueReference]
    for name in ("tau", "position_ref", "velocity_ref", "q", "qd", "der(qd)", "tau_applied", "m"):
        assert sized[name] == one
    assert sized["kp"] == sized["kd"] == one * 2
    assert sized["disturbance_phase"] == [*one, None]
    assert variables["disturbance_phase"].shape == (3, 8)
    assert description.numberOfContinuousStates == 6


def test_in_fmi_2_the_n_link_arm_has_three_links() -> None:
    description = fmpy.read_model_description(build("n_link_arm", 2))
    names = {v.name for v in description.modelVariables}
    assert {"q[3]", "kp[3,3]", "J[3]"} <= names
    assert not {"n", "q[4]"} & names
    assert description.numberOfContinuousStates == 6
    assert "3 in FMI 2.0" in description.description


# The equations


@each_size
def test_derivatives_agree_with_the_equations(robot: Open, n: int) -> None:
    arm, drive = some_arm(n), some_drive(n)
    with robot("n_link_arm", 3, "Model") as r:
        start(r, np.zeros(2 * n), arm, drive)
        r.fmu.enterContinuousTimeMode()
        for t in (0.0, 1.3, 4.0):
            x = some_state(n) + t
            wanted = drive.rates(arm, t, x)
            assert np.abs(r.derivatives(t, x) - wanted).max() <= 1e-11 * np.abs(wanted).max()
            applied = drive.applied(t, *np.split(x, 2))
            assert np.abs(r.get("tau_applied") - applied).max() <= 1e-13 * np.abs(applied).max()


@each_size
def test_co_simulation_follows_the_equations(robot: Open, n: int) -> None:
    arm, drive, x = some_arm(n), some_drive(n), some_state(n)
    with robot("n_link_arm", 3) as r:
        start(r, x, arm, drive)
        for k in range(5):
            r.fmu.doStep(k * H, H)
        measured = state(r)
    run = solve_ivp(
        lambda t, x: drive.rates(arm, t, x), (0.0, 5 * H), x, "DOP853", rtol=1e-12, atol=1e-12
    )
    assert tolerances(measured, run.y[:, -1]).max() < 10.0


def test_one_link_swings_as_a_pendulum(robot: Open) -> None:
    """From rest at an angle a to its lowest point, T = 4 sqrt(r / g) K(sin(a / 2))."""
    r, a = 0.7, 2.0
    x = np.array([a - np.pi / 2, 0.0])
    bob = Arm(*np.array([[1.3], [r], [r], [0.0], [0.0]]))
    period = 4 * np.sqrt(r / bob.g) * ellipk(np.sin(a / 2) ** 2)
    with robot("n_link_arm", 3) as arm:
        start(arm, x, bob)
        arm.fmu.doStep(0.0, period / 2)
        assert np.allclose(state(arm), [-a - np.pi / 2, 0.0], atol=1e-7)
        arm.fmu.doStep(period / 2, period / 2)
        assert np.allclose(state(arm), x, atol=1e-7)


def test_two_links_agree_with_two_link_arm(robot: Open) -> None:
    x, drive = some_state(2), some_drive(2)
    masses = Arm(*np.array([[0.5, 1.5], [1.0, 0.8], [1.0, 0.8], [0.0, 0.0], [5.0, 5.0]]))
    ends = []
    for model, result in (("n_link_arm", (masses, drive)), ("two_link_arm", (drive,))):
        with robot(model, 3) as r:
            if model == "n_link_arm":
                start(r, x, *result)
            else:
                q, qd = np.split(x, 2)
                r.initialize(**drive.settings(), q=q, qd=qd)
            for k in range(20):
                r.fmu.doStep(k * H, H)
            ends.append(state(r))
    assert np.allclose(ends[0], ends[1], rtol=0, atol=1e-11)


def test_passive_links_conserve_energy(robot: Open) -> None:
    arm, x = some_arm(7), some_state(7)
    with robot("n_link_arm", 3) as r:
        start(r, x, arm)
        energies = [arm.energy(*np.split(x, 2))]
        for k in range(50):
            r.fmu.doStep(k * H, H)
            energies.append(arm.energy(r.get("q"), r.get("qd")))
    assert np.ptp(energies) < 1e-6


@each_size
def test_the_mass_matrix_is_symmetric_and_positive(robot: Open, n: int) -> None:
    """Its inverse is what unit torques add to the acceleration."""
    arm, x = some_arm(n), some_state(n)
    accelerations = []
    with robot("n_link_arm", 3, "Model") as r:
        start(r, x, arm)
        r.fmu.enterContinuousTimeMode()
        for torque in (np.zeros(n), *np.eye(n)):
            r.set("tau", torque)
            accelerations.append(r.derivatives(0.0, x)[n:])
    inverse = np.array(accelerations[1:]) - accelerations[0]
    scale = np.abs(accelerations).max()
    assert np.abs(inverse - inverse.T).max() <= 1e-12 * scale
    assert np.linalg.eigvalsh(inverse).min() > 0.0
    assert np.abs(inverse @ arm.mass_matrix(x[:n]) - np.eye(n)).max() <= 1e-11 * scale


def test_both_versions_give_the_same_bits(robot: Open) -> None:
    ends = []
    for fmi in (2, 3):
        with robot("n_link_arm", fmi) as r:
            start(r, some_state(3), some_arm(3), some_drive(3))
            for k in range(5):
                r.fmu.doStep(k * H, H)
            ends.append(state(r))
    assert np.array_equal(ends[0], ends[1])


def test_a_link_without_inertia_is_an_error(robot: Open) -> None:
    with robot("n_link_arm", 3) as r:
        start(r, some_state(2), Arm(*np.zeros((5, 2))))
        message = r.refuses(lambda: r.fmu.doStep(0.0, H))
        assert message == "at t = 0 s: a derivative is not finite"


# Structural parameters


def test_n_sizes_the_variables_and_returns_them_to_their_starts(robot: Open) -> None:
    with robot("n_link_arm", 3) as r:
        r.set("kp", np.arange(9.0))
        r.set("J", [1.0, 2.0, 3.0])
        r.set("position_ref", [4.0, 5.0, 6.0])
        r.set("g", 1.62)
        r.set("disturbance_amplitude", np.ones((3, 8)))
        r.configure("n", 3)
        assert r.get("J").tolist() == [1.0, 2.0, 3.0]  # the same n changes nothing
        for n in (16, 1, 5):
            r.configure("n", n)
            assert r.fmu.getUInt64(r.references("n")) == [n]
            for v in r.declaration.variables:
                if v.dimensions and v.start is not None:
                    assert np.array_equal(r.get(v.name), np.full(r.shape(v.name), v.start))
        for name in ("position_ref", "disturbance_terms"):
            assert not r.get(name).any()
        assert r.get("g") == 1.62
        gains = np.arange(25.0).reshape(5, 5)
        r.set("kp", gains)
        assert np.array_equal(r.get("kp"), gains)
        assert "kp has 25, 9 are left" in r.refuses(lambda: r.set("kp", np.ones(9)))
        assert "1 values more" in r.refuses(lambda: r.set("q", np.ones(6)))
        r.fmu.reset()
        assert r.fmu.getUInt64(r.references("n")) == [3]


@each_size
def test_the_number_of_states_follows_n(robot: Open, n: int) -> None:
    with robot("n_link_arm", 3, "Model") as r:
        assert r.fmu.getNumberOfContinuousStates() == 6
        start(r, some_state(n))
        assert r.fmu.getNumberOfContinuousStates() == 2 * n
        r.fmu.enterContinuousTimeMode()
        message = r.refuses(lambda: r.derivatives(0.0, np.zeros(2 * n + 1)))
        assert message == f"expected {2 * n} states, got {2 * n + 1}"


def test_n_is_set_where_fmi_allows_it(robot: Open) -> None:
    with robot("n_link_arm", 3) as r:
        n, g = r.references("n"), r.references("g")
        set_n = partial(r.fmu.setUInt64, n)
        assert r.refuses(lambda: set_n([4])) == (
            "setting a structural parameter is not allowed before initialization"
        )
        assert "no variable has" in r.refuses(lambda: r.fmu.getFloat64(n))
        assert "no variable has" in r.refuses(lambda: r.fmu.setFloat64(n, [4.0]))
        r.fmu.enterConfigurationMode()
        for count in (0, 17, 2**64 - 1):
            message = r.refuses(lambda count=count: set_n([count]))
            assert message == f"n: expected 1 to 16, got {count}"
        assert r.fmu.getUInt64(n) == [3]
        for reference in (*g, 99999):
            message = r.refuses(lambda vr=reference: r.fmu.setUInt64([vr], [4]))
            assert message == f"no structural parameter has the value reference {reference}"
        assert "2 values for 1" in r.refuses(lambda: set_n([4, 5]))
        assert "not allowed in conf" in r.refuses(lambda: r.set("g", 1.0))
        assert "not allowed in conf" in r.refuses(r.fmu.enterInitializationMode)
        r.fmu.exitConfigurationMode()
        assert "leaving configuration" in r.refuses(r.fmu.exitConfigurationMode)
        r.initialize()
        assert r.refuses(r.fmu.enterConfigurationMode) == (
            "entering configuration mode is not allowed in step mode"
        )
    with robot("two_link_arm", 3) as r:
        assert r.refuses(r.fmu.enterConfigurationMode) == "this FMU has no structural parameters"


def test_a_state_restores_n(robot: Open) -> None:
    with robot("n_link_arm", 3) as seven, robot("n_link_arm", 3) as other:
        start(seven, some_state(7), some_arm(7), some_drive(7))
        seven.fmu.doStep(0.0, H)
        kept = seven.fmu.getFMUState()
        serialized = bytes(seven.fmu.serializeFMUState(kept))
        seven.fmu.freeFMUState(kept)
        seven.fmu.doStep(H, H)
        wanted = seven.get("qd")
        other.fmu.setFMUState(other.fmu.deserializeFMUState(serialized))
        other.lengths = seven.lengths
        assert other.fmu.getUInt64(other.references("n")) == [7]
        other.fmu.doStep(H, H)
        assert np.array_equal(other.get("qd"), wanted)
