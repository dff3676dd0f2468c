"""Of a study over what links do, rows and theory's boundaries are of the links of each point."""

import json

import numpy as np
import pytest

import nrs_cosim as nrs
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.study.report import StudyReport
from nrs_cosim.orchestrator.study.store import StudyStore
from nrs_cosim.orchestrator.study.theory_boundary import HALVINGS, below_one, theory_boundary
from tests.scenarios import paper, tables
from tests.study.test_radius_map import LINKS, SECOND, THREE, radius

H, BETA, GAINS = 0.4, 0.9, [0.5, 1.5]
TIMES = {"run.sampling_period": H, "run.output_step": H, "run.duration": 2.4}
LOSSY = SECOND | THREE | LINKS | {"algorithm.missing": "drop", "initial": {}}
ALPHA, DELAY, LOSS = "algorithm.alpha", "faults.links.0.delay", "faults.links.0.loss"


def expect_between(place, axis, width, radius_at):
    """Assert that ρ is 1 between the values on both sides of a place, as near as it is halved."""
    ends = [np.add(place, sign * width / 2 ** (HALVINGS + 1) * np.eye(2)[axis]) for sign in (-1, 1)]
    low, high = (radius_at(*end) for end in ends)
    assert low < 1 <= high


def test_over_delays_rows_and_the_boundary_are_of_late_links(tmp_path):
    scenario = nrs.Scenario(tables(LOSSY, TIMES, {"plant.fmu": "planar_robot"}))
    study = nrs.sweep(scenario, {ALPHA: GAINS, DELAY: [0, 1]}, out=tmp_path, jobs=0)
    for row in study.rows:
        alpha, delay = json.loads(row.point).values()
        exact = radius(alpha, BETA, H, delay, 0.0)
        assert row.spectral_radius == row.spectral_radius_lower == pytest.approx(exact, rel=1e-6)
        assert row.convergence == ("converges" if exact < 1 else "diverges")
    (drawn,) = StudyReport(StudyStore(tmp_path)).maps()
    assert drawn.impaired
    ((alpha, delay),) = drawn.radius  # on the axis of delays there is nothing between 0 and 1
    assert delay == 1
    expect_between((alpha, delay), 0, 1.0, lambda a, d: radius(a, BETA, H, int(d), 0.0))


def test_over_losses_the_boundary_is_that_of_mean_squares_and_ends_at_the_critical_loss():
    losses = [0.1, 0.6]
    base = paper(LOSSY, TIMES)
    values = {(a, p): 1 - radius(a, BETA, H, 0, p) for a in GAINS for p in losses}
    places = theory_boundary({base.name: base}, {}, (ALPHA, LOSS), values, below_one)
    assert [place[1 - axis] for axis, place in enumerate(places)] == [losses[0], GAINS[0]]
    for axis, (place, width) in enumerate(zip(places, (1.0, 0.5), strict=True)):
        expect_between(place, axis, width, lambda a, p: radius(a, BETA, H, 0, p))
    critical = check(paper(LOSSY, TIMES, {ALPHA: GAINS[0], LOSS: 0.1})).links.loss.critical
    assert places[1][1] == pytest.approx(critical, abs=0.5 / 2**HALVINGS)
