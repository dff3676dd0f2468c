"""Events of Model Exchange against closed forms: a joint that bounces, is loaded, or turns over."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive
from nrs_cosim.plant_fmu.drives import cvode
from nrs_cosim.plant_fmu.drives.choice import Driving, choose
from nrs_cosim.plant_fmu.drives.exchange_instance import Exchanged
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError, StepError
from nrs_cosim.plant_fmu.plants import Body, Disturbance, DrivenPlants
from tests.plant_fmu import hinge

Array = NDArray[np.float64]
Play = Callable[..., tuple[DrivenPlants, Array]]
H = 0.1
SOLVERS = (Driving(solver="cvode"), Driving(solver="rk4"))


@pytest.fixture(scope="module", params=[2, 3], ids=["fmi2", "fmi3"])
def archive(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Archive:
    return open_archive(hinge.build(request.param, tmp_path_factory.mktemp("hinge")))


@pytest.fixture(params=SOLVERS, ids=["cvode", "rk4"])
def play(archive: Archive, request: pytest.FixtureRequest) -> Iterator[Play]:
    """Return a function that plays a scene, and gives the plants and q at k h."""
    with ExitStack() as stack:

        def played(
            ticks: int, torque: float, q: float = 0.0, qd: float = 0.0, **parameters: float
        ) -> tuple[DrivenPlants, Array]:
            none, wave = np.zeros(1), np.zeros((1, 0))
            body = Body(
                robot=1,
                parameters=parameters,
                kp=np.zeros((1, 1)),
                kd=np.zeros((1, 1)),
                disturbance=Disturbance(np.array([torque]), none, wave, wave, wave),
                q=np.array([q]),
                qd=np.array([qd]),
                position=none,
                velocity=none,
            )
            plants = open_plants(stack, archive, [body], {}, request.param)
            rows = [plants.q[0, 0]]
            for k in range(ticks):
                plants.hold(none[None], none[None])
                plants.advance(k * H, H)
                rows.append(plants.q[0, 0])
            return plants, np.array(rows)

        yield played


def bounces(times: Array, q: float, g: float, e: float) -> Array:
    """Return q(t) of a body that falls from rest at q and keeps e of its speed at each bounce."""
    first, speed, heights = np.sqrt(2 * q / g), np.sqrt(2 * q * g), []
    for t in times:
        begin, v = first, e * speed
        while t > begin + 2 * v / g:
            begin, v = begin + 2 * v / g, e * v
        fall = t - begin
        heights.append(q - g * t**2 / 2 if t < first else v * fall - g * fall**2 / 2)
    return np.array(heights)


def test_a_state_event_is_located_at_its_time(play: Play) -> None:
    _, q = play(12, -9.8, q=1.0, wall=1.0, e=0.8)
    np.testing.assert_allclose(q, bounces(np.arange(13) * H, 1.0, 9.8, 0.8), rtol=0, atol=1e-7)


def test_a_time_event_happens_at_its_time(play: Play) -> None:
    at, t = 0.2337, np.arange(9) * H
    _, q = play(8, 3.0, load=1.0, t_load=at)
    late = np.clip(t - at, 0, None)
    np.testing.assert_allclose(q, 3 * t**2 / 2 - 3 * late**2 / 4, atol=1e-9)


def test_a_time_event_on_a_sampling_time_comes_after_it(play: Play) -> None:
    t = np.arange(6) * H
    _, q = play(5, 3.0, load=1.0, t_load=0.2)
    late = np.clip(t - 0.2, 0, None)
    np.testing.assert_allclose(q, 3 * t**2 / 2 - 3 * late**2 / 4, atol=1e-9)


def test_a_step_event_is_handled(play: Play) -> None:
    t = np.arange(11) * H
    _, q = play(10, 2.0, q=1.0, qd=15.0, turn=1.0)
    assert q.max() <= np.pi
    free = 1 + 15 * t + t**2
    np.testing.assert_allclose(np.exp(1j * q), np.exp(1j * free), atol=1e-7)


def test_each_jump_of_the_torque_is_an_event(play: Play, monkeypatch: pytest.MonkeyPatch) -> None:
    """FMI wants continuous inputs to be continuous but for events; references jump at k h."""
    times, event = [], Exchanged.event

    def noted(robot: Exchanged) -> None:
        times.append(robot.time)
        event(robot)

    monkeypatch.setattr(Exchanged, "event", noted)
    play(4, 3.0)
    assert times == pytest.approx([0.0, H, 2 * H, 3 * H])


def test_an_fmu_that_ends_the_simulation_is_an_error_with_the_time(play: Play) -> None:
    with pytest.raises(StepError, match=r"robot 1 .* at t = 0\.2\d* s: the FMU ended the simul"):
        play(8, 1.0, end=1.0, t_load=0.2)


SCENES = {
    "bounces": (-9.8, {"q": 1.0, "wall": 1.0, "e": 0.8}),
    "loaded before": (3.0, {"load": 1.0, "t_load": 0.2337}),
    "loaded then": (3.0, {"load": 1.0, "t_load": 0.4}),
    "loaded after": (3.0, {"load": 1.0, "t_load": 0.5337}),
    "turns": (2.0, {"q": 1.0, "qd": 15.0, "turn": 1.0}),
}


@pytest.mark.parametrize("scene", SCENES)
def test_a_checkpoint_keeps_past_and_planned_events(play: Play, scene: str) -> None:
    torque, settings = SCENES[scene]
    uninterrupted, _ = play(12, torque, **settings)
    plants, _ = play(4, torque, **settings)
    other, _ = play(0, torque, **settings)
    assert plants.checkpointable
    other.restore(plants.save())
    for k in range(4, 12):
        other.hold(np.zeros((1, 1)), np.zeros((1, 1)))
        other.advance(k * H, H)
    np.testing.assert_array_equal(
        [other.q, other.qd, other.tau], [uninterrupted.q, uninterrupted.qd, uninterrupted.tau]
    )


def test_what_an_fmu_lacks_for_another_drive_is_named(archive: Archive) -> None:
    with pytest.raises(FmuError, match=r"'hold'; .* cvode, rk4, .* CoSimul"):
        choose(archive, {}, Driving(control="hold"))


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("nominal", ["0.0", "-1.0", "NAN"])
def test_a_nominal_value_that_is_not_positive_is_read_as_1_with_a_warning(
    tmp_path: Path, fmi: int, nominal: str
) -> None:
    plants, q = [], []
    for value in (nominal, "1.0"):
        archive = open_archive(hinge.build(fmi, tmp_path, value))
        none, wave = np.zeros(1), np.zeros((1, 0))
        fall = Disturbance(np.array([-1.0]), none, wave, wave, wave)
        zero = np.zeros((1, 1))
        body = Body(1, {}, zero, zero, fall, np.ones(1), none, none, none)
        with ExitStack() as stack:
            plants.append(open_plants(stack, archive, [body], {}, Driving(solver="cvode")))
            plants[-1].advance(0.0, 1.0)
            q.append(plants[-1].q[0, 0])
    assert q[0] == q[1] == pytest.approx(0.5, abs=1e-6)
    drive = "Model Exchange, CVODE rtol 1e-09"
    remark = " (nominal value 1 for states 1-2, whose own is not positive)"
    assert [each.drive for each in plants] == [drive + remark, drive]


def test_a_solver_that_cannot_start_frees_its_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each context, vector, matrix and solver that was made is freed, as many as there were."""
    made, freed = [], []

    def counted(name: str, list_of: list[str]) -> Callable[..., Any]:
        call = getattr(cvode, name)

        def counting(*arguments: Any) -> Any:
            list_of.append(name.rpartition("_")[2])
            return call(*arguments)

        return counting

    for what in ("context", "vector", "matrix", "linear"):
        monkeypatch.setattr(cvode, f"_new_{what}", counted(f"_new_{what}", made))
        monkeypatch.setattr(cvode, f"_free_{what}", counted(f"_free_{what}", freed))

    def refusing() -> Array:
        raise StepError("no nominal values")

    robot = SimpleNamespace(
        states=np.zeros(2),
        states_at=0,
        indicators=np.zeros(0),
        time=0.0,
        tells_steps=False,
        derivatives=None,
        signs=None,
        nominals=refusing,
    )
    with pytest.raises(StepError, match="no nominal values"):
        cvode.Cvode(cast(Exchanged, robot), 1e-9)
    assert made == ["context", "vector", "vector", "matrix", "linear"]
    assert sorted(freed) == sorted(made)
