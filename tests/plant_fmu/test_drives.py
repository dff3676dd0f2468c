"""Every way of driving a plant: one class of tests for all, and the paper's arms against DOP853."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
from numpy.typing import NDArray

from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.drives.choice import Driving, Undriven, choose, offers
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError, StepError
from nrs_cosim.plant_fmu.fleet import Fleet
from nrs_cosim.plant_fmu.plants import Body, Disturbance, DrivenPlants
from tests.cases import cases
from tests.orchestrator.run_oracle import KD, KP, W, simulate, target
from tests.plant_fmu.rewritten_fmus import rewritten

Array = NDArray[np.float64]
Open = Callable[..., DrivenPlants]
H, ALPHA, BETA, PARTS = 0.1, 0.9, 1.1, 5
DRIVES = {
    "reference": Driving(),
    "cvode": Driving(solver="cvode"),
    "rk4": Driving(solver="rk4"),
    "heun": Driving(control="heun", control_step=0.001),
    "hold": Driving(control="hold"),
}
each_drive = pytest.mark.parametrize("driving", DRIVES.values(), ids=DRIVES)
each_version = pytest.mark.parametrize("fmi", [2, 3])


def disturbance() -> Disturbance:
    """The paper's: 2 sin t and 2 cos 2t."""
    none = np.zeros(2)
    return Disturbance(
        none, none, np.full((2, 1), 2.0), np.array([[1.0], [2.0]]), np.array([[0.0], [np.pi / 2]])
    )


def bodies(n: int = 6) -> list[Body]:
    """The paper's arms near the target: from afar, a torque that is held errs by far more."""
    draw, (position, velocity) = np.random.default_rng(7), target(0.0)
    near = {"q": position, "qd": velocity, "position": position, "velocity": velocity}
    return [
        Body(
            robot=row + 1,
            parameters={},
            kp=KP * np.eye(2),
            kd=KD * np.eye(2),
            disturbance=disturbance(),
            **{name: value + draw.uniform(-0.5, 0.5, 2) for name, value in near.items()},
        )
        for row in range(n)
    ]


@pytest.fixture
def opened() -> Iterator[Open]:
    """Return a function that opens plants of the bundled arm."""
    with ExitStack() as stack:

        def plants(fmi: int, driving: Driving, of: list[Body]) -> DrivenPlants:
            return open_plants(stack, open_archive(build("two_link_arm", fmi)), of, {}, driving)

        yield plants


@pytest.fixture(scope="module")
def oracle() -> tuple[list[tuple[Array, Array]], Array]:
    """Return what six arms hold at each t_k, and their q there, for 4 s."""
    start = bodies()
    first = [np.array([getattr(b, name) for b in start]) for name in ("position", "velocity")]
    states = [np.array([getattr(b, name) for b in start]) for name in ("q", "qd")]
    times, q, estimates = simulate(1, ALPHA, BETA, H, 4, *first, *states)
    share, held = W / W.sum(axis=1, keepdims=True), [(first[0], first[1])]
    for t, (position, velocity) in zip(times[1:], estimates[1:], strict=True):
        e0, v0 = target(t)
        held.append(
            (
                position + ALPHA * (share @ np.vstack([e0, position]) - position),
                velocity + BETA * (share @ np.vstack([v0, velocity]) - velocity),
            )
        )
    return held, q


def play(plants: DrivenPlants | Fleet, held: Any, first: int, last: int) -> Array:
    """Return q, qd and tau at the ends of the intervals from one tick to another."""
    rows = []
    for k in range(first, last):
        plants.hold(*held[k])
        for part in range(PARTS):
            plants.advance(k * H + part * H / PARTS, H / PARTS)
        rows.append(np.concatenate([plants.q, plants.qd, plants.tau], axis=1))
    return np.array(rows)


BOUNDS = {"reference": 1e-8, "cvode": 1e-7, "rk4": 1e-6, "heun": 5e-5, "hold": 5e-3}
"""rad"""


class TestEveryDrive:
    """What the plants promise, however they are driven."""

    @each_version
    @pytest.mark.parametrize("name", DRIVES)
    def test_a_drive_agrees_with_dop853(
        self, opened: Open, oracle: Any, name: str, fmi: int
    ) -> None:
        held, q = oracle
        plants = opened(fmi, DRIVES[name], bodies())
        error = np.abs(play(plants, held, 0, len(held) - 1)[:, :, :2] - q[1:]).max()
        assert error < BOUNDS[name]

    @each_drive
    def test_a_drive_begins_at_the_given_states(self, opened: Open, driving: Driving) -> None:
        of = bodies(2)
        plants = opened(3, driving, of)
        for row, body in enumerate(of):
            np.testing.assert_array_equal(plants.q[row], body.q)
            np.testing.assert_array_equal(plants.qd[row], body.qd)
            tau = KP * (body.position - body.q) + KD * (body.velocity - body.qd)
            np.testing.assert_allclose(plants.tau[row], tau, rtol=1e-12)

    @each_drive
    def test_the_torque_is_that_of_the_pd_law_at_the_time_reached(
        self, opened: Open, oracle: Any, driving: Driving
    ) -> None:
        held, _ = oracle
        plants = opened(3, driving, bodies())
        play(plants, held, 0, 2)
        position, velocity = held[1]
        tau = KP * (position + H * velocity - plants.q) + KD * (velocity - plants.qd)
        np.testing.assert_allclose(plants.tau, tau, rtol=1e-9, atol=1e-9)

    @each_drive
    def test_a_robot_moves_by_the_same_bits_in_any_group(
        self, opened: Open, oracle: Any, driving: Driving
    ) -> None:
        held, _ = oracle
        calm = np.zeros((2, 3))
        all_of = bodies()
        all_of[0] = replace(
            all_of[0], disturbance=Disturbance(np.ones(2), np.ones(2), calm, calm, calm)
        )
        alone = [(position[3:4], velocity[3:4]) for position, velocity in held]
        together = play(opened(3, driving, all_of), held, 0, 3)
        by_itself = play(opened(3, driving, all_of[3:4]), alone, 0, 3)
        np.testing.assert_array_equal(together[:, 3:4], by_itself)

    @each_version
    @each_drive
    def test_a_checkpoint_continues_to_the_same_bits(
        self, opened: Open, oracle: Any, driving: Driving, fmi: int
    ) -> None:
        held, _ = oracle
        plants, other = (opened(fmi, driving, bodies()) for _ in range(2))
        assert plants.checkpointable
        play(plants, held, 0, 2)
        saved, there = plants.save(), plants.tau.copy()
        onwards = play(plants, held, 2, 4)
        for resumed in (plants, other):
            resumed.restore(saved)
            np.testing.assert_array_equal(resumed.tau, there)
            np.testing.assert_array_equal(play(resumed, held, 2, 4), onwards)

    @each_drive
    def test_a_checkpoint_of_other_robots_is_refused(self, opened: Open, driving: Driving) -> None:
        two, three, other = (opened(fmi, driving, bodies(n)) for fmi, n in ((3, 2), (3, 3), (2, 2)))
        first, second = two.save()
        for data, words in (
            (three.save(), "got checkpoints of 3 robots, expected 2"),
            (other.save(), "checkpoint given to robot 1 is of an FMU with sha256 .*, this one has"),
            ([first, second[:-3]], r"to robot 2 has \d+ bytes, expected \d+"),
            ([first, second[:9]], "a checkpoint of 9 bytes is not whole"),
        ):
            with pytest.raises(FmuError, match=words):
                two.restore(data)

    @each_drive
    def test_checkpoints_of_two_times_are_refused(self, opened: Open, driving: Driving) -> None:
        plants = opened(3, driving, bodies(2))
        first, _ = plants.save()
        plants.advance(0.0, H)
        _, second = plants.save()
        with pytest.raises(FmuError, match=r"some of t = 0 s and some of t = 0\.1 s"):
            plants.restore([first, second])

    @each_drive
    def test_a_step_that_fails_names_the_robot_the_fmu_and_the_time(
        self, opened: Open, driving: Driving
    ) -> None:
        plants = opened(3, driving, bodies(2))
        wild = np.array([[0.0, 0.0], [1e200, 0.0]])
        words = r"robot 2 \(.*two_link_arm.*\) at t = 0"
        with np.errstate(all="ignore"), pytest.raises(StepError, match=words):  # noqa: PT012
            plants.hold(np.zeros((2, 2)), wild)
            plants.advance(0.0, H)


TICKS = 12
RESUME = """
import sys
from contextlib import ExitStack
from tests.plant_fmu.test_drives import *
fmi, first, last, *names = sys.argv[1:]
rows = slice(int(first), int(last))
saved = iter([bytes.fromhex(line) for line in sys.stdin])
with ExitStack() as stack:
    for name in names:
        archive = open_archive(build("two_link_arm", int(fmi)))
        plants = open_plants(stack, archive, bodies()[rows], {}, DRIVES[name])
        plants.restore([next(saved) for _ in plants.q])
        print(play(plants, wandering(rows), 3, TICKS).tobytes().hex())
"""


def wandering(rows: slice) -> list[tuple[Array, Array]]:
    """Return references that jump at each t_k, a row a robot."""
    draw, (position, velocity) = np.random.default_rng(11), target(0.0)
    asides = draw.uniform(-0.5, 0.5, (TICKS, 2, 6, 2))
    return [
        (position + k * H * velocity + aside[0, rows], velocity + aside[1, rows])
        for k, aside in enumerate(asides)
    ]


@pytest.mark.parametrize("fmi", cases([2, 3], [3]))
def test_a_fresh_process_continues_some_robots_to_the_same_bits(opened: Open, fmi: int) -> None:
    saved, onwards = [], []
    for driving in DRIVES.values():
        plants, never_saved = (opened(fmi, driving, bodies()) for _ in range(2))
        play(plants, wandering(slice(6)), 0, 3)
        saved.append(plants.save())
        onwards.append(play(never_saved, wandering(slice(6)), 0, TICKS)[3:])
        np.testing.assert_array_equal(play(plants, wandering(slice(6)), 3, TICKS), onwards[-1])
    for first, last in ((0, 2), (2, 6)):
        done = subprocess.run(
            [sys.executable, "-c", RESUME, str(fmi), str(first), str(last), *DRIVES],
            input="\n".join(row.hex() for rows in saved for row in rows[first:last]),
            capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2],
        )  # fmt: skip
        for line, name, whole in zip(done.stdout.split(), DRIVES, onwards, strict=True):
            assert line == whole[:, first:last].tobytes().hex(), name


@each_drive
def test_a_robots_checkpoint_is_the_same_in_any_group(opened: Open, driving: Driving) -> None:
    saved = []
    for row in (slice(6), slice(3), slice(3, 6)):
        plants = opened(3, driving, bodies()[row])
        play(plants, wandering(row), 0, 2)
        saved.append(plants.save())
    whole, *parts = saved
    assert whole == parts[0] + parts[1]


def test_a_fleet_is_saved_and_restored_with_all_groups(opened: Open, oracle: Any) -> None:
    held, _ = oracle
    of = bodies()

    def fleet(cvode: list[int], reference: list[int]) -> Fleet:
        """Return robots of two FMUs, each driven in its way."""
        groups = ((cvode, 2, "cvode"), (reference, 3, "reference"))
        all_of = sorted(cvode + reference)
        return Fleet(
            [
                (
                    np.array([all_of.index(row) for row in rows]),
                    opened(fmi, DRIVES[name], [of[row] for row in rows]),
                )
                for rows, fmi, name in groups
            ],
            2,
        )

    whole = fleet([0, 2, 4], [1, 3, 5])
    assert whole.checkpointable
    play(whole, held, 0, 2)
    saved, there, onwards = whole.save(), whole.q.copy(), play(whole, held, 2, 4)
    for cvode, reference in (([0, 2, 4], [1, 3, 5]), ([0, 4], [1]), ([2], [3, 5])):
        rows = sorted(cvode + reference)
        part = fleet(cvode, reference)
        part.restore([saved[row] for row in rows])
        np.testing.assert_array_equal(part.q, there[rows])
        theirs = [(position[rows], velocity[rows]) for position, velocity in held]
        np.testing.assert_array_equal(play(part, theirs, 2, 4), onwards[:, rows])
    with pytest.raises(FmuError, match=r"some of t = 0\.2 s and some of t = 0\.4 s"):
        whole.restore([*saved[:5], whole.save()[5]])


# An FMU from elsewhere, made of a bundled one


@pytest.fixture
def altered(tmp_path: Path) -> Callable[..., Archive]:
    """Return a function that gives the bundled arm with some of its description replaced."""

    def archive(fmi: int, *replacements: tuple[str, str]) -> Archive:
        path = tmp_path / f"altered{fmi}.fmu"
        with ZipFile(build("two_link_arm", fmi)) as old, ZipFile(path, "w") as new:
            for name in old.namelist():
                data = old.read(name)
                if name == "modelDescription.xml":
                    for was, becomes in replacements:
                        assert was.encode() in data
                        data = data.replace(was.encode(), becomes.encode())
                new.writestr(name, data)
        return open_archive(path)

    return archive


STATELESS = {
    2: (('canGetAndSetFMUstate="true"', ""), ('canSerializeFMUstate="true"', "")),
    3: (('canGetAndSetFMUState="true"', ""), ('canSerializeFMUState="true"', "")),
}


@each_version
@pytest.mark.parametrize("name", ["reference", "cvode", "rk4", "hold"])
@pytest.mark.parametrize("lacking", [slice(2), slice(1), slice(1, 2)], ids=["both", "get", "bytes"])
def test_an_fmu_without_states_has_no_checkpoint(
    altered: Callable[..., Archive], name: str, fmi: int, lacking: slice
) -> None:
    with ExitStack() as stack:
        archive = altered(fmi, *STATELESS[fmi][lacking])
        assert not open_plants(stack, archive, bodies(1), {}, DRIVES[name]).checkpointable


@each_version
def test_a_drive_is_offered_where_the_fmu_supports_it(
    altered: Callable[..., Archive], fmi: int
) -> None:
    def ways(*replacements: tuple[str, str]) -> list[str]:
        return [offer.way for offer in offers(altered(fmi, *replacements), {})]

    assert ways() == ["reference", "cvode", "rk4", "heun", "hold"]
    assert ways(("position_ref", "wanted")) == ["cvode", "rk4", "heun", "hold"]
    assert ways(*STATELESS[fmi]) == ["reference", "cvode", "rk4", "hold"]
    assert ways(('"qd', '"speed'), ('"der(q', '"rate(q')) == []
    tau = {2: '"tau[', 3: '"tau"'}[fmi]
    assert ways((tau, tau.replace("tau", "torque"))) == ["reference"]


def test_a_requested_drive_is_taken_or_refused(altered: Callable[..., Archive]) -> None:
    archive = altered(3)
    assert choose(archive, {}, Driving(solver="rk4")).way == "rk4"
    assert choose(archive, {}, Driving(threads=True)).way == "reference"
    refused = {
        Driving(solver="cvode", control="hold"): r"solver = 'cvode' and plant.control = 'hold' exc",
        Driving(control_step=0.01): r"control_step = 0.01 has no use, .* 'reference'; .* 'hold'",
        Driving(
            solver="cvode", step=0.01
        ): r"plant.step = 0.01 has no use, .* by 'cvode'; .* 'rk4'",
        Driving(solver="rk4", threads=True): r"plant.threads = true has no use, .* by 'rk4'",
    }
    for driving, words in refused.items():
        with pytest.raises(FmuError, match=words):
            choose(archive, {}, driving)
    with pytest.raises(FmuError, match=r"'heun'; .* reference, cvode, rk4, hold, .* canGetAndSet"):
        choose(altered(3, *STATELESS[3]), {}, Driving(control="heun"))
    with pytest.raises(FmuError, match=r"has no variable 'effort'"):
        choose(archive, {"tau": "effort"}, Driving())


@each_version
def test_a_fixed_step_fmu_is_driven_by_model_exchange(
    fmi: int, altered: Callable[..., Archive]
) -> None:
    can = ('canHandleVariableCommunicationStepSize="true"', "")
    archive = altered(fmi, can)
    assert choose(archive, {}, Driving()).way == "reference"
    assert choose(archive, {}, Driving(uneven=True)).way == "cvode"
    words = "are cvode, rk4, and it lacks .*canHandleVariableCommunicationStepSize, for sampling"
    with pytest.raises(FmuError, match=words):
        choose(archive, {}, Driving(control="hold", uneven=True))


@each_version
def test_an_unreported_torque_is_computed_by_the_pd_law(
    altered: Callable[..., Archive], oracle: Any, opened: Open, fmi: int
) -> None:
    held, _ = oracle
    with ExitStack() as stack:
        silent = open_plants(
            stack, altered(fmi, ('"tau_applied', '"something')), bodies(), {}, Driving()
        )
        result = play(opened(fmi, Driving(), bodies()), held, 0, 2)
        np.testing.assert_allclose(play(silent, held, 0, 2), result, rtol=1e-10, atol=1e-9)


def test_a_disturbance_that_the_drive_cannot_take_is_refused(
    altered: Callable[..., Archive],
) -> None:
    archive = altered(3, ('"disturbance_rate', '"drift'))
    calm = replace(bodies(1)[0], disturbance=Disturbance(*np.zeros((2, 2)), *np.zeros((3, 2, 0))))
    with ExitStack() as stack:
        open_plants(stack, archive, [calm], {}, Driving())
        with pytest.raises(FmuError, match=r"disturbance of robot 1: .* no variable disturbance_r"):
            open_plants(stack, archive, bodies(1), {}, Driving())


# How large a step may be, and what it costs


@each_version
def test_a_control_step_beyond_the_limit_is_refused_with_the_figure(opened: Open, fmi: int) -> None:
    for control in ("hold", "heun"):
        with pytest.raises(
            FmuError, match=r"control_step = 0.05 s is beyond .* about 0.034 s .* 1:"
        ):
            opened(fmi, Driving(control=control, control_step=0.05), bodies(1))
    with pytest.raises(
        FmuError, match=r"^step = 0.06 s is beyond the stability limit of about 0.04"
    ):
        opened(fmi, Driving(solver="rk4", step=0.06), bodies(1))


def test_the_control_step_limit_is_that_of_the_highest_gains(opened: Open) -> None:
    of = bodies(3)
    of[1] = replace(of[1], kd=1000 * np.eye(2))
    with pytest.raises(FmuError, match=r"about 0.01 s estimated for robot 2"):
        opened(3, Driving(control="hold", control_step=0.02), of)


@pytest.mark.parametrize("step", [0.005, 0.001])
@pytest.mark.parametrize("control", ["hold", "heun"])
def test_the_stated_error_of_a_held_torque_is_close_to_the_real_one(
    opened: Open, oracle: Any, control: Any, step: float
) -> None:
    held, q = oracle
    plants = opened(3, Driving(control=control, control_step=step), bodies())
    stated = float(plants.drive.partition("about ")[2].partition(" rad")[0])
    made = np.abs(play(plants, held, 0, len(held) - 1)[:, :, :2] - q[1:]).max()
    assert made / 3 < stated < 10 * made


CLOCK = (
    '<Clock name="{}" valueReference="9999" causality="input" intervalVariability="{}" '
    'intervalDecimal="0.1"/></ModelVariables>'
)


@pytest.mark.parametrize("interval", ["constant", "triggered"])
def test_an_fmu_with_clocks_is_not_driven_by_model_exchange(tmp_path: Path, interval: str) -> None:
    def clocked(text: str) -> str:
        return text.replace("</ModelVariables>", CLOCK.format("beat", interval))

    archive = open_archive(rewritten(tmp_path / "arm.fmu", 3, clocked), "arm.fmu")
    assert choose(archive, {}, Driving()).way == "reference"
    if interval == "triggered":
        assert choose(archive, {}, Driving(solver="cvode")).way == "cvode"
        return
    with pytest.raises(FmuError, match=r"lacks .*an environment that ticks its clocks beat"):
        choose(archive, {}, Driving(solver="cvode"))
    archive.description.coSimulation = None
    names = {"position": "q", "velocity": "qd"}
    with (
        ExitStack() as stack,
        pytest.raises(FmuError, match="its clocks beat would have to be ticked from outside"),
    ):
        open_plants(stack, archive, bodies(1), names, Undriven())
