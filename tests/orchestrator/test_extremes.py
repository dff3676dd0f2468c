"""Any number of a scenario may be out of all proportion: it is refused, or theory goes on."""

import copy
import json
import warnings

import pytest

import nrs_cosim as nrs
from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.analysis.bounds import bounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.check_warnings import warnings_of
from nrs_cosim.orchestrator.analysis.conditions import check
from tests.cases import ALL, cases
from tests.command import nrs as nrs_command
from tests.scenarios import SCENARIOS, example, tables, write

SMALL = tables(
    {
        "run": {"duration": 2.0, "sampling_period": 0.1},
        "algorithm.beta": 0.8,
        "network": {"edge_list": [[0, 1, 1.0], [1, 2, 1.0], [2, 1, 0.5]]},
        "target.axes": [
            {
                "offset": 1.0,
                "rate": 2.0,
                "sines": [{"amplitude": 1.0, "frequency": 1.0, "phase": 0.1}],
            },
            {"cosines": [{"amplitude": -1.0, "frequency": 2.0}]},
        ],
        "plant.parameters": {"m1": 1.0, "r1": 1.0, "g": 9.8},
        "disturbance.axes": [{"sines": [{"amplitude": 2.0, "frequency": 1.0}]}, {"offset": 0.5}],
        "initial": {"position": {"uniform": [-1.0, 1.0]}},
    }
)
"""Of two robots, for which the theory of jitter and of turns is found in a tenth of the time."""
EXTREMES = (1e155, -1e155, 1e300, -1e300, 1e308, 1e-300, -1e-300, 5e-324, -0.0)


def places(tree, at=()):
    """Yield where the numbers of nested tables and lists are."""
    if isinstance(tree, dict | list):
        for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
            yield from places(value, (*at, key))
    elif isinstance(tree, float):
        yield at


FEW = (1e155, 1e-300)


def put(given, at, value):
    """Return given with another value in one place."""
    changed = copy.deepcopy(given)
    inner = changed
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = value
    return changed


def faults_of(given, extremes, compared):
    """Judge tables with one number after the other changed: what was raised but errors of input."""
    found, passed = [], 0
    for number, at in enumerate(places(given)):
        for extreme in extremes if ALL else extremes[number % 3 :: 3]:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    compared(put(given, at, extreme))
                    passed += 1
            except InputError:
                continue
            except Exception as error:
                found.append((at, extreme, repr(error)))
    return "\n".join(map(str, found)), passed


def checked(given):
    """Ask the theory of given all that `nrs check` shows."""
    scenario = example(given)
    result = check(scenario)
    ultimate = ultimate_bounds(scenario, result.links.radius)
    bounds(ultimate)
    warnings_of(result)
    json.dumps([result.as_json(), ultimate.as_json()], allow_nan=False)


def ran(given):
    """Run given, and measure them beside the theory, as `nrs run` does."""
    with nrs.run(nrs.Scenario(given, folder=SCENARIOS)) as recording:
        json.dumps(recording.analysis())


EACH = ["dcea1", "impulsive", "dcea2", "sliding"]


@pytest.mark.parametrize("algorithm", cases(EACH, EACH[:1]))
def test_an_extreme_number_is_refused_or_analysed(algorithm):
    small = tables({"algorithm.name": algorithm}, base=SMALL)
    found, passed = faults_of(small, EXTREMES, checked)
    assert not found, found
    assert passed > (50 if ALL else 15)


PHASES = [
    {"from": 1, "edge_list": [[0, 1, 1.0], [1, 2, 1.0]]},
    {"from": 3, "edge_list": [[0, 2, 1.0], [2, 1, 0.5]]},
]
SECOND = tables({"algorithm.name": "dcea2"}, base=SMALL)
KINDS = {
    "faults": tables(base="paper_lossy_links"),
    "jitter": tables({"run.sampling_jitter": 0.2}, base=SECOND),
    "switching networks": tables({"network": {"repeat": 4, "switching": PHASES}}, base=SECOND),
}


@pytest.mark.parametrize("kind", cases([*KINDS], [*KINDS][2:3]))
def test_an_extreme_number_beside_faults_jitter_or_switching_is_refused_or_analysed(kind):
    found, passed = faults_of(KINDS[kind], FEW, checked)
    assert not found, found
    assert passed > (10 if ALL else 5)


def test_a_run_with_an_extreme_number_is_refused_or_ends_with_a_reason():
    brief = tables({"run.duration": 0.2}, base="paper_lossy_links")
    found, passed = faults_of(brief, FEW[:1], ran)
    assert not found, found
    assert passed > (10 if ALL else 5)


@pytest.mark.parametrize("command", [("check",), ("run", "-o", "run.mcap")])
@pytest.mark.parametrize("key", ["m1", "r1", "g"])
def test_a_parameter_of_too_many_digits_is_named(tmp_path, command, key):
    path = write(tmp_path / "big.toml", {f"plant.parameters.{key}": int("9" * 400)}, base=SMALL)
    done = nrs_command(command[0], path, *command[1:], cwd=tmp_path)
    assert done.returncode == 2
    assert key in done.stderr
    assert "too large" in done.stderr
    assert len(done.stderr) < 1000
