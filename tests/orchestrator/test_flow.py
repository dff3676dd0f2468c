"""References that are no lines between sampling times, and what the plants make of them."""

import json

import numpy as np
import pytest

from nrs_cosim.bus.fields import Sizes
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea3 import ThirdOrder
from nrs_cosim.estimator_agents.event_triggered import EventTriggered
from nrs_cosim.estimator_agents.flow import chord_errors, follows_lines
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.recording import Recording
from tests.command import nrs
from tests.scenarios import paper, write

THIRD = {
    "algorithm": {"name": "dcea3", "alpha": 0.9, "beta": 0.9, "gamma": 0.5},
    "run.duration": 1.0,
}


def ends(path, step):
    """Return estimates and positions of all robots at the end of a run with an output step."""
    file = paper(THIRD, {"run.output_step": step})
    run(file, path)
    with Recording(path) as recording:
        last = recording.states(start=0.999)
    return last["reference_position"], last["position"]


def test_chords_come_to_the_curve_with_the_square_of_the_output_step(tmp_path):
    steps = (0.1, 0.05, 0.025, 0.00625)
    found = [ends(tmp_path / f"{step}.mcap", step) for step in steps]
    for estimates, _ in found[:-1]:
        np.testing.assert_allclose(estimates, found[-1][0], rtol=1e-12)
    errors = [np.abs(q - found[-1][1]).max() for _, q in found[:-1]]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.3)
    assert errors[2] < 1e-4


def test_a_flow_of_its_own_may_still_be_a_line():
    sizes = Sizes(2)
    assert follows_lines(FirstOrder(0.9, 1.1), sizes)
    assert follows_lines(EventTriggered(0.9, 1.1, c0=0.1, d0=0.1), sizes)
    assert not follows_lines(ThirdOrder(0.9, 1.1, 0.5), sizes)


def test_a_chord_is_off_by_what_is_said():
    a, step = 3.0, 0.2
    t = np.linspace(0, step, 1001)
    curve, chord = a * t**2 / 2, a * step / 2 * t
    position, velocity = chord_errors(a, step)
    assert np.abs(curve - chord).max() == pytest.approx(position)
    assert np.abs(a * t - a * step / 2).max() == pytest.approx(velocity)


def test_check_says_how_far_off_chords_are(tmp_path):
    write(tmp_path / "s.toml", THIRD, {"run.output_step": 0.05})
    reference = json.loads(nrs("check", tmp_path / "s.toml", "--json").stdout)["reference"]
    gamma_2 = 1.0
    assert reference == {
        "step": 0.05,
        "position": pytest.approx(gamma_2 * 0.05**2 / 8),
        "velocity": pytest.approx(gamma_2 * 0.05 / 2),
    }
    assert "chords of 0.05 s are given to the plants" in " ".join(
        nrs("check", tmp_path / "s.toml").stdout.split()
    )
    write(tmp_path / "s.toml")
    assert "reference" not in json.loads(nrs("check", tmp_path / "s.toml", "--json").stdout)
