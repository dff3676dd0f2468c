"""Gains that are large for a joint's inertia are told, by joint, with gains that are not."""

import json

import numpy as np
import pytest

from nrs_cosim.orchestrator.analysis.bounds import ultimate_bounds
from nrs_cosim.orchestrator.analysis.stiffness import mobility_at_start
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
from nrs_cosim.plant_fmu.bundled.urdf_fmu import build_urdf
from nrs_cosim.recordings.mcap.reader import Reader
from tests.command import nrs
from tests.plant_fmu.newton_euler import Oracle
from tests.plant_fmu.test_urdf import IIWA
from tests.scenarios import paper, write

LIGHT = {"plant.parameters": {"J2": 0.001, "m2": 0.001}}


def test_the_papers_example_is_not_stiff():
    assert ultimate_bounds(paper()).stiff == []


@pytest.mark.parametrize("kd", [60.0, [20.0, 60.0]])
def test_a_light_link_is_stiff_at_the_rate_of_its_equation_and_the_proposal_is_not(kd):
    gains = {"controller.kp": 200.0, "controller.kd": kd}
    (found,) = ultimate_bounds(paper(LIGHT, gains)).stiff
    # M at q_2 = 0 and π, of masses 0.5 and 0.001, lengths 1 and 0.8, drives of 5 and 0.001
    coupling, end = 0.001 * 0.8, 0.001 * 0.64
    mobility = max(
        np.linalg.inv(
            [[0.501 + end + 2 * c + 5, end + c], [end + c, end + 0.001]]
        )[1, 1]
        for c in (coupling, -coupling)
    )  # fmt: skip
    assert (found.robots, found.joint) == ((1, 2, 3, 4, 5, 6), "joint 2")
    assert found.rate == pytest.approx(60 * mobility, rel=1e-12)
    assert found.per_period == pytest.approx(6 * mobility, rel=1e-12)
    assert (found.kp[0], found.kd[0]) == (200.0, np.ravel(kd)[0])
    assert found.kd[1] * mobility * 0.1 == pytest.approx(50, rel=0.05)
    assert found.kp[1] / found.kd[1] == pytest.approx(200 / 60, rel=0.05)
    softer = {"controller.kp": list(found.kp), "controller.kd": list(found.kd)}
    assert ultimate_bounds(paper(LIGHT, softer)).stiff == []


def test_check_and_run_warn_of_stiff_joints(tmp_path):
    gains = {"controller.kp": 200.0, "controller.kd": 60.0, "run.duration": 0.2}
    file = write(tmp_path / "stiff.toml", LIGHT, gains)
    checked = nrs("check", file, "--json")
    (said,) = json.loads(checked.stdout)["stiff"]
    assert (said["joint"], said["robots"]) == ("joint 2", [1, 2, 3, 4, 5, 6])
    ran = nrs("run", file, "-o", tmp_path / "stiff.mcap")
    assert ran.returncode == 0
    for done in (checked, ran):
        assert (
            "warning: robots 1-6: joint 2 is stiff: kd over its inertia is 3.7e+04" in done.stderr
        )


def test_a_stiff_run_is_resumed_to_the_same_bits(tmp_path):
    """The checkpoint after tick 2 is one of plants that have gone over to the implicit method."""
    gains = {"controller.kp": 200.0, "controller.kd": 60.0, "run.checkpoint_every": 2}
    experiment = paper(LIGHT, gains, {"run.duration": 0.5})
    whole = run(experiment, tmp_path / "whole.mcap")

    def watch(time_ns):
        if time_ns >= experiment.clock.t(3):
            raise Interrupted

    assert run(experiment, tmp_path / "begun.mcap", watch=watch).status == "interrupted"
    done = nrs("resume", tmp_path / "begun.mcap", "-o", tmp_path / "rest.mcap")
    assert done.returncode == 0, done.stderr
    with Reader(whole.path) as one, Reader(tmp_path / "rest.mcap") as other:
        assert one.digest == other.digest


def test_a_published_arms_inertia_is_found_where_it_starts(tmp_path):
    (tmp_path / "arm.fmu").write_bytes(build_urdf(read_urdf(IIWA)).read_bytes())
    q = np.linspace(-1, 1, 7)
    start = {"plant.fmu": "arm.fmu", "target.axes": [{}] * 7, "disturbance": None}
    experiment = paper(start, {"initial": {"q": q.tolist()}}, folder=tmp_path)
    found = mobility_at_start(experiment)(experiment.scenario.plant, 1)
    inverse = np.linalg.inv(Oracle(IIWA).mass_matrix(q))
    # Its joints are damped, and pushed for a little while.
    np.testing.assert_allclose(found, inverse.diagonal(), rtol=1e-2)
