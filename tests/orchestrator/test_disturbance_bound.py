"""What bounds a disturbance of sines: the supremum of each axis, not the sum of its amplitudes."""

from math import inf, sqrt

import pytest

from nrs_cosim.orchestrator.analysis.plant_bounds import plant_bounds
from nrs_cosim.orchestrator.scenario.file import parse_scenario
from tests.orchestrator.conftest import SCENARIOS
from tests.orchestrator.test_extremes import TEXT

DISTURBANCE = "axes = [{ sines = [{ amplitude = 2.0, frequency = 1.0 }] }, { offset = 0.5 }]"


@pytest.mark.parametrize(
    ("first", "second", "most"),
    [
        ("sines = [{A}], cosines = [{A}]", "offset = 1.0", sqrt(3)),
        ("sines = [{A}, {B}]", "", 0.0),
        ("sines = [{A}], offset = -1.0", "sines = [{A}]", sqrt(5)),
        ("sines = [{A}]", "rate = 1.0", inf),
    ],
)
def test_a_disturbance_of_sines_that_partly_cancel_is_bounded_by_what_it_reaches(
    first, second, most
):
    first = first.replace("{A}", "{ amplitude = 1.0, frequency = 3.0 }")
    first = first.replace("{B}", "{ amplitude = -1.0, frequency = 3.0 }")
    second = second.replace("{A}", "{ amplitude = 1.0, frequency = 3.0 }")
    text = TEXT.format(algorithm="dcea1")
    assert DISTURBANCE in text
    changed = text.replace(DISTURBANCE, f"axes = [{{ {first} }}, {{ {second} }}]")
    scenario = parse_scenario(changed, "waves", SCENARIOS, "waves.toml")
    assert [part.lambda_d for part in plant_bounds(scenario)] == [pytest.approx(most, rel=1e-11)]
