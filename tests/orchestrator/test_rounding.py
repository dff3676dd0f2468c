"""What a bound may be passed by is the rounding of the numbers of the run, large or small."""

from dataclasses import replace

import pytest

import nrs_cosim as nrs
from nrs_cosim.orchestrator.analysis.comparison import compare_to_theory
from nrs_cosim.orchestrator.engine.summary import experiment_of, measure
from nrs_cosim.recordings.mcap.reader import Reader
from tests.scenarios import SCENARIOS


@pytest.fixture
def paper():
    scenario = nrs.Scenario.load(SCENARIOS / "paper_first_order.toml")
    return scenario.replace({"plant.fmu": "planar_robot", "run.duration": 60.0})


def compared(scenario, path, **changes):
    nrs.run(scenario, path).close()
    with Reader(path) as reader:
        measured = replace(measure(reader, experiment_of(reader)), **changes)
        return compare_to_theory(reader, experiment_of(reader), measured).quantities[0]


def test_rounding_of_a_large_position_does_not_exceed_a_bound_of_0(paper, tmp_path):
    far = {"target.axes": [{"offset": 1e9}, {"offset": -3.3e8}], "run.divergence_limit": 1e12}
    row = compared(paper.replace(far), tmp_path / "run.mcap")
    assert row.bound.steady_state == 0.0
    assert 0.0 < row.measured <= 2.0**-22  # two units in the last place of 1e9
    assert (row.against_bound, row.above) == ("within", ())


def test_an_excess_over_a_tiny_bound_is_found(paper, tmp_path):
    small = {"amplitude": 1e-9, "frequency": 1.0}
    slow = {"target.axes": [{"sines": [small]}, {"cosines": [small]}]}
    path = tmp_path / "run.mcap"
    row = compared(paper.replace(slow), path)
    assert row.against_bound == "within"
    assert row.measured == pytest.approx(row.bound.steady_state, rel=0.05)
    with Reader(path) as reader:
        more = replace(
            measure(reader, experiment_of(reader)), position_estimate=1.5 * row.bound.steady_state
        )
        (beyond, *_) = compare_to_theory(reader, experiment_of(reader), more).quantities
    assert beyond.against_bound == "exceeds"
    assert "steady_state" in beyond.above
