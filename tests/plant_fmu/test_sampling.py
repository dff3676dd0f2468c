"""P3 by sampling: an arm's against what is proven of it, and what cannot be sampled says why."""

import shutil

import numpy as np
import pytest

from nrs_cosim.plant_fmu.archives.archive import find_archive, open_archive
from nrs_cosim.plant_fmu.bundled.bounds import bounds_of
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.checking.budget import Budget
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.sampling import sampled
from nrs_cosim.plant_fmu.checking.subprocess_check import p3_of
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.plants import Body, Disturbance
from tests.plant_fmu.faulty_fmu import FAULTS
from tests.plant_fmu.rewritten_fmus import rewritten
from tests.plant_fmu.test_check import changed

pytestmark = [
    pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler"),
    pytest.mark.filterwarnings("ignore::RuntimeWarning"),
]

LAMBDAS = ("lambda_m", "lambda_M", "lambda_c", "lambda_g", "lambda_f")
PROBED = 1e-6
"""Relative: what accelerations over 16 ms are exact to."""


BEST = Driving()


def task(archive, driving=BEST, joints=2, **parameters):
    none, one = np.zeros(joints), np.eye(joints)
    still = Disturbance(none, none, *np.zeros((3, joints, 0)))
    body = Body(1, parameters, one, one, still, q=none + 0.3, qd=none, position=none, velocity=none)
    return CheckTask(archive, body, {}, driving)


@pytest.mark.parametrize("driving", [BEST, Driving(solver="rk4"), Driving(control="hold")], ids=str)
def test_sampled_bounds_of_the_papers_arm_are_within_a_hundredth_below_the_proven(driving):
    found = sampled(task(find_archive("two_link_arm", None), driving), Budget())
    proven = bounds_of("two_link_arm", {}, 2)
    assert found.lambda_m >= proven.lambda_m * (1 - PROBED)
    assert found.lambda_m <= proven.lambda_m * 1.01
    for name in ("lambda_M", "lambda_c", "lambda_g"):
        assert getattr(found, name) <= getattr(proven, name) * (1 + PROBED)
        assert getattr(found, name) >= getattr(proven, name) * 0.99
    assert found.lambda_f < PROBED
    assert found.source == "sampled"
    assert 1000 < found.states < 2500


def test_drag_is_found():
    found = sampled(task(find_archive("planar_robot", None), d=0.7), Budget())
    assert [getattr(found, name) for name in LAMBDAS] == pytest.approx([2, 2, 0, 0, 0.7], abs=1e-9)


def test_sampled_bounds_of_a_longer_arm_are_below_its_safe_bounds():
    numbers = {"m": [1.0, 0.8, 0.5], "r": [1.0, 0.7, 0.5], "c": [0.5, 0.3, 0.2]}
    found = sampled(task(find_archive("n_link_arm", None), joints=3, **numbers), Budget())
    safe = bounds_of("n_link_arm", numbers, 3)
    assert found.lambda_m >= safe.lambda_m * (1 - PROBED)
    assert found.lambda_M == pytest.approx(safe.lambda_M, rel=0.01)  # exact for 3 links
    assert found.lambda_g == pytest.approx(safe.lambda_g, rel=0.01)
    assert 0 < found.lambda_c <= safe.lambda_c


def test_a_third_party_fmu_is_sampled_in_its_process_to_the_same_bits(tmp_path):
    path = rewritten(tmp_path / "arm.fmu", 3, lambda text: text.replace("two-link", "2-link"))
    archive = open_archive(path)
    assert not archive.ours
    assert p3_of(task(archive)) == sampled(task(find_archive("two_link_arm", None)), Budget())


def test_a_crash_while_sampling_is_reported(faulty, tmp_path):
    shutil.copy(faulty, tmp_path / "faulty.fmu")
    fault = {"fault": FAULTS.index("segfault"), "fault_time": 0.001}
    with pytest.raises(FmuError, match="the process of the FMU crashed with SIGSEGV; it printed"):
        p3_of(task(open_archive(tmp_path / "faulty.fmu"), **fault))
    fault["fault"] = FAULTS.index("hang")
    with pytest.raises(FmuError, match="the process of the FMU did not return within 3 s"):
        p3_of(task(open_archive(tmp_path / "faulty.fmu"), **fault), 3.0)
    fault["fault"] = FAULTS.index("error")
    with pytest.raises(FmuError, match="ended with Error"):
        p3_of(task(open_archive(tmp_path / "faulty.fmu"), **fault))


BAD = {
    "no torque": ("", "", 'name="tau"', 'name="push"', "it takes no tau"),
    "dry friction": (
        "- p->d * qd[i]",
        "- p->d * (qd[i] > 0.001 ? 1 : qd[i] < -0.001 ? -1 : qd[i] * 1000)",
        "", "", "its friction is not in proportion to q̇",
    ),
    "drag that grows": (
        "- p->d * qd[i]", "- p->d * qd[i] - qd[i] * qd[i] * qd[i] * qd[i]",
        "", "", "its forces of motion are not in proportion to the square of q̇",
    ),
    "no inertia": (
        "(force[i] - p->d * qd[i]) / p->m", "(force[i] + (i ? force[0] : 0) - p->d * qd[i]) / p->m",
        "", "", "its inertia is not symmetric and positive definite",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_an_fmu_without_such_mechanics_gives_the_reason(tmp_path, case):
    old, new, name, other, why = BAD[case]
    if name:
        archive = open_archive(
            rewritten(tmp_path / "x.fmu", 3, lambda text: text.replace(name, other), "planar_robot")
        )
    else:
        archive = open_archive(changed(tmp_path, "planar_robot", (old, new)))
    with pytest.raises(FmuError, match=why):
        sampled(task(archive), Budget())


def test_an_fmu_of_fmi_2_is_sampled():
    found = sampled(task(open_archive(build("two_link_arm", 2))), Budget())
    assert found.lambda_M == pytest.approx(bounds_of("two_link_arm", {}, 2).lambda_M, rel=1e-3)
