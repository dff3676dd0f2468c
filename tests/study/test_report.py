"""A study's boundary is found, and what is drawn of it is where theory has it."""

import json
import re

import numpy as np
import pytest
from matplotlib.image import imread

import nrs_cosim as nrs
from nrs_cosim.orchestrator.study import report
from nrs_cosim.orchestrator.study.report import StudyReport
from nrs_cosim.orchestrator.study.rows import StudyRow
from nrs_cosim.orchestrator.study.store import StudyStore
from tests.cases import cases
from tests.command import nrs as command
from tests.scenarios import PAPER_FILE

PAPER = nrs.Scenario.load(PAPER_FILE)
BOUND = nrs.check(PAPER).as_json()["alpha_beta_bound"]
"""Of Theorem 1, on α and on β."""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Return a study over both gains, with two seeds, and one point that failed."""
    folder = tmp_path_factory.mktemp("study")
    axes = {"algorithm.alpha": [0.8, 1.1, 1.5], "algorithm.beta": [0.8, 1.1, 1.5]}
    short = PAPER.replace({"run.duration": 2.0, "run.output_step": 0.1})
    made = nrs.sweep(short, axes, seeds=2, out=folder, jobs=0)
    row = next(row for row in made.rows if row.status == "converged")
    failure = {"status": "failed", "cause_kind": "plant", "reason": "<b>it & broke</b>"}
    with StudyStore(folder) as store:
        store.put(StudyRow.of(row.as_json() | failure | {"recording": "recordings/x.mcap"}))
    return made


def test_refinement_finds_the_boundary_of_theorem_1_within_a_hundredth(tmp_path):
    scenario = PAPER.replace({"run.output_step": 0.1})
    arguments = {"out": tmp_path, "jobs": 0, "refine": "algorithm.alpha", "width": 0.012}
    study = nrs.sweep(scenario, {"algorithm.alpha": [0.9, 1.5]}, **arguments)
    ((change),) = study.boundary("algorithm.alpha")
    assert change["high"] - change["low"] <= 0.012
    assert change["converges_below"]
    assert (change["low"] + change["high"]) / 2 == pytest.approx(BOUND, rel=0.01)
    assert len(study) == 2 + 6
    digest = study.digest
    again = nrs.sweep(scenario, {"algorithm.alpha": [0.9, 1.5]}, **arguments)
    assert (len(again), again.digest) == (8, digest)


def test_a_boundary_needs_an_axis_of_numbers(study):
    with pytest.raises(nrs.errors.InputError, match="is on no axis of the study"):
        study.boundary("run.sampling_period")


def test_where_what_a_scenario_names_is_gone_the_page_says_that_theory_has_no_lines(
    study, monkeypatch
):
    def bases_of(_store):
        raise nrs.errors.InputError("algorithm.name: it is gone")

    monkeypatch.setattr(report, "bases_of", bases_of)
    found = StudyReport(StudyStore(study.folder))
    assert found.lead()["not drawn"] == "lines of theory: algorithm.name: it is gone"
    assert [len(drawn.radius) for drawn in found.maps()] == [0]


def test_theorys_boundary_on_a_map_is_that_of_theorem_1(study):
    (drawn,) = StudyReport(StudyStore(study.folder)).maps()
    assert len(drawn.x) == 9
    for places in (drawn.radius, drawn.margin):
        # two values on either axis are on both sides, for two values of the other one
        assert len(places) == 4
        off = np.abs(places - BOUND).min(axis=1)
        assert (off < (1.5 - 1.1) / 2**6).all()
    share = dict(zip(zip(drawn.x, drawn.y, strict=True), drawn.share, strict=True))
    assert share[0.8, 1.5] == share[1.5, 0.8] == 0
    assert drawn.failed.sum() == 1


def test_a_slice_has_shares_errors_and_bounds(study):
    first, second = StudyReport(StudyStore(study.folder)).slices()
    assert (first.x_name, second.x_name) == ("algorithm.alpha", "algorithm.beta")
    assert [line.name for line in first.lines] == [
        f"algorithm.beta = {beta}" for beta in (0.8, 1.1, 1.5)
    ]
    line = first.lines[0]
    theory = nrs.check(PAPER.replace({"algorithm.alpha": 1.1, "algorithm.beta": 0.8}))
    assert line.bounds["steady_state"][1] == theory.bounds[0].steady_state
    assert line.radius[1] == pytest.approx(theory.spectral_radius, rel=1e-12)
    assert np.isnan(line.error[0][2])


def test_the_page_needs_nothing_else_and_has_failures_with_a_line_to_run_them(study):
    page = study.folder / "page.html"
    done = command("study", "report", study.folder, "-o", page)
    assert done.returncode == 0, done.stderr
    text = page.read_text("utf-8")
    assert "&lt;b&gt;it &amp; broke&lt;/b&gt;" in text
    assert "<b>it" not in text
    assert '<a href="recordings/x.mcap">' in text
    assert not re.findall(r'(?:src|href)="(?:https?:)?//', text)
    (failure,) = json.loads(command("study", "info", study.folder, "--json").stdout)["failures"]
    assert failure["command"] in text
    assert text.count("<svg") == 3
    assert text.count("<!-- a run failed -->") == 1, "in the legend of the map"


@pytest.mark.parametrize("form", cases(["png", "pdf", "svg"], ["png"]))
def test_figures_for_print_are_drawn(study, tmp_path, form):
    path = tmp_path / f"study.{form}"
    study.report(path)
    if form == "png":
        pixels = imread(path)[..., :3]
        assert (pixels.min(axis=-1) < 0.9).mean() > 0.1
    assert path.stat().st_size > 10_000


def test_a_study_without_an_axis_is_a_page_too(tmp_path):
    short = PAPER.replace({"run.duration": 1.0})
    study = nrs.sweep(short, {"algorithm.name": ["dcea1", "dcea2"]}, out=tmp_path, jobs=0)
    for name in ("a.html", "a.png"):
        study.report(tmp_path / name)
    assert "dcea2" in (tmp_path / "a.html").read_text("utf-8")


def test_no_other_file_is_replaced_by_a_report(study, tmp_path):
    (tmp_path / "a.html").write_text("mine", "utf-8")
    done = command("study", "report", study.folder, "-o", tmp_path / "a.html")
    assert done.returncode == 2
    assert "exists and is no report" in done.stderr
    assert (tmp_path / "a.html").read_text("utf-8") == "mine"
