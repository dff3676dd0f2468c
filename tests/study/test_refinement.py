"""Refinement finds the boundary of statuses that are known by a formula; nothing is run."""

import json
from concurrent.futures import Executor, Future
from itertools import pairwise

import pytest

import nrs_cosim as nrs
from nrs_cosim.orchestrator.study.rows import StudyRow
from tests.scenarios import PAPER_FILE, tables

PAPER = nrs.Scenario.load(PAPER_FILE)
GAINS = {"algorithm.alpha": [0.5, 1.0, 1.5], "algorithm.beta": [1.0, 3.0]}
ALPHA, BETA = GAINS


class Formula(Executor):
    """Says what came of each point by a formula of its values."""

    def __init__(self, converges):
        self.converges = converges

    def submit(self, _run, task):
        """Return its row at once."""
        status = "converged" if self.converges(json.loads(task.point)) else "diverged"
        row = StudyRow(
            key=task.key, point=task.point, scenario=task.name, seed=task.seed, status=status
        )
        future = Future()
        future.set_result(row.as_json())
        return future


def swept(scenario, axes, converges, **options):
    """Return the study of a formula."""
    return nrs.sweep(scenario, axes, executor=Formula(converges), jobs=1, **options)


def points(study):
    """Return the values of its rows."""
    return [json.loads(row.point) for row in study.rows]


def product(point):
    """Say whether a point is below a hyperbola."""
    return point[ALPHA] * point[BETA] < 2.2


def test_every_line_of_the_grid_along_every_axis_is_narrowed_to_the_width():
    study = swept(PAPER, GAINS, product, refine="boundary", width=0.05, seeds=2)
    for at, (key, other) in enumerate([(ALPHA, BETA), (BETA, ALPHA)]):
        for fixed in GAINS[other]:
            line = sorted({point[key] for point in points(study) if point[other] == fixed})
            root = 2.2 / fixed
            around = [(a, b) for a, b in pairwise(line) if a < root <= b]
            assert all(b - a <= 0.05 for a, b in around)
            assert len(around) == (GAINS[key][0] < root <= GAINS[key][-1]), at
    for point in points(study):
        assert point[ALPHA] in GAINS[ALPHA] or point[BETA] in GAINS[BETA], "on lines of the grid"
    assert len(study) == 2 * len({(*point.values(),) for point in points(study)})


def test_one_key_is_narrowed_alone():
    study = swept(PAPER, GAINS, product, refine=ALPHA, width=0.05)
    assert {point[BETA] for point in points(study)} == {1.0, 3.0}
    assert len({point[ALPHA] for point in points(study)}) > 3


def test_points_between_are_left_out_where_the_condition_does_not_hold():
    where = f"{ALPHA} < 0.7 or {ALPHA} > 0.8"
    study = swept(PAPER, GAINS, product, refine=ALPHA, width=0.01, where=where)
    assert not any(0.7 <= point[ALPHA] <= 0.8 for point in points(study))


def test_between_whole_numbers_there_are_whole_numbers_and_then_none():
    generator = {"generator": {"kind": "random_k_in", "n": 12, "k": 2, "pinned": [1]}}
    scenario = nrs.Scenario(
        tables({"network": generator, "run.duration": 1.0}, base="ring_100")
    )  # fmt: skip
    key = "network.generator.k"
    study = swept(scenario, {key: [1, 9]}, lambda point: point[key] < 4, refine=key, width=0.1)
    assert sorted(point[key] for point in points(study)) == [1, 3, 4, 5, 9]
    assert study.boundary(key) == [{"low": 3, "high": 4, "converges_below": True}]


@pytest.mark.parametrize("axes", [{}, {"algorithm.name": ["dcea1", "dcea2"]}, {ALPHA: [0.9]}])
def test_without_an_axis_of_numbers_there_is_no_boundary_to_refine(axes):
    with pytest.raises(nrs.errors.InputError, match="refine: 'boundary': expected boundary, or a"):
        swept(PAPER, axes, product, refine="boundary")
