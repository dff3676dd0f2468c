"""The map of ρ over both gains that a report has, beside what `check` says of such scenarios."""

import numpy as np
import pytest

from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.report.gain_map import gain_map
from nrs_cosim.recordings.report.stability import stability
from tests.orchestrator.networks import PAPER, PATH, phases
from tests.scenarios import SECOND_ORDER, paper

LATE = {"faults.links": [{"delay": 1}]}


@pytest.mark.parametrize("faults", [{}, LATE])
def test_each_cell_is_what_check_says_of_its_gains(faults):
    experiment = paper(SECOND_ORDER, faults)
    found = gain_map(experiment, check(experiment))
    assert found.own == (1.1, 0.9)
    for row, column in ((0, 0), (3, 5), (-1, 2), (-1, -1)):
        gains = {"algorithm.alpha": found.values[0][column], "algorithm.beta": found.values[1][row]}
        checked = check(paper(SECOND_ORDER, faults, gains))
        assert found.radius[row, column] == pytest.approx(checked.spectral_radius, rel=1e-9)
    picture = stability(found)
    assert f"the least on this grid is {np.nanmin(found.radius):.4g}" in picture
    assert picture.count("<rect") == found.radius.size
    assert picture.count('class="grows"') == np.sum(found.radius >= 1) > 0


@pytest.mark.parametrize(
    "changes",
    [
        {"algorithm": {"name": "pd_like", "alpha": 0.9}},
        {"faults.links": [{"loss": 0.1}]},
        {"run.sampling_jitter": 0.2},
        {"network": phases((1, PAPER), (3, PATH), repeat=4)},
    ],
)
def test_of_one_gain_and_of_what_is_drawn_or_in_turn_there_is_none(changes):
    experiment = paper(changes)
    assert gain_map(experiment, check(experiment)) is None
    assert stability(None) == ""
