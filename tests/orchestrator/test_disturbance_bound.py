"""What bounds a disturbance of sines: the supremum of each axis, not the sum of its amplitudes."""

from math import inf, sqrt

import pytest

from nrs_cosim.orchestrator.analysis.plant_bounds import plant_bounds
from tests.scenarios import paper

UP, DOWN = ({"amplitude": sign, "frequency": 3.0} for sign in (1.0, -1.0))


@pytest.mark.parametrize(
    ("first", "second", "most"),
    [
        ({"sines": [UP], "cosines": [UP]}, {"offset": 1.0}, sqrt(3)),
        ({"sines": [UP, DOWN]}, {}, 0.0),
        ({"sines": [UP], "offset": -1.0}, {"sines": [UP]}, sqrt(5)),
        ({"sines": [UP]}, {"rate": 1.0}, inf),
    ],
)
def test_the_bound_of_partly_cancelling_sines_is_their_supremum(first, second, most):
    scenario = paper({"disturbance.axes": [first, second]})
    assert [part.lambda_d for part in plant_bounds(scenario)] == [pytest.approx(most, rel=1e-11)]
