"""Runs over links with noise, and with rounding, beside what is expected of them."""

import numpy as np
import pytest

import nrs_cosim as nrs
from tests.scenarios import SCENARIOS, tables

PLAIN = {
    "run": {"duration": 60.0, "sampling_period": 0.1, "output_step": 0.1},
    "network": {"edge_list": [[0, 1], [1, 2], [2, 3], [3, 1]]},
    "initial": {"position": 0.0},
}
NOISE = [{"noise": {"position": 0.01, "velocity": 0.02}}, {"from": 3, "noise": {"position": 0.05}}]
TURNS = {
    "repeat": 3,
    "switching": [
        {"from": 1, "edge_list": [[0, 1], [1, 2], [2, 3]]},
        {"from": 3, "edge_list": [[0, 3], [3, 2], [2, 1]]},
    ],
}
TWO = {
    "position": {"edge_list": [[0, 1], [1, 2], [2, 3]]},
    "velocity": {"edge_list": [[0, 3], [3, 2], [2, 1]]},
}


def ran(changes, faults):
    given = tables({**PLAIN, **changes, "faults": {"links": faults}})
    with nrs.run(nrs.Scenario(given, folder=SCENARIOS)) as recording:
        errors = recording.errors(start=48.0)
        names = ("position_estimate", "velocity_estimate")
        robots = [errors[errors["robot"] == robot] for robot in (1, 2, 3)]
        return recording.analysis(), np.array([[of[name] for of in robots] for name in names])


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"algorithm.name": "dcea2", "algorithm.beta": 0.8},
        {"network": TURNS},
        {"network": TWO},
    ],
    ids=["one digraph", "second order", "in turn", "two digraphs"],
)
def test_what_noise_came_to_is_the_difference_from_a_run_without_and_as_expected(changes):
    analysis, noisy = ran(changes, NOISE)
    _, quiet = ran(changes, [])
    noise = analysis["theory"]["noise"]
    for part, name in enumerate(("position", "velocity")):
        differences = (noisy - quiet)[part]
        measured = np.sqrt((differences**2).mean(axis=(1, 2)))
        assert noise["measured"][name] == pytest.approx(measured, rel=2e-3)
        low, high = np.array(noise["expected"][name]).T
        deviation = np.array(noise["deviation"][name])
        # Four standard errors, where `expected` is of 1.96.
        assert (np.abs(measured**2 - deviation**2) <= 2.05 * (high**2 - low**2) / 2).all()


def test_with_delays_the_noise_is_that_of_the_recursion_with_what_is_under_way():
    late = [{"delay": 2, **NOISE[0]}, NOISE[1]]
    analysis, noisy = ran({}, late)
    _, quiet = ran({}, [{"delay": 2}])
    noise = analysis["theory"]["noise"]
    measured = np.sqrt(((noisy - quiet)[0] ** 2).mean(axis=(1, 2)))
    assert noise["measured"]["position"] == pytest.approx(measured, rel=2e-3)
    plain = nrs.check(nrs.Scenario(tables({**PLAIN, "faults": {"links": NOISE}}), folder=SCENARIOS))
    assert noise["deviation"]["position"] != plain.as_json()["noise"]["deviation"]["position"]


@pytest.mark.parametrize("delay", [0, 1])
def test_rounding_on_links_stays_within_its_bound(delay):
    analysis, coarse = ran({}, [{"quantisation": 0.05, "delay": delay}])
    _, fine = ran({}, [{"delay": delay}])
    rows = analysis["theory"]["quantities"][:2]
    assert [row["status"] for row in rows] == ["within", "within"]
    for part, row in enumerate(rows):
        added = row["bounds"]["steady_state"] - np.abs(fine[part]).max()
        assert np.abs(coarse - fine)[part].max() <= added * 1.01
        assert np.abs(coarse - fine)[part].max() > 0.01  # there is something to be within


@pytest.mark.parametrize(
    ("faults", "why"),
    [
        ([{"loss": 0.1, "noise": 0.1}], "links lose samples"),
        ([{"delay": {"uniform": [0, 2]}, "noise": 0.1}], "delays are drawn"),
    ],
)
def test_where_noise_is_not_known_it_is_said_why(faults, why):
    given = tables({**PLAIN, "faults": {"links": faults}})
    noise = nrs.check(nrs.Scenario(given, folder=SCENARIOS)).as_json()["noise"]
    assert (noise["why_not"], noise["deviation"]) == (why, None)
