"""An FMU that moves by steps of its own is probed by them, and never blamed for them."""

import re
import shutil
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from nrs_cosim.orchestrator.cli.fmu_commands import check_task
from nrs_cosim.orchestrator.engine.units import other_rates
from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.checking.budget import Budget
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.mechanics import MechanicsProbe, open_probe
from nrs_cosim.plant_fmu.checking.procedure import findings
from nrs_cosim.plant_fmu.checking.running import running
from nrs_cosim.plant_fmu.checking.sampling import sampled
from nrs_cosim.plant_fmu.checking.subprocess_check import check, p3_of
from nrs_cosim.plant_fmu.drives.choice import Driving, choose, offers
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError, UnstableStepError
from nrs_cosim.plant_fmu.plants import Body, Disturbance
from tests.cases import cases
from tests.plant_fmu.stepping import INERTIA, build_stepping
from tests.plant_fmu.test_check import PHYSICS, found, statuses

pytestmark = [
    pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler"),
    pytest.mark.filterwarnings("ignore::RuntimeWarning"),
]

STEPS = (1e-4, 1e-3, 1 / 300, 0.01, 0.02, 0.05)
"""s"""
NONE, ONE = np.zeros(2), np.eye(2)


def body(kp=ONE, kd=ONE):
    still = Disturbance(NONE, NONE, *np.zeros((3, 2, 0)))
    return Body(1, {}, kp, kd, still, q=NONE, qd=NONE, position=NONE, velocity=NONE)


def inertia(path):
    archive = open_archive(path)
    offered, chosen = offers(archive, {}), choose(archive, {}, Driving())
    with ExitStack() as stack:
        opened = open_probe(stack, archive, body(), {}, offered, chosen)
        mechanics = MechanicsProbe(opened, body(), Budget())
        return mechanics.stairs, np.linalg.inv(mechanics.mobility(NONE + 0.2, mechanics.spans[0]))


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("fmi", cases([2, 3], [3]))
def test_the_inertia_of_joints_with_internal_steps_is_found(tmp_path, step, fmi):
    """But for ω² d²/8 of a spring, by which Euler's method is off, with ω² < 4 here."""
    stairs, mass = inertia(build_stepping(tmp_path / "a.fmu", step, fmi))
    assert stairs.internal == pytest.approx(step, rel=1e-6)
    np.testing.assert_allclose(mass, INERTIA, rtol=1e-6 + step**2)


@pytest.mark.parametrize("step", [1e-3, 0.01, 0.02])
def test_correct_joints_with_internal_steps_pass(tmp_path, step):
    checked = check(CheckTask(open_archive(build_stepping(tmp_path / "a.fmu", step))))
    result = dict.fromkeys(PHYSICS, "holds")
    if step > 1e-3:  # q̈ is known to d times its rate, which is more than the tolerance
        result["power"] = "unknown"
        assert f"as its internal step of {step:g} s alone" in found(checked, "power").text
    assert statuses(checked) == result
    assert checked.passes
    ratio = np.divide(*np.linalg.eigvalsh(INERTIA))
    assert found(checked, "M positive definite").value == pytest.approx(ratio, rel=1e-2)
    alone = found(checked, "alone")  # at rest at its start: it is its reference that moves it
    assert alone.status == "holds"
    assert alone.value > 0.01
    assert "aside from 1 s on" in alone.text


@pytest.mark.parametrize("at", [0.25, -0.25])
def test_joints_held_by_a_unit_torque_are_probed(tmp_path, at):
    """Their springs pull by 4 q, that is by 1."""
    archive = open_archive(build_stepping(tmp_path / "a.fmu", 0.01))
    start = replace(body(), q=NONE + at, position=NONE + at)
    checked = check(CheckTask(archive, start))
    ratio = np.divide(*np.linalg.eigvalsh(INERTIA))
    assert found(checked, "M positive definite").value == pytest.approx(ratio, rel=1e-2)


def test_joints_that_stop_moving_after_a_reset_are_unknown(tmp_path):
    path = build_stepping(tmp_path / "a.fmu", 1e-3, lasting=True)
    checked = check(CheckTask(open_archive(path)))
    result = dict.fromkeys(PHYSICS, "holds") | dict.fromkeys(("rests", "power"), "unknown")
    assert statuses(checked) == result
    for name in ("rests", "power"):
        assert "nothing moves by a torque on joints 1-2" in found(checked, name).text
        assert found(checked, name).text.endswith("see the finding on its reset")


DECLARED = {
    "FMI 3, fixedInternalStepSize": (
        3,
        lambda text: text.replace(
            '<CoSimulation modelIdentifier="stepping"',
            '<CoSimulation modelIdentifier="stepping" fixedInternalStepSize="0.02"',
        ),
    ),
    "FMI 2, steps of the default experiment alone": (
        2,
        lambda text: text.replace(' canHandleVariableCommunicationStepSize="true"', "").replace(
            "<ModelVariables>", '<DefaultExperiment stepSize="0.02"/><ModelVariables>'
        ),
    ),
}


@pytest.mark.parametrize("how", DECLARED)
def test_a_fixed_step_fmu_is_only_asked_for_its_step(tmp_path, how):
    fmi, edit = DECLARED[how]
    path = build_stepping(tmp_path / "a.fmu", 0.02, fmi, strict=True, edit=edit)
    stairs, mass = inertia(path)
    assert stairs.internal == 0.02
    np.testing.assert_allclose(mass, INERTIA, rtol=4e-4)
    checked = check(CheckTask(open_archive(path), body(), driving=Driving(control_step=0.02)))
    assert statuses(checked) == {**dict.fromkeys(PHYSICS, "holds"), "power": "unknown"}


INVERSE = np.linalg.inv(INERTIA)
DEGREES = 180 / np.pi
WRONG = {
    "rate": {"rate": DEGREES},
    "M symmetric": {"mobility": INVERSE + np.array([[0.0, 0.1], [0.0, 0.0]])},
    "M positive definite": {"mobility": INVERSE @ np.diag([1.0, -1.0]) @ INVERSE},
    "power": {"damping": -4.0},
}


@pytest.mark.parametrize("step", cases([1e-3, 0.02], [0.02]))
@pytest.mark.parametrize("wrong", cases([*WRONG], [*WRONG][1:]))
def test_wrong_mechanics_with_internal_steps_are_found(tmp_path, wrong, step):
    checked = check(
        CheckTask(open_archive(build_stepping(tmp_path / "a.fmu", step, **WRONG[wrong])))
    )
    assert not checked.passes
    assert [n for n, status in statuses(checked).items() if status == "fails"] == [wrong]


def test_degrees_beside_rad_per_s_are_told_before_a_run_and_have_no_p3(tmp_path):
    archive = open_archive(build_stepping(tmp_path / "a.fmu", 0.02, rate=DEGREES))
    said = "q of joints 1-2 moves about 57 times as fast as qd says; q in degrees?"
    with pytest.raises(FmuError, match=re.escape(f"qd is not the rate of q: {said}")):
        sampled(CheckTask(archive, body()), Budget())
    with ExitStack() as stack:
        drive = open_plants(stack, archive, [body()], {}, Driving(control_step=0.02)).drive
    assert drive.endswith(f"; qd is not the rate of q: {said}")
    assert other_rates([("a.fmu", drive), ("b.fmu", "as ever")]) == [
        f"a.fmu: qd is not the rate of q: {said}; nrs fmu check looks at it"
    ]


NAMED = {"q": "angle", "qd": "speed", "tau": "torque"}
PROPOSED: dict[str, Any] = {
    "right ones": ({}, ["", "is right as far as it moves"]),
    "a torque against its sign": (
        {"mobility": np.linalg.inv(INERTIA) * [1, -1]},
        ["none of 2 joints: with q = ", "torque acts against its sign on joint 2"],
    ),
    "torques exchanged": (
        {"mobility": np.linalg.inv(INERTIA)[:, ::-1]},
        ["none of 2 joints: with q = ", "it would hold with the numbers of tau in the order 2, 1"],
    ),
    "degrees": ({"rate": DEGREES}, ["none: with q = ", "about 57 times as fast as qd says"]),
}


@pytest.mark.parametrize("case", cases([*PROPOSED], ["a torque against its sign"]))
def test_names_are_proposed_if_a_check_holds_nothing_against_them(tmp_path, case):
    """Else what failed of those of most joints is told. Names tell the joints, which are two."""
    how, (begins, says) = PROPOSED[case]

    def edit(text):
        joint = ("", "shoulder", "elbow")
        return re.sub(
            r'name="(\w+)\[(.)\]"', lambda m: f'name="{joint[int(m[2])]}_{NAMED[m[1]]}"', text
        )

    path = build_stepping(tmp_path / "a.fmu", 0.02, edit=edit, **how)
    task = CheckTask(open_archive(path))
    first, *others = (f.text for f in findings(task, Budget()) if f.name == "proposal")
    assert first.startswith(begins)
    assert says in first
    assert bool(others) == begins.startswith("none of")
    assert ('["' in "".join(others)) is False  # one joint alone


def test_a_proposal_has_no_name_that_is_not_there_and_as_many_numbers_as_joints(tmp_path):
    """Of a misspelt q and of one tau of two; the line may be pasted whole."""
    archive = open_archive(build_stepping(tmp_path / "a.fmu", 0.02))
    given_names = [' variables = { q = ["q[1]", "q[3]"] } ', 'tau = "tau[1]"']
    for given in cases(given_names, given_names[:1]):
        found = {f.name: f for f in findings(check_task(archive, None, given), Budget())}
        assert found["chosen"].status == "fails"
        assert found["proposal"].text.startswith("is right as far as it moves")
        assert "q[3]" not in found["proposal"].text
        assert '"tau[1]"' not in found["proposal"].text


def test_an_energy_gain_that_internal_steps_may_explain_is_unknown(tmp_path):
    """Steps of 50 ms tell q̈ to d times its rate, far more than damping of -0.02 gains."""
    path = build_stepping(tmp_path / "a.fmu", 0.05, damping=-0.02)
    power = found(check(CheckTask(open_archive(path))), "power")
    assert power.status == "unknown"
    assert "its internal step of 0.05 s" in power.text


@pytest.mark.parametrize("case", ["too long a step", "no torque that acts"])
def test_an_fmu_that_does_not_move_is_unknown(tmp_path, case):
    step, mobility = (9.0, None) if case == "too long a step" else (0.01, np.zeros((2, 2)))
    checked = check(
        CheckTask(open_archive(build_stepping(tmp_path / "a.fmu", step, mobility=mobility)))
    )
    assert statuses(checked) == {"mechanics": "unknown"}
    text = found(checked, "mechanics").text
    assert text.startswith("cannot be probed: nothing moves within 1 s")
    assert text.endswith("has it a longer internal step?")
    assert checked.passes


def test_a_joint_that_does_not_move_is_named(tmp_path):
    path = build_stepping(tmp_path / "a.fmu", 0.01, mobility=np.diag([0.5, 0.0]))
    text = found(check(CheckTask(open_archive(path))), "mechanics").text
    assert text == "cannot be probed: nothing moves by a torque on joint 2"


@pytest.mark.parametrize("step", [1e-3, 0.01, 0.02])
def test_p3_is_sampled_of_joints_with_internal_steps(tmp_path, step):
    found = p3_of(CheckTask(open_archive(build_stepping(tmp_path / "a.fmu", step)), body()))
    least, most = np.linalg.eigvalsh(INERTIA)
    assert [found.lambda_m, found.lambda_M] == pytest.approx([least, most], rel=max(1e-6, step**2))


@pytest.mark.parametrize("step", [1e-3, 0.01, 0.02, 0.05])
def test_gains_too_high_for_internal_steps_are_reported_before_a_run(tmp_path, step):
    """Of a torque held over T the limit is 2 M/kd, here of the lighter axis, and T its own step."""
    lightest = np.linalg.eigvalsh(INERTIA)[0]
    archive = open_archive(build_stepping(tmp_path / "a.fmu", step))
    for slack in (0.5, 1.5):
        kd = slack * 2 * lightest / max(step, 0.005) * ONE
        with ExitStack() as stack:
            if slack < 1:
                open_plants(stack, archive, [body(kd=kd)], {})
                continue
            with pytest.raises(UnstableStepError, match="beyond the stability limit"):
                open_plants(stack, archive, [body(kd=kd)], {})


def test_the_error_of_a_held_torque_is_measured_only_where_something_moves(tmp_path):
    archive, drives = open_archive(build_stepping(tmp_path / "a.fmu", 1e-3)), []
    for aside in (0.0, 0.1):
        with ExitStack() as stack:
            still = replace(body(), position=NONE + aside)
            drives.append(open_plants(stack, archive, [still], {}).drive)
    assert drives[0] == (
        "torque held for 0.005 s (error not measured: nothing moves at the start; "
        "--set initial.q=0.1 measures it there)"
    )
    assert float(drives[1].split("error about ")[1].removesuffix(" rad)")) > 0


def test_a_robot_that_nothing_moves_is_not_said_to_run(tmp_path):
    path = build_stepping(tmp_path / "a.fmu", 1e-3, mobility=np.zeros((2, 2)))
    alone = running(CheckTask(open_archive(path)), body(), True, Budget(), "")
    assert (alone.status, alone.text) == ("unknown", "it does not move, nor after its reference")
