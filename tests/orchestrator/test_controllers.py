"""What a scenario's controller has beside kp and kd: run, told, counted, and refused."""

import json
from contextlib import ExitStack

import numpy as np
import pytest

import nrs_cosim
from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.analysis.plant_bounds import plant_bounds
from nrs_cosim.orchestrator.analysis.robot_conditions import gain_conditions
from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.orchestrator.scenario.conversion import gains
from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.plants import Body, Control, Disturbance
from nrs_cosim.plant_fmu.urdf_limits import effort_limits
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.report.text import lead, saturated
from tests.command import nrs
from tests.elsewhere.engines import compared
from tests.scenarios import paper, write

SHORT = {"run.duration": 2.0, "run.output_step": 0.1}
POINT = {**SHORT, "plant": {"fmu": "planar_robot", "parameters": {"d": 0.0}}}
BANDWIDTH = {"controller": {"frequency": [3.0, 4.0], "damping": 0.7}}


def states(tmp_path, *changes, name="run"):
    write(tmp_path / f"{name}.toml", *changes)
    done = nrs("run", f"{name}.toml", "-o", f"{name}.mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    return nrs_cosim.Recording(tmp_path / f"{name}.mcap"), done.stdout


def test_a_bandwidth_is_gains_times_the_inertia(tmp_path):
    w, mass = np.array([3.0, 4.0]), 2.0
    by_gains = {"kp": (mass * w**2).tolist(), "kd": (2 * 0.7 * mass * w).tolist()}
    one, _ = states(tmp_path, POINT, BANDWIDTH, name="bandwidth")
    two, _ = states(tmp_path, POINT, {"controller": by_gains}, name="gains")
    with one, two:
        for name in ("position", "velocity", "effort"):
            assert np.abs(one.states()[name] - two.states()[name]).max() < 1e-6


def test_torques_at_their_limits_are_counted_from_what_is_recorded(tmp_path):
    limits = np.array([3000.0, 2000.0])
    recording, text = states(tmp_path, SHORT, {"controller.torque_limit": limits.tolist()})
    with recording:
        effort, robots = recording.states()["effort"], recording.states()["robot"]
        assert np.abs(effort).max(axis=0).tolist() == limits.tolist()
    line = next(row for row in text.splitlines() if row.startswith("limits"))
    share = max((np.abs(effort[robots == r]) >= limits).mean(axis=0).max() for r in range(1, 7))
    assert 0 < share < 1
    assert f"in up to {100 * share:.3g} % of the states" in line
    described = json.loads(nrs("info", "run.mcap", "--json", cwd=tmp_path).stdout)
    found = np.array([described["saturation"][str(robot)] for robot in range(1, 7)])
    assert found.max() == pytest.approx(share)
    with Reader(tmp_path / "run.mcap") as reader:
        heads, *shown = saturated(story := story_of(reader))
    assert heads == ["robot", "joint 1", "joint 2"]
    assert line.split(maxsplit=1)[1] in lead(story)[-1].replace("Torques", "torques")
    largest_first = sorted(range(6), key=lambda at: -found[at].max())
    assert shown == [
        [str(at + 1), *(f"{100 * part:.3g} %" for part in found[at])]
        for at in largest_first
        if found[at].any()
    ]
    assert "is proven is of PD alone, and not with torque_limit" in text


def test_another_engine_comes_to_the_same_bits_with_a_controller_of_all_kinds(tmp_path):
    controller = {
        "controller.torque_limit": [3000.0, 2000.0],
        "controller.gravity_compensation": True,
        "controller.ki": 3.0,
    }
    recording, _ = states(tmp_path, {"run.duration": 1.0}, controller)
    recording.close()
    done = nrs("export", "run.mcap", "--to", "ssp", "-o", "run.ssp", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    size, same, _ = compared("fmpy", tmp_path / "run.ssp")
    assert size == same > 0


def test_without_weight_the_proof_holds_without_it():
    (plain,) = plant_bounds(paper({}))
    (without,) = plant_bounds(paper({"controller.gravity_compensation": True}))
    assert without.bounds.lambda_g == 0.0 < plain.bounds.lambda_g
    assert without.constants is not None
    for key in ("torque_limit", "ki"):
        (part,) = plant_bounds(paper({f"controller.{key}": 5.0}))
        assert part.bounds is None
        assert part.why == f"what is proven is of PD alone, and not with {key}"


def test_a_robots_own_gains_take_the_place_of_a_bandwidth_and_the_other_way_round():
    experiment = paper(
        BANDWIDTH,
        {
            "robots": [
                {"id": 1, "controller": {"kp": 5.0, "kd": 6.0}},
                {"id": 2, "controller": {"damping": 1.0}},
                {"id": 3, "controller": {"torque_limit": 7.0}},
            ]
        },
    )
    found = [gains(experiment.of_robot(robot).controller, 2) for robot in (1, 2, 3, 4)]
    kd = [np.diag(kd).tolist() for _, kd in found]
    assert np.diag(found[0][0]).tolist() == [5.0, 5.0]
    assert kd[0] == [6.0, 6.0]
    assert kd[1] == [6.0, 8.0]
    assert kd[2] == kd[3] == pytest.approx([4.2, 5.6])
    assert [(c.name, c.value) for c in gain_conditions(experiment)] == [("kp", 5.0), ("kd", 6.0)]
    assert gain_conditions(paper(BANDWIDTH)) == []  # nobody gave any
    bodies = experiment.bodies()
    assert [body.control.inertia_scaling for body in bodies[:4]] == [False, True, True, True]
    assert bodies[2].control.torque_limit.tolist() == [7.0, 7.0]


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"controller": {"kp": 1.0}}, "controller: expected kp and kd, or frequency"),
        (
            {"controller.frequency": 2.0},
            "controller.kp: cannot be given beside controller.frequency",
        ),
        (
            {"controller.computed_torque": True},
            "controller.computed_torque: has no use without controller.frequency",
        ),
        ({"controller.torque_limit": 0.0}, "controller.torque_limit: expected greater than 0"),
        ({"controller.torque_limit": [1.0]}, "controller.torque_limit: expected 2 entries"),
        ({"controller.torque_limit": "most"}, "controller.torque_limit: expected"),
        (
            {
                "controller": {
                    "frequency": 2.0, "computed_torque": True, "gravity_compensation": True
                }
            },
            "controller.gravity_compensation: computed_torque has it already",
        ),
        (
            {"plant.parameters.torque_limit": 4.0},
            "plant.parameters.torque_limit: give it as controller.torque_limit instead",
        ),
    ],
)  # fmt: skip
def test_a_controller_that_cannot_be_is_refused(changes, fault):
    with pytest.raises(InputError, match=fault.replace(".", r"\.").replace("[", r"\[")):
        paper(changes)


URDF = """<robot name="r"><joint name="a" type="revolute"><limit effort="87" velocity="2"/></joint>
<joint name="b" type="prismatic"><limit effort="12.5"/></joint><joint name="c"/></robot>"""


ZERO = '<joint name="d" type="revolute"><limit effort="0"/></joint></robot>'


def test_efforts_are_those_of_the_joints_in_the_urdf():
    assert effort_limits(URDF, ["b", "a"]).tolist() == [12.5, 87.0]
    with pytest.raises(ValueError, match="no effort above 0 in <limit> of joint c"):
        effort_limits(URDF, ["a", "c"])
    with pytest.raises(ValueError, match=r"no effort above 0 in <limit> of joints c, d$"):
        effort_limits(URDF.replace("</robot>", ZERO), ["c", "a", "d"])
    with pytest.raises(ValueError, match="there is no URDF in it"):
        effort_limits("", ["a"])


def body(control):
    still = Disturbance(np.array([0.5, 0.0]), np.array([0.0, 0.3]), *np.zeros((3, 2, 0)))
    start = np.array([1.0, -2.0]), np.zeros(2), np.zeros(2), np.zeros(2)
    gains = 30.0 * np.eye(2), 9.0 * np.eye(2)
    return Body(1, {}, *gains, still, *start, control=control)


def driven(archive, control, driving, *acceleration):
    with ExitStack() as stack:
        plants = open_plants(stack, archive, [body(control)], {}, driving)
        plants.hold(np.array([[2.0, 1.0]]), np.array([[0.3, -0.5]]), *acceleration)
        for k in range(5):
            plants.advance(k * 0.1, 0.1)
        return np.hstack([plants.q, plants.qd, plants.tau])


@pytest.mark.parametrize(
    ("driving", "tolerance"),
    [
        (Driving(solver="cvode"), 1e-6),
        (Driving(solver="rk4", step=1e-3), 1e-5),
        (Driving(control="heun", control_step=1e-3), 1e-3),
        (Driving(control="hold", control_step=1e-3), 3e-2),
    ],
)
def test_a_torque_limit_is_the_same_however_a_plant_is_driven(driving, tolerance):
    archive = open_archive(build("planar_robot"))
    control = Control(torque_limit=np.array([25.0, 12.0]))
    wanted = driven(archive, control, Driving())
    found = driven(archive, control, driving)
    assert np.abs((found - wanted) / (1 + np.abs(wanted))).max() < tolerance
    assert np.abs(driven(archive, Control(), driving) - wanted).max() > 0.1


@pytest.mark.parametrize("driving", [Driving(solver="cvode"), Driving(solver="rk4", step=2e-3)])
@pytest.mark.parametrize(
    "control",
    [
        Control(gravity_compensation=True),
        Control(inertia_scaling=True),
        Control(computed_torque=True, torque_limit=np.array([150.0, 90.0])),
        Control(acceleration_feedforward=True, gravity_compensation=True, inertia_scaling=True),
        Control(ki=4.0 * np.eye(2), gravity_compensation=True, inertia_scaling=True),
    ],
)
def test_in_model_exchange_the_law_is_that_of_the_model(driving, control):
    """The same FMU, whose own law has been compared with one that is written out."""
    archive, bend = open_archive(build("two_link_arm")), np.array([[2.0, -1.0]])
    wanted = driven(archive, control, Driving(), bend)
    found = driven(archive, control, driving, bend)
    assert np.abs((found - wanted) / (1 + np.abs(wanted))).max() < 1e-5
    assert np.abs(driven(archive, Control(), driving, bend) - wanted).max() > 0.01


def test_what_a_held_torque_cannot_have_is_refused_with_the_way():
    archive = open_archive(build("planar_robot"))
    with pytest.raises(FmuError, match="gravity_compensation, as the controller of robot 1 wants"):
        driven(archive, Control(gravity_compensation=True), Driving(control="hold"))
    control = Control(limited_by_effort=True)
    with pytest.raises(
        FmuError, match=r"controller\.torque_limit of robot 1: there is no URDF in it; give"
    ):
        driven(archive, control, Driving())
