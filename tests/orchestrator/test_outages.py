"""Outages end, and bounds are of the time after them; those of no sampling time are idle."""

import io

import pytest
from rich.console import Console

from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.analysis.results import Result
from nrs_cosim.orchestrator.cli.comparison_text import theory_comparison
from nrs_cosim.orchestrator.cli.links_text import link_rows
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.scenario_warnings import scenario_warnings
from nrs_cosim.recordings.mcap.reader import Reader
from tests.scenarios import paper


def silent(*outages, duration=6.0):
    of = [{"id": 3, "outages": [[*span] for span in outages]}]
    return paper({"run.duration": duration, "faults.robots": of})


def test_what_an_outage_does_to_the_last_fifth_is_not_laid_to_the_initial_error(tmp_path):
    experiment = silent((3.0, 5.0))
    assert link_rows(check(experiment).links)["outages"] == (
        "the last is over at 5 s; the steady state is of the time after it"
    )
    with Reader(run(experiment, tmp_path / "run.mcap").path) as reader:
        theory = Result.of(reader, experiment).theory
    position = theory["quantities"][0]
    assert position["measured"] > 2 * position["bounds"]["worst_case"]
    assert (position["status"], theory["steady_since"]) == ("unproven", 5.0)
    screen = io.StringIO()
    theory_comparison(Console(file=screen, width=300), theory)
    assert "and bounds are of the steady state from 5 s on; |eps - eps_0|inf" in screen.getvalue()
    assert "initial error" not in screen.getvalue()


@pytest.mark.parametrize("span", [(3.0, 4.0), (1.0, 1.5)])
def test_after_an_outage_that_is_long_over_all_is_compared(tmp_path, span):
    experiment = silent(span, duration=30.0)
    with Reader(run(experiment, tmp_path / "run.mcap").path) as reader:
        theory = Result.of(reader, experiment).theory
    assert theory["steady_since"] is None
    assert {row["status"] for row in theory["quantities"]} == {"within"}


@pytest.mark.parametrize(
    ("spans", "why"),
    [
        ([(50.0, 60.0)], "[50.0, 60.0] begins after the run, which ends at 6 s"),
        ([(0.01, 0.02)], "[0.01, 0.02] has no sampling time in it"),
    ],
)
def test_an_outage_of_no_sampling_time_changes_no_theory_and_is_told(spans, why):
    idle, sound = silent(*spans), paper({"run.duration": 6.0})
    assert scenario_warnings(idle) == [f"faults.robots[0].outages: {why}: nothing is lost by it"]
    checked = check(idle)
    assert (checked.links.status, checked.links.outages_end) == ("converges", None)
    assert checked.links.radius.upper == check(sound).links.radius.upper
    of_link = paper({"run.duration": 6.0, "faults.links": [{"to": 2, "outages": [[*spans[0]]]}]})
    assert scenario_warnings(of_link) == [f"faults.links[0].outages: {why}: nothing is lost by it"]
    assert scenario_warnings(silent((1.0, 2.0))) == []
