"""A law that an FMU holds, and starts with, is none of its mechanics: it is found as without."""

import shutil
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from nrs_cosim.plant_fmu.archives.archive import find_archive, open_archive
from nrs_cosim.plant_fmu.bundled.builder import build_model
from nrs_cosim.plant_fmu.bundled.declaration import MODELS, declaration
from nrs_cosim.plant_fmu.checking.budget import Budget
from nrs_cosim.plant_fmu.checking.mechanics import MechanicsProbe, open_probe
from nrs_cosim.plant_fmu.drives.choice import Driving, choose, offers
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.drives.own_law import without_own_law
from nrs_cosim.plant_fmu.errors import UnstableStepError
from nrs_cosim.plant_fmu.plants import Body, Control, Disturbance
from tests.cases import cases

pytestmark = [
    pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler"),
    pytest.mark.filterwarnings("ignore::RuntimeWarning"),
]

NONE, ONE = np.zeros(2), np.eye(2)
LAW = {"torque_limit": 0.5, "kp": 7.0, "kd": 3.0, "gravity_compensation": 1.0}
"""The weakest joint of the arm needs more than 1 N m to hold its own weight."""


def starting_with(folder, model, fmi=3, **starts):
    """Return the archive of a bundled model that starts with other values."""
    plain = declaration(model)
    variables = (replace(v, start=starts.get(v.name, v.start)) for v in plain.variables)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NRS_CACHE", str(folder))
        code = (MODELS / model / "model.c").read_bytes()
        made = build_model(replace(plain, variables=tuple(variables)), {"model.c": code}, fmi)
    return open_archive(made)


def body(**changed):
    still = Disturbance(NONE, NONE, *np.zeros((3, 2, 0)))
    plain = Body(1, {}, ONE, ONE, still, q=NONE + 0.3, qd=NONE, position=NONE, velocity=NONE)
    return replace(plain, **changed)


def probed(archive, driving, **changed):
    """Return M⁻¹, G, the power gained and the drift of an arm that rests."""
    offered, chosen = offers(archive, {}), choose(archive, {}, driving)
    with ExitStack() as stack:
        opened = open_probe(stack, archive, body(**changed), {}, offered, chosen)
        mechanics = MechanicsProbe(opened, body(**changed), Budget())
        q, span = NONE + 0.2, mechanics.spans[0]
        gained = mechanics.power_gained(q, NONE + 0.7, span)[0]
        mass, weight = mechanics.mobility(q, span), mechanics.gravity(q, span)
        return [*mass.ravel(), *weight, gained, mechanics.rest(q, span).drift]


@pytest.mark.parametrize(
    ("fmi", "solver"),
    cases([(2, None), (2, "rk4"), (3, None), (3, "rk4")], [(2, "rk4"), (3, None)]),
)
def test_mechanics_are_found_to_the_bit_whatever_law_an_fmu_starts_with(tmp_path, fmi, solver):
    arm, driving = find_archive("two_link_arm", None), Driving(solver=solver)
    plain = probed(arm, driving)
    law = LAW if solver else {**LAW, "ki": 2.0}
    assert probed(starting_with(tmp_path, "two_link_arm", fmi, **law), driving) == plain
    if solver:  # a law that is the scenario's, in the right-hand side
        control = Control(gravity_compensation=True, computed_torque=True)
        assert probed(arm, driving, control=control) == plain


def test_a_weak_limit_hides_no_step_that_is_too_long(tmp_path):
    archive = starting_with(tmp_path, "planar_robot", torque_limit=1e-3)
    stiff = body(kp=100 * ONE, kd=2000 * ONE)
    with ExitStack() as stack, pytest.raises(UnstableStepError):
        open_plants(stack, archive, [stiff], {}, Driving(control="hold"))


def test_what_a_scenario_says_of_the_law_stays():
    archive = find_archive("two_link_arm", None)
    found = without_own_law(archive, {}, body(parameters={"torque_limit": [3.0, 4.0]}))
    assert "torque_limit" not in found
    assert found["kp"].tolist() == [0.0] * 4
