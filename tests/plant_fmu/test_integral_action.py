"""Integral action of FMUs in Model Exchange, whoever made them: z are states beside the FMU's.

The two-link arm is re-made as a stranger's: a torque is all that it takes. Its law and equations
are those of `test_controller`, integrated by DOP853.
"""

import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.drives.stability import runge_kutta, step_limit
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.plants import Body, Control, Disturbance, DrivenPlants
from tests.cases import cases
from tests.plant_fmu import test_controller as written
from tests.plant_fmu.rewritten_fmus import rewritten

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

KP, KD, KI, NONE = written.KP, written.KD, written.KI, np.zeros(2)
STEP, STEPS, ANY = 0.1, 12, Driving()
LIMIT = np.array([110.0, 45.0])
CONTROLS = {
    "alone": Control(ki=KI),
    "limited": Control(ki=KI, torque_limit=LIMIT),
    "strong": Control(ki=12 * KI, torque_limit=LIMIT),
}
"""Where z is strong, what is asked stays near the limit while the error falls."""
Opens = Callable[..., DrivenPlants]


@pytest.fixture(scope="module")
def stranger(tmp_path_factory: pytest.TempPathFactory) -> Archive:
    folder: Path = tmp_path_factory.mktemp("stranger")

    def edit(text: str) -> str:
        for name in ("position_ref", "velocity_ref", "ki", "torque_limit", "tau_applied"):
            assert f'name="{name}' in text
            text = text.replace(f'name="{name}', f'name="their_{name}')
        return text

    return open_archive(rewritten(folder / "arm.fmu", 2, edit))


@pytest.fixture
def opens(stranger: Archive) -> Iterator[Opens]:
    with ExitStack() as stack:

        def opened(
            *controls: Control, driving: Driving = ANY, archive: Archive = stranger
        ) -> DrivenPlants:
            of = [replace(body(), robot=i + 1, control=one) for i, one in enumerate(controls)]
            return open_plants(stack, archive, of, {}, driving)

        yield opened


def body() -> Body:
    # An offset is a torque too, which no limit cuts.
    push = Disturbance(written.TAU, NONE, *np.zeros((3, 2, 0)))
    start = written.Q0, written.QD0, written.POSITION, written.VELOCITY
    return Body(1, {}, KP, KD, push, *start)


def moved(plants: DrivenPlants, first: int = 0, last: int = STEPS) -> np.ndarray:
    """Return q, qd and tau (steps, rows, 6), with a reference that jumps halfway."""
    rows = []
    for k in range(first, last):
        if k % (STEPS // 2) == 0:
            n, back = len(plants.q), -1.0 if k else 1.0
            plants.hold(*(np.tile(back * x, (n, 1)) for x in (written.POSITION, written.VELOCITY)))
        plants.advance(k * STEP, STEP)
        rows.append(np.hstack([plants.q, plants.qd, plants.tau]))
    return np.array(rows)


def wanted(control: Control) -> tuple[np.ndarray, np.ndarray]:
    """Return q, qd and tau (steps, 6), and by how much torques are beyond their limits."""
    limit = np.full(2, np.inf) if control.torque_limit is None else control.torque_limit
    rows, beyond, x = [], [], np.concatenate([written.Q0, written.QD0, NONE])
    for half, back in enumerate((1.0, -1.0)):
        since = half * STEPS // 2 * STEP

        def law(t: float, x: np.ndarray) -> tuple[np.ndarray, ...]:
            q, qd, z = np.split(x, 3)
            e = back * (written.POSITION + (t - since) * written.VELOCITY) - q  # noqa: B023
            asked = KP @ e + KD @ (back * written.VELOCITY - qd) + control.ki @ z  # noqa: B023
            applied = np.clip(asked, -limit, limit)
            missing = asked - applied
            beyond = np.where(missing * e > 0, np.abs(missing) / (limit / 10), 0.0)
            return applied, missing, e * np.clip(1 - beyond, 0.0, None)

        def rates(t: float, x: np.ndarray) -> np.ndarray:
            q, qd, _ = np.split(x, 3)
            tau, _, rate = law(t, x)
            force = tau + written.TAU - written.coriolis(q, qd) - written.gravity(q)
            return np.concatenate([qd, np.linalg.solve(written.mass(q), force), rate])

        times = since + STEP * np.arange(1, STEPS // 2 + 1)
        longest = np.inf if control.torque_limit is None else 5e-3  # a limit is a kink
        solved = solve_ivp(
            rates, (since, times[-1]), x, "DOP853", times, rtol=1e-12, atol=1e-12, max_step=longest
        ).y.T
        for t, x in zip(times, solved, strict=True):
            tau, missing, _ = law(t, x)
            rows.append(np.concatenate([x[:4], tau]))
            beyond.append(missing)
    return np.array(rows), np.array(beyond)


@pytest.mark.parametrize("name", cases(CONTROLS, ["alone", "strong"]))
def test_a_strangers_arm_moves_as_dop853_has_it(opens: Opens, name: str) -> None:
    exact, beyond = wanted(CONTROLS[name])
    assert beyond.any() == (name != "alone")
    plain = moved(opens(replace(CONTROLS[name], ki=None)))[:, 0]
    assert np.abs(plain - exact)[:, :4].max() > 0.01
    bundled, rk4 = open_archive(build("two_link_arm")), Driving(solver="rk4", step=5e-3)
    for plants, tolerance in (
        (opens(CONTROLS[name]), 1e-6),
        (opens(CONTROLS[name], driving=rk4), 1e-3 if beyond.any() else 1e-6),
        (opens(CONTROLS[name], archive=bundled), 1e-7),
    ):
        found = moved(plants)[:, 0]
        off = (np.abs(found - exact) / (1 + np.abs(exact))).max()
        assert off < tolerance, plants.drive


def test_a_checkpoint_has_the_integral_and_robots_go_on_apart(opens: Opens) -> None:
    """Robots with an integral and without are in one company; each has a checkpoint of its own."""
    controls = CONTROLS["limited"], Control(torque_limit=LIMIT), CONTROLS["alone"]
    plants, halfway = opens(*controls), STEPS // 2
    moved(plants, 0, halfway)
    saved, there = plants.save(), plants.tau.copy()
    after = moved(plants, halfway)
    for row, control in enumerate(controls):
        alone = opens(control)
        alone.restore(saved[row : row + 1])
        np.testing.assert_array_equal(alone.tau[0], there[row])
        np.testing.assert_array_equal(moved(alone, halfway)[:, 0], after[:, row])
    with pytest.raises(FmuError, match="has 15 numbers, expected 13: it is driven otherwise"):
        opens(Control()).restore(saved[:1])


def test_a_gain_of_zero_is_none(opens: Opens) -> None:
    zero = moved(opens(Control(ki=np.zeros((2, 2)))), last=2)
    np.testing.assert_array_equal(zero, moved(opens(Control()), last=2))


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("ki", "which has no variable ki, as the controller of robot 1 wants"),
        ("tau_applied", "which tells no tau_applied: torques could not be recorded with ki"),
    ],
)
def test_a_law_in_an_fmu_that_lacks_a_name_is_refused_with_what_to_do(
    opens: Opens, tmp_path: Path, name: str, fault: str
) -> None:
    def edit(text: str) -> str:
        return text.replace(f'name="{name}', f'name="their_{name}')

    archive = open_archive(rewritten(tmp_path / "own.fmu", 3, edit))
    opens(Control(), archive=archive)
    with pytest.raises(FmuError, match=fault) as refused:
        opens(CONTROLS["alone"], archive=archive)
    assert 'with plant.solver = "cvode" the law is outside of it' in str(refused.value)


def test_a_held_torque_has_no_integral_and_says_what_to_do(opens: Opens) -> None:
    with pytest.raises(FmuError, match="ki, as the controller of robot 1 wants") as refused:
        opens(CONTROLS["alone"], driving=Driving(control="hold"))
    assert 'leave plant.control away, or take plant.solver = "cvode"' in str(refused.value)


@pytest.mark.parametrize("ki", [0.0, 20.0, 200.0])
def test_a_step_that_is_stable_with_an_integral_is_found(ki: float) -> None:
    """Of s³ + kd s² + kp s + ki: |1 + z + z²/2 + z³/6 + z⁴/24| < 1 at z = h s."""
    kp, kd = 60.0, 15.0
    limit = step_limit(np.array([[kp, kd, ki] if ki else [kp, kd]]), runge_kutta)
    roots = np.roots([1.0, kd, kp, ki] if ki else [1.0, kd, kp])

    def grows(h: float) -> float:
        z = h * roots
        return float(np.abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))).max())

    assert grows(0.999 * limit) < 1 < grows(1.001 * limit)
