"""What `nrs check` concludes first: each kind of ending, and the same object in text and JSON."""

from io import StringIO

import pytest
from rich.console import Console

from nrs_cosim.orchestrator.analysis.bounds import ultimate_bounds
from nrs_cosim.orchestrator.analysis.conclusion import conclusion
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.cli.conclusion_text import conclusion_sentence
from nrs_cosim.orchestrator.cli.summary_text import theory_table
from nrs_cosim.orchestrator.scenario.robot_ids import growth_said
from tests.scenarios import example

AT_04 = {"run": {"duration": 8.0, "sampling_period": 0.4}}
"""Of the paper's example 3, where one period of delay is too much."""


def concluded(base, changes=None):
    experiment = example(base, changes or {})
    checked = check(experiment)
    return conclusion(checked, ultimate_bounds(experiment, checked.links.radius))


@pytest.mark.parametrize(
    ("base", "changes", "status", "proven", "source"),
    [
        ("paper_first_order", {}, "converges", True, "spectral radius < 1"),
        ("paper_example_1c", {}, "diverges", True, "spectral radius >= 1"),
        (
            "paper_example_3a",
            {**AT_04, "faults": {"links": [{"delay": 1}]}},
            "diverges",
            True,
            "statement D1",
        ),
        ("paper_lossy_links", {}, "converges in mean square", True, "statement L3"),
        ("byzantine_dcea1", {}, "unknown", False, ""),
        ("compare_sliding", {}, "unknown", False, ""),
    ],
)
def test_the_status_is_that_of_the_links_and_has_its_source(base, changes, status, proven, source):
    found = concluded(base, changes)
    assert (found.status, found.proven, found.source) == (status, proven, source)
    assert bool(found.why_unknown) == (status == "unknown")
    assert found.as_json()["status"] == status


def test_what_converges_almost_surely_alone_is_not_called_proven():
    """dcea2 at h = 0.4 with a loss of a half: 1.0740 in mean square, 0.9885 almost surely."""
    losses = {"faults": {"links": [{"loss": 0.5}]}, "algorithm.missing": "drop"}
    found = concluded("paper_example_3b", {**AT_04, **losses})
    assert (found.status, found.proven) == ("converges almost surely", False)
    assert "by simulation, not proven" in conclusion_sentence(found)


def test_growth_by_simulation_is_said_with_both_ends():
    """alpha = 1.8 at a loss of 0.6: the exponent by simulation, with 99.9 % confidence."""
    losses = {"faults": {"links": [{"loss": 0.6}]}, "algorithm.alpha": 1.8}
    found = concluded("paper_first_order", losses)
    assert 1 < found.growth < found.growth_at_most < 1.05
    said = f"by {found.growth:.4g} to {found.growth_at_most:.4g} (99.9 %)"
    assert said in conclusion_sentence(found)


@pytest.mark.parametrize(
    ("most", "said"), [(None, "at least 1.250000"), (1.25, "a factor of 1.250000")]
)
def test_growth_is_a_factor_where_it_is_exact_and_else_at_least_one(most, said):
    assert growth_said(1.25, most) == said


def test_the_sentence_has_the_numbers_of_the_object():
    found = concluded("paper_first_order")
    sentence = conclusion_sentence(found)
    assert f"{found.settling_time:.4g} s" in sentence
    assert f"{found.within['position']:.4g}" in sentence
    assert f"{found.within['velocity']:.4g}" in sentence
    assert found.of == "this target"
    diverging = concluded("paper_example_1c")
    assert diverging.growth == pytest.approx(1.014386, abs=5e-7)
    assert (diverging.within, diverging.of, diverging.settling_time) == (None, "", None)
    assert "1.014386" in conclusion_sentence(diverging)


@pytest.mark.parametrize("alpha", [1.1715728752538, 1.1715728])
def test_a_margin_that_is_not_zero_is_not_printed_as_zero(alpha):
    experiment = example("paper_first_order", {"algorithm.alpha": alpha})
    checked, console = check(experiment), Console(width=120, record=True, file=StringIO())
    margin = checked.conditions[0].margin
    assert 0 < abs(margin) < 5e-7
    theory_table(console, checked, ultimate_bounds(experiment, checked.links.radius), [])
    row = next(line for line in console.export_text().splitlines() if "equation 0.8" in line)
    assert f"{margin:+.2g}" in row
