"""Whether a reset starts an FMU anew is a finding of its own."""

from types import SimpleNamespace

import numpy as np
import pytest

from nrs_cosim.plant_fmu.archives.archive import find_archive, open_archive
from nrs_cosim.plant_fmu.checking import resetting as module
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.resetting import STEP, STEPS, resetting
from nrs_cosim.plant_fmu.checking.subprocess_check import check
from nrs_cosim.plant_fmu.errors import FmuError
from tests.plant_fmu.stepping import build_stepping
from tests.plant_fmu.test_internal_steps import body


def reset_of(checked):
    (found,) = [finding for finding in checked.findings if finding.name == "reset"]
    return found


@pytest.mark.parametrize("fmi", [2, 3])
def test_what_a_reset_leaves_of_a_motion_is_found(tmp_path, fmi):
    """Of these joints the time since they were instantiated outlives a reset after 0.5 s."""
    path = build_stepping(tmp_path / "a.fmu", 1e-3, fmi, lasting=True)
    found = reset_of(check(CheckTask(open_archive(path))))
    assert found.status == "fails"
    assert found.text.startswith(
        f"after fmi{fmi}Reset it moves otherwise than from its first start"
    )
    assert found.value > 0.1


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_reset_that_leaves_nothing_holds(tmp_path, fmi):
    path = build_stepping(tmp_path / "a.fmu", 1e-3, fmi)
    found = reset_of(check(CheckTask(open_archive(path))))
    assert (found.status, found.value) == ("holds", 0.0)
    assert found.text == f"after fmi{fmi}Reset it starts where it did, and moves as it did for 1 s"


class Plant:
    """One joint under a constant acceleration, and what a reset does to it."""

    def __init__(self, *, again=0.0, acceleration=1.0, error=None):
        self.again, self.acceleration, self.error = again, acceleration, error
        self.q, self.qd = np.zeros((2, 1, 1))

    def advance(self, _start, step):
        self.q += self.qd * step
        self.qd += self.acceleration * step

    def start_again(self, _bodies):
        if self.error:
            raise FmuError(self.error)
        self.q[:], self.qd[:] = self.again, 0.0


@pytest.mark.parametrize(
    ("plant", "status", "text"),
    [
        (Plant(), "holds", "after fmi3Reset it starts where it did, and moves as it did for 1 s"),
        (
            Plant(again=0.25),
            "fails",
            "after fmi3Reset and the same start values it is at q, qd = 0.25, 0, and was at 0, 0: "
            "fmi3Reset does not start it anew",
        ),
        (
            Plant(again=np.nan),
            "fails",
            "after fmi3Reset and the same start values it is at q, qd = nan, 0, and was at 0, 0: "
            "fmi3Reset does not start it anew",
        ),
        (
            Plant(acceleration=0.0),
            "unknown",
            "it starts where it did, and does not move: fmi3Reset has no work",
        ),
        (Plant(error="a reset: error"), "unknown", "cannot be looked at: a reset: error"),
    ],
    ids=["anew", "elsewhere", "not a number", "still", "refused"],
)
def test_the_state_after_a_reset_is_compared_with_the_start(monkeypatch, plant, status, text):
    monkeypatch.setattr(module, "open_probe", lambda *_: SimpleNamespace(probe=plant))
    spent = []
    budget = SimpleNamespace(spend=lambda: spent.append(None))
    archive = find_archive("two_link_arm", None)
    found = resetting(archive, body(), {}, (), None, budget)
    assert (found.topic, found.name, found.status, found.text) == ("runs", "reset", status, text)
    assert len(spent) in {STEPS, 2 * STEPS}
    assert STEP * STEPS == 1.0
