"""Of a study over what links do, rows and theory's boundaries are of the links of each point."""

import json

import numpy as np
import pytest

import nrs_cosim as nrs
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.analysis.link_recursions import growth_over, radius_over
from nrs_cosim.orchestrator.study.report import StudyReport
from nrs_cosim.orchestrator.study.store import StudyStore
from nrs_cosim.orchestrator.study.theory_boundary import (
    HALVINGS,
    almost_surely_below_one,
    below_one,
    theory_boundary,
)
from nrs_cosim.recordings.report.study_figures import StudyMap, study_sheets
from tests.scenarios import paper, tables
from tests.study.test_radius_map import LINKS, SECOND, THREE, radius

ALMOST = "theory: e^λ = 1, almost surely (by simulation)"
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
        assert row.almost_sure == row.almost_sure_lower == row.spectral_radius
        assert row.convergence == ("converges" if exact < 1 else "diverges")
    (drawn,) = StudyReport(StudyStore(tmp_path)).maps()
    assert drawn.impaired
    assert drawn.almost_sure is None
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


def growth(alpha, beta, loss, runs=60, ticks=900, start=200):
    """Return e^λ of the same three robots, and its standard error, by the mean growth of runs."""
    rng = np.random.default_rng(5)
    weights = np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 0]], float)
    F, G = np.array([[1, H], [0, 1]]), np.array([[0, 0], [alpha, beta]])
    x, sizes = rng.normal(size=(runs, 2, 3)), np.zeros(runs)
    for k in range(ticks):
        there = weights * (rng.random((runs, 3, 4)) >= loss)
        whole = there.sum(axis=2, keepdims=True)
        D = np.divide(there, whole, out=np.zeros_like(there), where=whole > 0)[..., 1:]
        off = x @ D.transpose(0, 2, 1) - (whole[..., 0] > 0)[:, None] * x
        x = F @ (x + G @ off)
        size = np.abs(x).max(axis=(1, 2))
        x, sizes = x / size[:, None, None], sizes + np.log(size) * (k >= start)
    rates = sizes / (ticks - start)
    return np.exp(rates.mean()), rates.std(ddof=1) / runs**0.5


def test_almost_every_run_converges_up_to_a_line_of_its_own_beyond_that_of_mean_squares():
    base, losses = paper(LOSSY, TIMES), (0.2, 0.6)
    values = {(0.5, loss): 1.0 - growth(0.5, BETA, loss)[0] for loss in losses}
    effort = almost_surely_below_one, 1, 2
    ((alpha, loss),) = theory_boundary({base.name: base}, {}, (ALPHA, LOSS), values, *effort)
    half = (losses[1] - losses[0]) / 2**2 / 2
    (low, off), (high, _) = (growth(alpha, BETA, loss + end) for end in (-half, half))
    assert low - 4 * off <= 1 <= high + 4 * off
    assert low < high - 8 * off
    assert radius(alpha, BETA, H, 0, loss - half) > 1


def test_over_late_links_that_lose_nothing_it_is_the_spectral_radius():
    late = paper(LOSSY, TIMES, {ALPHA: 0.5, DELAY: 1})
    assert growth_over(late) == radius_over(late)


def test_a_figure_names_both_lines():
    places, one = np.array([[0.3, 0.4]]), np.array([0.0, 1.0, 0.0, 1.0])
    cells = (one, np.sort(one), one, one + 1, one < 0, places, places)
    for almost, names in (
        (None, ["theory: ρ = 1"]),
        (places, ["theory: mean-square radius = 1", ALMOST]),
    ):
        (sheet,) = study_sheets([StudyMap("", "α", "loss", *cells, almost_sure=almost)], [])
        found = [text.get_text() for text in sheet.legends[0].get_texts()]
        assert found == ["conditions: margin 0", *names]
