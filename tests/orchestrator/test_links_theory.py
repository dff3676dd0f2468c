"""What `check` says of links that are late or lose samples, and what a run over them comes to."""

import json
from math import log

import numpy as np
import pytest

from nrs_cosim.orchestrator.analysis.bounds import ultimate_bounds
from nrs_cosim.orchestrator.analysis.comparison import compare_to_theory
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.analysis.link_recursions import radius_over
from nrs_cosim.orchestrator.analysis.mean_squares import root_mean_squares
from nrs_cosim.orchestrator.cli.theory_text import convergence_rows
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import measure
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import errors_by_tick
from tests.cases import cases
from tests.estimator_agents.paper import ADJACENCY
from tests.orchestrator.networks import PAPER, PATH, phases, separate
from tests.scenarios import SECOND_ORDER, paper

LATE = {"faults.links": [{"delay": 1}, {"from": 0, "delay": 3}, {"from": 2, "delay": 0}]}
SLOW = {"run.sampling_period": 0.4, "run.output_step": 0.4, "run.duration": 20.0}
TWO = {"network": {"adjacency": [[0, 1], [1, 0]], "pinning": [1, 0]}}
DRAWN = {"faults.links": [{"delay": {"uniform": [0, 1]}}]}
LATER = {"faults.links": [{"delay": {"uniform": [1, 2]}}]}
NOISY = {"faults.links": [{"noise": 0.1}, {"from": 2, "outages": [[3, 5]]}]}
HALF = {"faults.links": [{"loss": 0.5}]}
TRIGGERED = {
    "algorithm": {"name": "event_triggered", "alpha": 0.9, "beta": 0.9, "c0": 0.1, "d0": 0.1}
}
DROP = {"algorithm.missing": "drop"}


TURNS = {"network": phases((1, PAPER), (11, PATH), repeat=20)}
STAYS = {"network": phases((1, PATH), (11, PAPER))}
APART = {"network": separate(PAPER, PATH)}


@pytest.mark.parametrize(
    ("changes", "status", "source"),
    [
        ([SECOND_ORDER], "converges", ""),
        ([SECOND_ORDER, LATE], "converges", "statement D1"),
        ([SECOND_ORDER, SLOW, {"faults.links": [{"delay": 2}]}], "diverges", "statement D1"),
        ([DRAWN], "converges", "statement D3"),
        ([DRAWN, {"run.sampling_jitter": 0.3}], "converges", "statement D3"),
        ([DRAWN, DROP, {"algorithm.beta": 1.0}], "converges in mean square", "statement L3"),
        ([SECOND_ORDER, TWO, DRAWN], "converges", "statement D4"),
        ([SECOND_ORDER, HALF], "converges in mean square", "statement L1"),
        ([SECOND_ORDER, SLOW, HALF, DROP], "converges almost surely", "statement L4"),
        ([HALF, DROP, {"algorithm.alpha": 2.5}], "diverges", "statement L4"),
        ([DRAWN, {"faults.links.0.loss": 0.5}], "converges in mean square", "statement L3"),
        ([SECOND_ORDER, DRAWN], "converges almost surely", "statement L4"),
        ([SECOND_ORDER, DRAWN, DROP], "converges almost surely", "statement L4"),
        (
            [SECOND_ORDER, DRAWN, {"faults.links.0.loss": 0.1}],
            "converges almost surely",
            "statement L4",
        ),
        ([SECOND_ORDER, SLOW, LATER, {"algorithm.alpha": 3.0}], "diverges", "statement L4"),
        ([SECOND_ORDER, {"faults.links": [{"outages": [[3, 5]]}]}], "converges", "statement D1"),
        ([SECOND_ORDER, {"run.sampling_jitter": 0.2}, NOISY], "converges", "statement R1"),
        ([SECOND_ORDER, TURNS, LATE], "converges", "statement D5"),
        ([SECOND_ORDER, TURNS, SLOW, {"algorithm.alpha": 4.5}, LATE], "diverges", "statement D5"),
        ([APART, LATE, DROP], "converges", "statement D5"),
        ([SECOND_ORDER, STAYS, LATE], "converges", "statement D1"),
        ([TURNS, {"algorithm.beta": 0.9}, DRAWN], "converges", "statement D6"),
        ([TURNS, DRAWN], "converges almost surely", "statement L4"),
        ([SECOND_ORDER, TURNS, HALF, DROP], "converges in mean square", "statement L7"),
        ([APART, HALF, {"algorithm.beta": 0.9}], "converges in mean square", "statement L3"),
    ],
)
def test_what_links_do_to_convergence_is_known_by_a_statement(changes, status, source):
    checked = check(paper(*changes))
    assert (checked.links.status, checked.links.source) == (status, source)
    decided = {"converges in mean square": "converges"}
    proven = decided.get(status, status) if checked.links.proven else "unknown"
    assert checked.convergence == proven
    assert checked.links.proven == (source != "statement L4" or "2.5" in str(changes))
    rows = convergence_rows(checked)
    assert source in rows["rho"]
    assert ("rate" in rows) == (checked.links.radius.upper < 1)
    if "uniform" not in str(changes):  # maps and boundaries have that of drawn delays as unknown
        known = checked.links.radius
        found = radius_over(paper(*changes))
        assert (found.lower, found.upper) == pytest.approx((known.lower, known.upper), rel=1e-9)
    found = json.loads(json.dumps(checked.as_json()["links"], allow_nan=False))
    assert (found["loss"] is not None) == ("loss" in str(changes) and "uniform" not in str(changes))


@pytest.mark.parametrize(
    ("law", "source", "sink"), [(SECOND_ORDER, 3, 4), ({}, 3, 6), (SECOND_ORDER, 2, 1)]
)
def test_a_link_that_loses_every_sample_is_none_to_agents_that_drop(law, source, sink):
    gone = {"faults.links": [{"from": source, "to": sink, "loss": 1.0}]}
    adjacency = ADJACENCY.copy()
    adjacency[sink - 1, source - 1] = 0
    found, exact = check(paper(law, SLOW, gone, DROP)).links, 1.0
    if adjacency[sink - 1].any():  # else it receives nothing, and stays as far off as it was
        exact = check(paper(law, SLOW, {"network.adjacency": adjacency.tolist()})).rho.upper
    assert found.loss.mean_square.upper == pytest.approx(exact, rel=1e-4)  # a double root
    assert (found.source == "statement L1") == (exact < 1)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        (
            [{"faults.links": [{"loss": 1.0, "to": 6}]}],
            "a link loses every sample, and agents hold",
        ),
        ([{"faults.robots": [{"id": 2, "outages": [[3, 500]]}]}], "lasts to the end of the run"),
        ([{"faults.links": [{"delay": 1000}]}], "a delay is longer than the run"),
        ([HALF, TRIGGERED], "robots decide when they send"),
        ([TURNS, {"network.switching.1.from": 299, "network.repeat": None}, LATE], "a digraph of"),
    ],
)
def test_what_is_not_known_of_links_is_said_to_be_so(changes, why):
    checked = check(paper(*changes))
    assert (checked.links.status, checked.convergence) == ("unknown", "unknown")
    assert why in checked.links.why
    assert why in convergence_rows(checked)["links"]


def test_over_late_links_a_run_comes_to_the_steady_state_after_an_outage(tmp_path):
    outage = {"faults.robots": [{"id": 2, "outages": [[2.0, 3.0]]}], "run.duration": 24.0}
    experiment = paper(SECOND_ORDER, LATE, outage, {"plant.fmu": "planar_robot"})
    ultimate = ultimate_bounds(experiment)
    assert (ultimate.since, ultimate.why_not) == (30 + 3, "")
    run(experiment, tmp_path / "late.mcap")
    with Reader(tmp_path / "late.mcap") as reader:
        found = compare_to_theory(reader, experiment, measure(reader, experiment))
    for row in found.quantities[:2]:
        assert row.status == "within"
        assert row.measured == pytest.approx(row.bound.steady_state, rel=1e-2)
    assert found.measured_radius == pytest.approx(ultimate.radius, rel=5e-3)


def test_the_beginning_of_a_run_over_late_links_explains_what_is_above_the_bound(tmp_path):
    experiment = paper(SECOND_ORDER, LATE, {"run.duration": 2.0, "plant.fmu": "planar_robot"})
    run(experiment, tmp_path / "short.mcap")
    with Reader(tmp_path / "short.mcap") as reader:
        found = compare_to_theory(reader, experiment, measure(reader, experiment))
    row = found.quantities[0]
    assert row.status == "transient"
    assert row.bound.steady_state < row.measured <= row.bound.steady_state + row.transient


THIRD = {"algorithm": {"name": "dcea3", "alpha": 0.9, "beta": 0.9, "gamma": 0.9}}
ROUNDED = {"faults.links": [{"quantisation": 0.05, "delay": 1}]}


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ([{"algorithm.beta": 0.9}, DRAWN], ""),
        ([SECOND_ORDER, ROUNDED], ""),
        ([TRIGGERED], ""),
        ([THIRD], ""),
        ([TURNS], ""),
        ([{"run.sampling_jitter": 0.2}], ""),
        ([SECOND_ORDER, DRAWN], "where D3 says they converge"),
        ([DRAWN, DROP], "where agents hold"),
        ([HALF], "any number in a row"),
        ([{"faults.links": [{"noise": 0.1}]}], "a variance, and no bound"),
        ([TURNS, LATE], "of several digraphs there are bounds over links without faults alone"),
    ],
)
def test_tracking_has_a_proven_bound_or_it_is_said_why_not(changes, why, tmp_path):
    """All that has one is run too, where all cases are tried."""
    experiment = paper(*changes, {"plant.fmu": "planar_robot"})
    ultimate = ultimate_bounds(experiment)
    found = ultimate.tracking.worst_case
    assert (found is None) == bool(why)
    assert why in ultimate.why_not
    if found and cases(True, False):
        run(experiment, tmp_path / "bounded.mcap")
        with Reader(tmp_path / "bounded.mcap") as reader:
            most = measure(reader, experiment)
        assert most.position_tracking <= found.position
        assert most.velocity_tracking <= found.velocity


def test_over_late_links_errors_grow_as_of_a_period_of_digraphs_in_turn(tmp_path):
    """With gains that diverge, so that neither the target nor a beginning is seen in the end."""
    fast = {"algorithm.alpha": 4.5, "run.duration": 44.0, "run.divergence_limit": 1e30}
    experiment = paper(SECOND_ORDER, TURNS, SLOW, fast, LATE, {"plant.fmu": "planar_robot"})
    run(experiment, tmp_path / "turns.mcap")
    with Reader(tmp_path / "turns.mcap") as reader:
        parts = [np.abs(x).max((1, 2, 3)) for _, x in errors_by_tick(reader, experiment.target_at)]
        sizes = np.concatenate(parts)
    measured = (sizes[-1] / sizes[-41]) ** (1 / 40)
    assert measured == pytest.approx(check(experiment).links.radius.upper, rel=1e-3)


def test_a_target_that_is_no_sines_has_a_worst_case_alone_over_late_links():
    times = [0.0, 1.0, 2.0, 3.0]
    points = [[t, t * t] for t in times]
    target = {"target": {"kind": "sampled", "times": times, "positions": points}}
    late = ultimate_bounds(paper(SECOND_ORDER, LATE, target, {"run.duration": 3.0}))
    assert (late.why_not, late.steady_state) == ("", None)
    sines = ultimate_bounds(paper(SECOND_ORDER, LATE))
    speed = late.gamma_2 / sines.gamma_2  # neither is bounded by its speed
    assert late.worst_case.position <= sines.worst_case.position * speed * (1 + 1e-9)
    assert sines.steady_state.position < sines.worst_case.position


@pytest.mark.parametrize("missing", ["hold", "drop"])
def test_over_links_that_lose_samples_errors_are_as_large_as_expected(tmp_path, missing):
    """Of one run; means over many are in the tests of second moments."""
    links = {"faults.links": [{"loss": 0.3}, {"from": 3, "delay": 1}], "algorithm.missing": missing}
    experiment = paper(SECOND_ORDER, links, {"run.duration": 100.0, "plant.fmu": "planar_robot"})
    run(experiment, tmp_path / "lossy.mcap")
    with Reader(tmp_path / "lossy.mcap") as reader:
        found = compare_to_theory(reader, experiment, measure(reader, experiment))
    assert [one.name for one in found.mean_squares] == ["eps - eps_0", "ups - ups_0"]
    for one in found.mean_squares:
        assert one.measured == pytest.approx(one.expected, rel=0.1)
        assert one.robots_measured == pytest.approx(one.robots_expected, rel=0.25)
    assert "mean_squares" in json.loads(json.dumps(found.as_json()))


def test_nothing_is_expected_of_errors_in_short_runs_and_beside_noise(tmp_path):
    for changes in ({"run.duration": 2.0}, {"run.duration": 8.0, "faults.links.0.noise": 0.1}):
        experiment = paper(SECOND_ORDER, HALF, changes, {"plant.fmu": "planar_robot"})
        path = tmp_path / f"{len(changes)}.mcap"
        run(experiment, path)
        with Reader(path) as reader:
            assert root_mean_squares(reader, experiment) == ()


def test_the_rate_over_links_is_that_of_their_radius():
    late, lossy = (check(paper(SECOND_ORDER, faults)) for faults in (LATE, HALF))
    assert late.rate == pytest.approx(-10 * log(late.links.radius.upper))
    assert lossy.rate == pytest.approx(-10 * log(lossy.links.loss.mean_square.upper))
