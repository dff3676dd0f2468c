"""References that are no lines between sampling times, and what the plants make of them."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

from nrs_cosim.bus.fields import Sizes
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea3 import ThirdOrder
from nrs_cosim.estimator_agents.event_triggered import EventTriggered
from nrs_cosim.estimator_agents.flow import acceleration_of, chord_errors, follows_lines
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.recording import Recording
from tests.command import nrs
from tests.plant_fmu.rewritten_fmus import rewritten
from tests.scenarios import paper, write

THIRD = {
    "algorithm": {"name": "dcea3", "alpha": 0.9, "beta": 0.9, "gamma": 0.5},
    "run.duration": 1.0,
}


def without(folder):
    """Write the arm as an FMU whose acceleration has another name; return its path."""

    def edit(text):
        return text.replace('name="acceleration_ref', 'name="other')

    return rewritten(folder / "arm.fmu", 3, edit)


def ends(folder, step, **plant):
    """Return estimates and positions of all robots at the end of a run with an output step."""
    file = paper(THIRD, {"run.output_step": step, "plant": {"fmu": "two_link_arm", **plant}})
    path = run(file, folder / f"{step}-{len(plant)}.mcap").path
    with Recording(path) as recording:
        last = recording.states(start=0.999)
    return last["reference_position"], last["position"]


def test_plants_follow_an_acceleration_whatever_the_output_step(tmp_path):
    (_, coarse), (_, fine) = (ends(tmp_path, step) for step in (0.1, 0.025))
    assert np.abs(coarse - fine).max() < 1e-7
    _, equations = ends(tmp_path, 0.1, solver="cvode")
    assert np.abs(coarse - equations).max() < 1e-6


def test_chords_come_to_the_curve_with_the_square_of_the_output_step(tmp_path):
    arm = str(without(tmp_path))
    found = [ends(tmp_path, step, fmu=arm, isolate=False) for step in (0.1, 0.05, 0.025)]
    found.append(ends(tmp_path, 0.1))
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


@dataclass(frozen=True)
class Coasting(ThirdOrder):
    """Keeps an acceleration, and slows down otherwise."""

    def flow(self, x, dt):
        return x.replace(position=x.position + dt * x.velocity, velocity=x.velocity * 0.9**dt)


def test_an_acceleration_is_found_where_the_flow_is_its_parabola():
    gains, sizes = (0.9, 1.1, 0.5), Sizes(2)
    assert acceleration_of(ThirdOrder(*gains), sizes) == "acceleration"
    assert acceleration_of(Coasting(*gains), sizes) is None
    assert acceleration_of(FirstOrder(0.9, 1.1), sizes) is None


def test_a_chord_is_off_by_what_is_said():
    a, step = 3.0, 0.2
    t = np.linspace(0, step, 1001)
    curve, chord = a * t**2 / 2, a * step / 2 * t
    position, velocity = chord_errors(a, step)
    assert np.abs(curve - chord).max() == pytest.approx(position)
    assert np.abs(a * t - a * step / 2).max() == pytest.approx(velocity)


def test_check_says_how_far_off_chords_are(tmp_path):
    write(tmp_path / "s.toml", THIRD, {"run.output_step": 0.05})
    assert "reference" not in json.loads(nrs("check", tmp_path / "s.toml", "--json").stdout)
    without(tmp_path)
    write(tmp_path / "s.toml", THIRD, {"run.output_step": 0.05, "plant.fmu": "arm.fmu"})
    reference = json.loads(nrs("check", tmp_path / "s.toml", "--json").stdout)["reference"]
    gamma_2 = 1.0
    assert reference == {
        "fmus": ["arm.fmu"],
        "step": 0.05,
        "position": pytest.approx(gamma_2 * 0.05**2 / 8),
        "velocity": pytest.approx(gamma_2 * 0.05 / 2),
    }
    assert "chords of 0.05 s are given to arm.fmu, off by" in " ".join(
        nrs("check", tmp_path / "s.toml").stdout.split()
    )
