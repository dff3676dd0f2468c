"""A reference with an acceleration is followed as the parabola that it is, or in chords.

A point mass m without drag that lags by m a/kp behind a parabola under the PD law goes on so for
ever: m ë + kd ė + kp e = m a has that constant solution, which is the closed form here.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from nrs_cosim.estimator_agents.flow import chord_errors
from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.plants import Body, Disturbance, DrivenPlants
from tests.plant_fmu.rewritten_fmus import rewritten

MASS, KP, KD = 2.0, 200.0, 300.0
POSITION, VELOCITY, ACCELERATION = np.array([[1.0, -2.0], [0.3, -0.7], [2.0, -5.0]])[:, None]
STEP, STEPS = 0.05, 10
DRIVES = {
    "reference": (Driving(), 1e-8),
    "cvode": (Driving(solver="cvode"), 1e-7),
    "rk4": (Driving(solver="rk4"), 1e-7),
    "heun": (Driving(control="heun", control_step=0.001), 1e-4),
    "hold": (Driving(control="hold", control_step=0.001), 1e-2),
}
OTHER = "acceleration_wanted"
Opens = Callable[..., DrivenPlants]


def curve(t: float) -> tuple[np.ndarray, np.ndarray]:
    return POSITION + t * VELOCITY + t * t / 2 * ACCELERATION, VELOCITY + t * ACCELERATION


def body() -> Body:
    none = np.zeros(2)
    still = Disturbance(none, none, *np.zeros((3, 2, 0)))
    lag = MASS * ACCELERATION[0] / KP
    start = POSITION[0] - lag, VELOCITY[0], POSITION[0], VELOCITY[0]
    return Body(1, {"m": MASS, "d": 0.0}, KP * np.eye(2), KD * np.eye(2), still, *start)


@pytest.fixture
def opens() -> Iterator[Opens]:
    with ExitStack() as stack:
        yield lambda archive, driving=None, names=None: open_plants(
            stack, archive, [body()], names or {}, driving or Driving()
        )


def bundled(fmi: int = 3) -> Archive:
    return open_archive(build("planar_robot", fmi))


def without(folder: Path, fmi: int = 3) -> Archive:
    """Return the same FMU, whose acceleration has a name of its own."""

    def edit(text: str) -> str:
        assert "acceleration_ref" in text
        return text.replace('name="acceleration_ref', f'name="{OTHER}')

    return open_archive(rewritten(folder / f"{fmi}.fmu", fmi, edit, "planar_robot"))


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(("driving", "tolerance"), DRIVES.values(), ids=DRIVES)
def test_however_it_is_driven_a_mass_stays_as_far_behind_a_parabola(
    opens, driving, tolerance, fmi
) -> None:
    plants = opens(bundled(fmi), driving)
    plants.hold(POSITION, VELOCITY, ACCELERATION)
    for k in range(STEPS):
        plants.advance(k * STEP, STEP)
        position, velocity = curve((k + 1) * STEP)
        assert np.abs(position - plants.q - MASS * ACCELERATION / KP).max() < tolerance
        law = KP * (position - plants.q) + KD * (velocity - plants.qd)
        np.testing.assert_allclose(plants.tau, law, rtol=1e-9, atol=1e-9)


def test_an_input_of_another_name_is_given_it_as_well(opens, tmp_path: Path) -> None:
    archive = without(tmp_path)
    moved = []
    for names in ({}, {"acceleration_ref": OTHER}):
        plants = opens(archive, names=names)
        plants.hold(POSITION, VELOCITY, ACCELERATION)
        plants.advance(0.0, STEP)
        moved.append(plants.q.copy())
    exact = curve(STEP)[0] - MASS * ACCELERATION / KP
    assert np.abs(moved[0] - exact).max() > 1e-4
    assert np.abs(moved[1] - exact).max() < 1e-8


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_without_the_input_is_given_chords_that_are_off_by_what_is_said(
    opens, tmp_path: Path, fmi: int
) -> None:
    plants = opens(without(tmp_path, fmi))
    plants.hold(POSITION, VELOCITY, ACCELERATION)
    off, slope = chord_errors(1.0, STEP)
    for k in range(STEPS):
        plants.advance(k * STEP, STEP)
        position, velocity = curve((k + 1) * STEP)
        law = KP * (position - plants.q) + KD * (velocity - plants.qd)
        np.testing.assert_allclose(plants.tau, law - KD * slope * ACCELERATION, atol=1e-6)
        # Of a law that had stood still at 0 in the middle of the step, the position alone is left.
        middle, _ = curve((k + 0.5) * STEP)
        torque = plants.law.torque((k + 0.5) * STEP, np.zeros((1, 4)))  # type: ignore[attr-defined]
        chord = (torque - KD * (velocity - slope * ACCELERATION)) / KP
        np.testing.assert_allclose(chord - middle, off * ACCELERATION, rtol=1e-6)


@pytest.mark.parametrize(("driving", "_"), DRIVES.values(), ids=DRIVES)
def test_a_checkpoint_amid_parabolas_goes_on_to_the_same_bits(opens, driving, _) -> None:
    plants, other = (opens(bundled(), driving) for _ in range(2))
    plants.hold(POSITION, VELOCITY, ACCELERATION)
    plants.advance(0.0, STEP)
    saved, there = plants.save(), plants.tau.copy()
    other.restore(saved)
    np.testing.assert_array_equal(other.tau, there)
    moved = []
    for each in (plants, other):
        each.hold(*curve(STEP), -ACCELERATION)
        each.advance(STEP, STEP)
        moved.append(np.concatenate([each.q, each.qd, each.tau]))
    np.testing.assert_array_equal(*moved)


def test_a_line_after_a_parabola_has_no_acceleration_left(opens) -> None:
    plants, other = opens(bundled()), opens(bundled())
    plants.hold(POSITION, VELOCITY, ACCELERATION)
    for each in (plants, other):
        each.hold(POSITION, VELOCITY)
        each.advance(0.0, STEP)
    np.testing.assert_array_equal(plants.q, other.q)
