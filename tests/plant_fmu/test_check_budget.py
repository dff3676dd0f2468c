"""What a check does not come to within its budget is unknown, and what is known is told."""

import shutil
from contextlib import suppress
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.checking.budget import Budget, OutOfTime, limited
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.procedure import findings
from nrs_cosim.plant_fmu.checking.subprocess_check import check
from tests.plant_fmu.rewritten_fmus import description, rewritten
from tests.plant_fmu.stepping import INERTIA, build_stepping
from tests.plant_fmu.test_check import found, statuses
from tests.plant_fmu.test_internal_steps import body

pytestmark = [
    pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler"),
    pytest.mark.filterwarnings("ignore::RuntimeWarning"),
]


def test_a_stage_over_budget_is_unknown_and_the_others_are_checked():
    """By a clock that goes by 1 s at each look: mechanics wants thousands, running alone 100."""
    ticks = count()
    budget = Budget(limit=1000.0, clock=lambda: float(next(ticks)))
    result = {f.name: f for f in findings(CheckTask(open_archive(build("two_link_arm"))), budget)}
    assert result["M symmetric"].status == "holds"
    assert result["rests"].status == "unknown"
    assert result["rests"].text == "cannot be probed: given up after 1000 s of processor time"
    assert result["alone"].status == result["resumed"].status == "holds"


@pytest.mark.parametrize("damping", [0.0, 2e4])
def test_a_stiff_model_gives_up_running_alone_with_the_reason(damping):
    """Of m = 2 kg with kd = 1 and d = 2e4 the fastest rate is 1e4 per s."""
    ticks, stages = count(), [""]
    budget = Budget(
        stages.append,
        limit=50.0,
        clock=lambda: float(next(ticks)) if "alone" in stages[-1] else 0.0,
    )
    task = CheckTask(
        open_archive(build("planar_robot")), replace(body(), parameters={"d": damping})
    )
    (alone,) = (f for f in findings(task, budget) if f.name == "alone")
    assert alone.status == "unknown"
    why = (
        "; it is stiff: damping (kd and its own) over the least inertia is 1e+04 per s; give each "
        "joint a gain or damping of its size"
    )
    assert alone.text == (
        f"given up after 50 s of processor time, at t = 0.51 s of 1 s{why if damping else ''}"
    )


def test_python_code_is_stopped_by_its_processor_time():
    def work():
        while True:
            with suppress(Exception):  # as FMPy's code may have it
                sum(range(1000))

    with pytest.raises(OutOfTime), limited(0.01):
        work()


def test_a_description_slow_to_validate_is_reported(monkeypatch):
    def endless(_):
        raise OutOfTime

    monkeypatch.setattr("nrs_cosim.plant_fmu.checking.validity.validate_fmu", endless)
    result = list(findings(CheckTask(open_archive(build("planar_robot"))), Budget(limit=20.0)))
    (valid,) = (f for f in result if f.topic == "valid")
    assert valid.status == "unknown"
    assert valid.text == "not validated: took longer than 20 s of processor time"
    assert {f.status for f in result if f.topic == "physics"} == {"holds"}


def test_problems_of_one_kind_are_reported_once_with_their_count(tmp_path):
    given = 'causality="parameter"'
    path = rewritten(tmp_path / "a.fmu", 3, lambda text: text.replace(given, f'{given} order="1"'))
    parameters = description(3).count(given)
    problems = [f for f in check(CheckTask(open_archive(path))).findings if f.topic == "valid"]
    (problem,) = problems
    assert "The attribute 'order' is not allowed" in problem.text
    assert problem.text.endswith(f" ({parameters} times alike)")


def test_stages_are_reported_as_they_begin(tmp_path):
    stages = []
    ours = open_archive(build("planar_robot"))
    path = rewritten(tmp_path / "a.fmu", 3, lambda text: text.replace("planar", "flat"))
    theirs = []
    check(CheckTask(ours), tell=stages.append)
    check(CheckTask(open_archive(path)), tell=theirs.append)
    expected = [
        "starting",
        "validating its model description",
        "loading it",
        "looking for its variables",
        "starting it elsewhere",
        "checking whether it moves as mechanics does",
        "resetting it",
        "running it alone",
        "saving its state, and going on in another process",
    ]
    assert stages == theirs == expected


@pytest.mark.parametrize("gains", ["guessed", "given"])
def test_a_torque_of_wrong_sign_is_reported_and_a_runaway_is_no_run(tmp_path, gains):
    """On springs of 4 and of kp = 1, by M⁻¹ = -100 M0⁻¹, exp(sqrt(500 · 0.72) t) / 10 > 1e6."""

    def edit(text):
        return text.replace('start="0"', 'start="0.1"', 1)

    path = build_stepping(
        tmp_path / "a.fmu", 1e-3, mobility=-100 * np.linalg.inv(INERTIA), edit=edit
    )
    task = CheckTask(open_archive(path))
    if gains == "given":
        task = replace(task, body=replace(body(), q=np.array([0.1, 0.0])))
    checked = check(task)
    assert not checked.passes
    assert statuses(checked)["M positive definite"] == "fails"
    text = found(checked, "M positive definite").text
    assert text.startswith(
        "torque acts against its sign on joints 1-2: smallest eigenvalue over largest -1"
    )
    alone = found(checked, "alone")
    assert alone.status == ("unknown" if gains == "guessed" else "fails")
    assert alone.text.startswith("diverges by torque held for 0.005 s")
    assert ("its gains are a guess" in alone.text) == (gains == "guessed")
