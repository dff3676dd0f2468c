"""What is wrong with a scenario: field, value and remedy, all at once."""

import pytest

from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.file import parse_scenario, read_scenario
from tests.orchestrator.test_scenario import tls
from tests.scenarios import SCENARIOS, paper

BAD = {
    "worker of a robot that is not there": (
        tls(left="1-7"),
        "bus.tls.workers.left: got '1-7' in '1-7', but there are robots 1 to 6",
    ),
    "robot of two workers": (
        tls(left="1-3", right="3-6"),
        "bus.tls.workers.right: robot 3 is already 'left''s",
    ),
    "worker whose name is taken": (
        tls(target="1-3"),
        "bus.tls.workers: expected the name of a worker",
    ),
    "certificate without a key": (
        {"bus": {"tls": {"ca": "ca", "certificate": "c"}}},
        "bus.tls.key: missing",
    ),
    "deadline that is none": (
        {"bus": {"deadline": 0}},
        "bus.deadline: expected greater than 0, got 0",
    ),
    "misspelt key": (
        {"algorithm.alpha": None, "algorithm.alhpa": 0.9},
        "algorithm.alhpa: unknown key; did you mean 'alpha'?",
    ),
    "missing key": ({"algorithm.alpha": None}, "algorithm.alpha: missing"),
    "unknown table": ({"target": None, "goal": {"axes": []}}, "goal: unknown key"),
    "text for a number": ({"algorithm.alpha": "0.9"}, "algorithm.alpha: expected a valid"),
    "truth for a number": ({"algorithm.alpha": True}, "got True"),
    "negative gain": ({"algorithm.alpha": -0.9}, "algorithm.alpha: expected greater than 0"),
    "zero period": (
        {"run.sampling_period": 0},
        "run.sampling_period: expected greater than 0, got 0",
    ),
    "negative period": (
        {"run.sampling_period": -0.1},
        "run.sampling_period: expected greater than 0, got -0.1",
    ),
    "period between nanoseconds": (
        {"run.sampling_period": 0.1234567891},
        "run.sampling_period: expected a whole number of nanoseconds",
    ),
    "output step that does not divide": (
        {"run.output_step": 0.03},
        "run.output_step: expected a step that divides the sampling period of 0.1 s, such as "
        "0.025 or 0.05, got 0.03 s",
    ),
    "duration that is no whole number": (
        {"run.duration": 30.05},
        "run.duration: expected a whole number of sampling periods of 0.1 s, such as 30.0 or 30.1, "
        "got 30.05 s",
    ),
    "infinite duration": ({"run.duration": float("inf")}, "expected a finite number"),
    "fractional seed": ({"run.seed": 1.5}, "run.seed: expected a whole number, got 1.5"),
    "no path from the target": (
        {"network.pinning": [0, 0, 0, 0, 0, 1]},
        "no path leads from the target to robots 1-5",
    ),
    "short row": (
        {"network.adjacency.1": [1, 0]},
        "network.adjacency[1]: expected 6 weights, got 2",
    ),
    "long pinning": (
        {"network.pinning": [0, 0, 1, 0, 0, 0, 1]},
        "network.pinning: expected 6 weights, got 7",
    ),
    "robot that receives from itself": (
        {"network.adjacency.1": [1, 1, 0, 0, 0, 0]},
        "network.adjacency[1][1]: expected 0, robot 2 cannot receive from itself",
    ),
    "negative weight": (
        {"network.adjacency.1": [-1, 0, 0, 0, 0, 0]},
        "network.adjacency[1][0]: expected greater than or equal to 0, got -1",
    ),
    "gains for three joints": (
        {"controller.kp": [1, 2, 3]},
        "controller.kp: expected 2 entries, one for each of the target's axes, got 3",
    ),
    "ragged gain": (
        {"controller.kp": [[1, 2], [3]]},
        "controller.kp[1]: expected 2 numbers, one for each of the target's axes, got 1",
    ),
    "disturbance on one axis": (
        {"disturbance.axes": [{"cosines": [{"amplitude": 2.0, "frequency": 2.0}]}]},
        "disturbance.axes: expected 2 axes, one for each of the target's axes, got 1",
    ),
    "initial rows": (
        {"initial.q": [[1, 2]]},
        "initial.q: expected 2 numbers for each robot, or 6 x 2, a row for each, got 1 rows",
    ),
    "initial numbers": (
        {"initial.q": [1, 2, 3]},
        "initial.q: expected 2 numbers for each robot, or 6 x 2, a row for each, got 3 numbers",
    ),
    "initial row": (
        {"initial.q": [[0, 0]] * 5 + [[0]]},
        "initial.q[5]: expected 2 numbers, one for each of the target's axes, got 1",
    ),
    "initial number": (
        {"initial.q": "3"},
        "initial.q: expected a number, a list of numbers, a list of lists of numbers or {uniform = "
        "[low, high]}, got '3'",
    ),
    "reversed range": (
        {"initial.q.uniform": [25.0, -25.0]},
        "initial.q.uniform: expected [low, high] with low <= high, got [25.0, -25.0]",
    ),
    "robot that there is not": (
        {"robots": [{"id": 7}]},
        "robots[0].id: expected 1 to 6, got 7",
    ),
    "robot given twice": (
        {"robots": [{"id": 3}, {"id": 3}]},
        "robots[1].id: robot 3 has been given before",
    ),
    "one robot's initial state": (
        {"robots": [{"id": 3, "initial": {"q": [1, 2, 3]}}]},
        "robots[0].initial.q: expected 2 numbers, one for each of the target's axes, got 3",
    ),
    "weights beyond all numbers": (
        {"network.adjacency.0": [0, 1e308, 1e308, 0, 0, 0]},
        "network.adjacency[0]: expected weights whose sum is a finite number",
    ),
    "longer than the clock": (
        {"run.duration": 1e11},
        "run.duration: expected less than 2^63 ns (292 years), got 100000000000.0 s",
    ),
    "name for no quantity": (
        {"plant.variables": {"velocty_ref": "v"}},
        "plant.variables.velocty_ref: no quantity of ours; did you mean 'velocity_ref'?",
    ),
    "parameter that has a table": (
        {"plant.parameters": {"kp": 7.0}},
        "plant.parameters.kp: give it as controller.kp instead",
    ),
    "unknown algorithm": (
        {"algorithm.name": "dcea0"},
        "algorithm.name: expected one of dcea1, dcea2, ",
    ),
    "no quantity, with a number": (
        {"plant.variables": {"qdd": 3}},
        "plant.variables.qdd: no quantity of ours; did you mean 'qd'?",
    ),
    "variable's name": (
        {"plant.variables": {"q": 3}},
        "plant.variables.q: expected a valid string, got 3",
    ),
    "a word that YAML takes for true": (
        {"controller.gravity_compensation": "yes"},
        "controller.gravity_compensation: expected true or false, got 'yes'",
    ),
    "per cent of edges": (
        {"network": {"generator": {"kind": "small_world", "n": 6, "k": 1, "rewire": 10}}},
        "network.generator.rewire: expected a probability, from 0 to 1, got 10",
    ),
    "no variable's name": (
        {"plant.variables": {"q": []}},
        "plant.variables.q: expected at least one name, got []",
    ),
    "pattern without an index": (
        {"plant.variables": {"q": {"pattern": "q"}}},
        "plant.variables.q.pattern: expected a name with {i} for the index, and {j} for a second",
    ),
    "pattern's base": (
        {"plant.fmu": "a", "plant.variables": {"q": {"pattern": "q{i}", "base": 2}}},
        "plant.variables.q.base: expected 0 or 1, got 2",
    ),
    "pattern's key": (
        {"plant.fmu": "a", "plant.variables": {"q": {"pattern": "q{i}", "bse": 0}}},
        "plant.variables.q.bse: unknown key; did you mean 'base'?",
    ),
    "infinite parameter": (
        {"plant.parameters": {"m1": float("inf")}},
        "plant.parameters.m1: expected a finite number, got inf",
    ),
    "table for a parameter": (
        {"plant.parameters": {"m1": [1, {"a": 2}]}},
        "plant.parameters.m1[1]: expected a valid number, got {'a': 2}",
    ),
    "ragged parameter": (
        {"plant.parameters": {"m1": [1, [2]]}},
        "plant.parameters.m1[0]: expected a list, got 1",
    ),
}


@pytest.mark.parametrize(("change", "message"), BAD.values(), ids=BAD.keys())
def test_a_wrong_scenario_names_field_value_and_remedy(change, message):
    with pytest.raises(ScenarioError) as error:
        paper(change)
    assert message in str(error.value)
    assert all(line.startswith("paper.toml: ") for line in str(error.value).splitlines())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"controller": None, "controler": {"kp": 200.0, "kd": 300.0}},
            "controler: unknown key; did you mean 'controller'?",
        ),
        (
            {"algorithm.alpha": None, "algorithm.alhpa": 0.9},
            "algorithm.alhpa: unknown key; did you mean 'alpha'?",
        ),
    ],
)
def test_a_misspelt_key_is_not_also_reported_as_missing(change, message):
    with pytest.raises(ScenarioError) as error:
        paper(change)
    assert str(error.value).splitlines() == [f"paper.toml: {message}"]


NO_TOML = {
    "number without end": ("seed = " + "1" * 5000, "not valid TOML: "),
    "nested without end": ("seed = " + "[" * 5000, "not valid TOML: nested too"),
    "bracket without end": ("[run", "not valid TOML: Expected ']'"),
    "key twice": ("[run]\nseed = 1\nseed = 2\n", "line 3: 'seed = 2' gives a key a second"),
    "table twice": ("[algorithm]\n[run]\n[algorithm]\n", "'[algorithm]' gives a key a second time"),
    "inline twice": (
        "q = { uniform = [-1, 1], uniform = [-2, 2] }",
        "gives a key a second time; keep one",
    ),
}


@pytest.mark.parametrize(("text", "message"), NO_TOML.values(), ids=NO_TOML.keys())
def test_a_text_that_is_not_toml_is_refused_in_one_line(text, message):
    with pytest.raises(ScenarioError) as error:
        parse_scenario(text, "s", SCENARIOS, "s.toml")
    assert str(error.value).startswith("s.toml: ")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["", "# nothing\n"])
def test_an_empty_file_is_one_error_line(text):
    with pytest.raises(ScenarioError) as error:
        parse_scenario(text, "s", SCENARIOS, "s.toml")
    assert str(error.value) == (
        "s.toml: is empty; a scenario has [run], [algorithm], [controller], [network], [target], "
        "[plant]"
    )


def test_all_faults_of_a_scenario_are_reported_at_once():
    with pytest.raises(ScenarioError) as error:
        paper({"algorithm.alpha": None, "algorithm.alhpa": 0.9, "run.seed": -1})
    assert [line.split(": ")[1] for line in str(error.value).splitlines()] == [
        "run.seed",
        "algorithm.alhpa",
    ]


def test_missing_and_unreadable_scenario_files_are_named(tmp_path):
    with pytest.raises(ScenarioError, match=r"none\.toml: no such file"):
        read_scenario(tmp_path / "none.toml")
    with pytest.raises(ScenarioError, match="cannot be read"):
        read_scenario(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="cannot be read"):
        read_scenario(tmp_path / "binary.toml")
