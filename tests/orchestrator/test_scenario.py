"""A scenario's errors name the field, the value and what was expected; its draws have names."""

import json

import numpy as np
import pytest

from nrs_cosim.bus.clock import Clock, nanoseconds
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.conversion import gain
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.orchestrator.scenario.initial import draw
from nrs_cosim.orchestrator.scenario.tables.fmus import Pattern
from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema
from nrs_cosim.orchestrator.scenario.tables.values import Uniform
from tests.orchestrator.run_oracle import target
from tests.scenarios import SCENARIOS, paper


def tls(**workers):
    return {"bus": {"tls": {"ca": "ca", "certificate": "c", "key": "k", "workers": workers}}}


def test_a_scenario_is_immutable():
    scenario = paper().scenario
    with pytest.raises(ValueError, match="frozen"):
        scenario.run.seed = 2


CASES = {  # the paper's Examples 1 to 3: algorithm, alpha, beta, h
    "1a": ("dcea1", 0.9, 1.1, 0.1),
    "1b": ("dcea1", 1.17, 1.17, 0.1),
    "1c": ("dcea1", 1.18, 1.18, 0.1),
    "2a": ("dcea1", 0.9, 1.1, 0.05),
    "2b": ("dcea1", 0.9, 1.1, 0.1),
    "2c": ("dcea1", 0.9, 1.1, 0.5),
    "3a": ("dcea2", 1.1, 0.9, 0.1),
    "3b": ("dcea2", 1.1, 0.9, 0.45),
    "3c": ("dcea2", 1.1, 0.9, 0.5),
}


@pytest.mark.parametrize("case", CASES)
def test_the_nine_cases_of_the_paper_differ_in_their_gains_and_period_only(case):
    scenario = read_scenario(SCENARIOS / f"paper_example_{case}.toml").scenario
    choice = scenario.algorithm
    assert (choice.name, *choice.parameters.values(), scenario.run.sampling_period) == CASES[case]
    example = paper().scenario
    for part in ("controller", "network", "target", "plant", "disturbance", "initial", "robots"):
        assert getattr(scenario, part) == getattr(example, part)


def test_the_schema_knows_every_key():
    schema = json.dumps(json_schema())
    for key in (
        "sampling_period",
        "sampling_times",
        "sampling_jitter",
        "adjacency",
        "pinning",
        "uniform",
        "robots",
        "cosines",
        "kp",
    ):
        assert f'"{key}"' in schema


def test_a_plant_names_variables_and_gives_parameters_in_many_forms():
    plant = paper(
        {
            "plant.parameters": {
                "a": True,
                "b": "text",
                "c": [1, 2.0, False],
                "d": [[1, 2], [3, 4]],
            },
            "plant.variables": {
                "q": "x[0:2]",
                "qd": ["w1", "w2"],
                "tau": {"pattern": "u{i}", "base": 0},
            },
        }
    ).scenario.plant
    assert plant.parameters == {"a": True, "b": "text", "c": (1, 2.0, False), "d": ((1, 2), (3, 4))}
    assert [type(number) for number in plant.parameters["c"]] == [int, float, bool]
    assert plant.variables == {
        "q": "x[0:2]",
        "qd": ("w1", "w2"),
        "tau": Pattern(pattern="u{i}", base=0),
    }


def test_draws_depend_on_seed_purpose_and_robot_alone():
    uniform = Uniform(uniform=(-25.0, 25.0))
    assert draw(1, "q", 3, uniform, (2,)).tolist() == draw(1, "q", 3, uniform, 2).tolist()
    others = [
        draw(2, "q", 3, uniform, (2,)),
        draw(1, "qd", 3, uniform, (2,)),
        draw(1, "q", 4, uniform, (2,)),
    ]
    for other in others:
        assert not np.intersect1d(other, draw(1, "q", 3, uniform, (2,))).size
    start = paper().initial_estimates()
    assert start.position[2].tolist() == draw(1, "position", 3, uniform, (2,)).tolist()
    assert start.velocity[5].tolist() == draw(1, "velocity", 6, uniform, (2,)).tolist()


def test_draws_fill_their_range():
    numbers = np.concatenate(
        [draw(5, "q", robot, Uniform(uniform=(-25.0, 25.0)), 4) for robot in range(1, 2001)]
    )
    assert -25 <= numbers.min() < -24.9
    assert 24.9 < numbers.max() < 25
    assert abs(numbers.mean()) < 3 * 50 / np.sqrt(12 * len(numbers))


def test_one_robots_own_values_leave_the_others_alone():
    own = {"id": 3, "initial": {"q": [1.5, -2]}, "controller": {"kp": 1, "kd": [2, 3]}}
    changed, example = paper({"robots": [own]}).bodies(), paper().bodies()
    assert changed[2].q.tolist() == [1.5, -2]
    assert changed[2].kd.tolist() == [[2, 0], [0, 3]]
    assert changed[2].qd.tolist() == example[2].qd.tolist()
    for i in (0, 1, 3, 4, 5):
        assert changed[i].q.tolist() == example[i].q.tolist()
        assert changed[i].kp.tolist() == [[200, 0], [0, 200]]


def test_a_robots_own_table_changes_the_keys_that_it_gives_and_keeps_the_others():
    robots = [
        {"id": 2, "controller": {"kp": 20}, "plant": {"parameters": {"m2": 3.0}}},
        {"id": 3, "disturbance": {"axes": []}},
        {
            "id": 4,
            "disturbance": {},
            "plant": {"fmu": "two_link_arm", "variables": {"q": "q"}},
        },
    ]
    scenario = paper({"plant.parameters": {"m1": 0.25}, "robots": robots})
    made = scenario.bodies()
    assert made[1].kp.tolist() == [[20, 0], [0, 20]]
    assert made[1].kd.tolist() == [[300, 0], [0, 300]]
    assert [body.parameters for body in made] == [
        {"m1": 0.25},
        {"m1": 0.25, "m2": 3.0},
        {"m1": 0.25},
        {},
        {"m1": 0.25},
        {"m1": 0.25},
    ]
    assert scenario.of_robot(4).plant.variables == {"q": "q"}
    for robot, waves in ((3, 0), (4, 2)):
        assert np.count_nonzero(made[robot - 1].disturbance.amplitude) == waves


@pytest.mark.parametrize(
    ("given", "row"),
    [
        ({}, [0.0, 0.0]),
        ({"q": 0.5}, [0.5, 0.5]),
        ({"q": [0.5, -1]}, [0.5, -1.0]),
        ({"q": [[0.5, -1]] * 6}, [0.5, -1.0]),
    ],
)
def test_initial_joints_are_zero_or_one_number_or_one_row_for_all(given, row):
    made = paper({"initial": given}).bodies()
    assert [body.q.tolist() for body in made] == [row] * 6
    for body in made:
        assert body.qd.tolist() == body.position.tolist() == body.velocity.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("given", "row"), [({}, [9.0, 9.0]), ({"q": 0.5}, [0.5, 0.5]), ({"q": [0.5, -1]}, [0.5, -1.0])]
)
def test_a_robots_own_initial_state_takes_the_place_of_that_of_all(given, row):
    scenario = paper({"initial": {"q": 9}, "robots": [{"id": 2, "initial": given}]})
    q = [body.q.tolist() for body in scenario.bodies()]
    assert q == [[9.0, 9.0], row, *[[9.0, 9.0]] * 4]


def test_a_missing_table_names_the_keys_that_it_must_have():
    with pytest.raises(ScenarioError) as error:
        paper({"run": None, "controller": None, "algorithm": None, "plant": {}})
    assert [line.removeprefix("paper.toml: ") for line in str(error.value).splitlines()] == [
        "run: missing, it has no default; give run.duration and run.sampling_period",
        "algorithm: missing, it has no default; give algorithm.name",
        "controller: missing, it has no default; give controller.kp and controller.kd",
        "plant.fmu: missing, it has no default",
    ]


def test_gains_are_a_number_a_vector_or_a_matrix():
    assert gain(2.0, 2).tolist() == [[2, 0], [0, 2]]
    assert gain((2.0, 3.0), 2).tolist() == [[2, 0], [0, 3]]
    assert gain(((1.0, 2.0), (3.0, 4.0)), 2).tolist() == [[1, 2], [3, 4]]


def test_the_target_is_that_of_the_paper():
    motion = paper().target.at(np.array([0.0, 0.3, 12.5]))
    for row, t in enumerate((0.0, 0.3, 12.5)):
        position, velocity = target(t)
        np.testing.assert_allclose(motion.position[row], position, rtol=1e-14)
        np.testing.assert_allclose(motion.velocity[row], velocity, rtol=1e-14)


def test_times_are_whole_nanoseconds():
    assert nanoseconds(0.1) == 100_000_000
    assert nanoseconds(1e-9) == 1
    assert nanoseconds(3600.0) == 3_600_000_000_000
    with pytest.raises(ValueError, match="no whole number"):
        nanoseconds(1.5e-9)
    clock = Clock((100,), 4, 1000)
    assert [clock.t(k) for k in (0, 1, 1000)] == [0, 100, 100_000]
    assert list(clock.outputs(0)) == [0]
    assert list(clock.outputs(3)) == [225, 250, 275, 300]


def test_workers_on_other_machines_have_certificates_and_robots():
    assert paper().scenario.bus.tls is None
    bus = paper(tls(left="1-3", right="4,5,6")).scenario.bus
    assert bus.deadline == 30.0
    assert bus.tls.workers == {"left": "1-3", "right": "4,5,6"}
