"""Runs beside the bounds of the theory: within, exceeded, or without any; and the proof's own V."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.orchestrator.analysis.accuracy import designed
from nrs_cosim.orchestrator.analysis.bounds import Bound, bounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.check_warnings import warnings_of
from nrs_cosim.orchestrator.analysis.comparison import (
    ComparedQuantity,
    TheoryComparison,
    compare_to_theory,
)
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.analysis.plant_bounds import plant_bounds, tracking_conditions
from nrs_cosim.orchestrator.analysis.plant_samples import Sampling
from nrs_cosim.orchestrator.cli.comparison_text import theory_comparison
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import experiment_of, measure
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.recordings.export.tables import states
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import SteadyState
from tests.plant_fmu.test_bounds import two_link
from tests.printed import masked
from tests.scenarios import PAPER_FILE, SCENARIOS, paper


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("promises") / "paper.mcap"
    run(read_scenario(PAPER_FILE), path)
    return path


def test_the_paper_example_is_within_every_bound(recording):
    with Reader(recording) as reader:
        compared = compare_to_theory(
            reader, read_scenario(PAPER_FILE), measure(reader, experiment_of(reader))
        )
    assert compared.why_not == ""
    assert [row.against_bound for row in compared.quantities] == ["within"] * 4
    assert compared.measured_radius == pytest.approx(compared.spectral_radius, rel=2e-3)
    for row in compared.quantities[:2]:
        assert (
            row.measured
            <= row.bound.steady_state * (1 + 1e-6)
            <= row.bound.worst_case
            <= row.bound.paper
        )
        assert row.measured == pytest.approx(row.bound.steady_state, rel=1e-2)
        assert row.transient < 1e-5


def test_a_measurement_beyond_a_bound_is_reported_with_its_tick(recording):
    with Reader(recording) as reader:
        true = measure(reader, experiment_of(reader))
        broken = SteadyState(0.2, true.velocity_estimate, 0.4, 0.4, (int(27.3e9), 0, 0, 0))
        compared = compare_to_theory(reader, read_scenario(PAPER_FILE), broken)
    assert [row.against_bound for row in compared.quantities] == ["exceeds", *["within"] * 3]
    assert compared.quantities[0].tick == 273


def test_a_recording_of_other_gains_exceeds_the_bounds(recording):
    """As if agents had jumped otherwise than their gains say."""
    other = paper({"algorithm.alpha": 1.1})
    with Reader(recording) as reader:
        compared = compare_to_theory(reader, other, measure(reader, experiment_of(reader)))
    assert compared.quantities[0].against_bound == "exceeds"
    assert compared.measured_radius is not None


def test_a_run_with_a_third_party_fmu_says_why_tracking_has_no_bounds(recording):
    other = paper({"plant.fmu": "theirs.fmu"})
    with Reader(recording) as reader:
        compared = compare_to_theory(reader, other, measure(reader, experiment_of(reader)))
        ours = compare_to_theory(
            reader, read_scenario(PAPER_FILE), measure(reader, experiment_of(reader))
        )
    assert "P3 are not known of theirs.fmu" in compared.untracked
    assert ours.untracked == ""
    assert [row.against_bound for row in compared.quantities] == [*["within"] * 2, *["unknown"] * 2]


def test_a_run_with_faults_or_divergence_has_no_bounds():
    lossy = ultimate_bounds(read_scenario(SCENARIOS / "paper_lossy_links.toml"))
    assert lossy.why_not.startswith(
        "links lose samples, any number in a row: errors have mean squares"
    )
    assert (lossy.steady_state, lossy.worst_case, lossy.paper) == (None, None, None)
    diverging = ultimate_bounds(read_scenario(SCENARIOS / "paper_example_1c.toml"))
    assert "diverge" in diverging.why_not
    assert diverging.tracking.paper is None


def test_the_bounds_of_short_runs_include_the_transient(tmp_path):
    file = paper({"run.duration": 2.0})
    run(file, tmp_path / "short.mcap")
    with Reader(tmp_path / "short.mcap") as reader:
        compared = compare_to_theory(reader, file, measure(reader, experiment_of(reader)))
    row = compared.quantities[0]
    assert row.measured > row.bound.worst_case
    assert row.against_bound == "within"
    assert row.transient > 0.1
    assert row.above == ("steady_state", "worst_case")
    (position, *_) = compared.as_json()["quantities"]
    assert (position["status"], position["above"]) == ("transient", ["steady_state", "worst_case"])
    assert position["transient"] == row.transient


COMPARED = [
    (0.16, "within", (), "within"),
    (0.174, "within", ("paper",), "within"),
    (0.46, "exceeds", ("worst_case", "paper"), "exceeded"),
    (0.46, "within", ("worst_case", "paper"), "transient"),
    (0.46, "unknown", ("worst_case", "paper"), "unproven"),
    (None, "unknown", (), "not measured"),
]
BOUND = Bound("|q - eps_0|2", None, 0.4504, 0.1675)


@pytest.mark.parametrize(("measured", "against_bound", "above", "status"), COMPARED)
def test_a_comparison_states_which_bounds_it_is_above(measured, against_bound, above, status):
    row = ComparedQuantity(BOUND, measured, 10, 0.0, against_bound)
    assert (row.above, row.status) == (above, status)
    unproven = replace(row, bound=replace(BOUND, unproven=True))
    for one, which in ((row, []), (unproven, ["paper"])):
        (shown,) = TheoryComparison("", (one,), None, None).as_json()["quantities"]
        assert (shown["status"], shown["above"]) == (status, list(above))
        assert shown["unproven"] == which


def test_comparisons_with_the_theory_print_their_snapshot(snapshot):
    written = io.StringIO()
    console = Console(file=written, width=100, soft_wrap=True)
    for measured, against_bound, *_ in COMPARED:
        for bound in (BOUND, replace(BOUND, unproven=True)):
            row = ComparedQuantity(bound, measured, 10, 0.0, against_bound)
            for radius in (None, 0.1021, 0.9):
                theory_comparison(console, TheoryComparison("", (row,), 0.1, radius).as_json())
                written.write("\n")
    snapshot("comparison", masked(written.getvalue()))


def test_during_the_transient_tracking_is_not_reported_as_exceeded(tmp_path):
    file = paper({"run.duration": 2.0})
    run(file, tmp_path / "short.mcap")
    with Reader(tmp_path / "short.mcap") as reader:
        broken = replace(measure(reader, experiment_of(reader)), position_tracking=50.0)
        compared = compare_to_theory(reader, file, broken)
    row = compared.quantities[2]
    assert row.measured > row.bound.worst_case
    assert row.against_bound == "unknown"


def test_robots_with_their_own_controller_have_their_own_bounds():
    scenario = paper({"robots": [{"id": 3, "controller": {"kp": 25.0, "kd": 300.0}}]})
    parts = plant_bounds(scenario)
    assert [part.robots for part in parts] == [(1, 2, 4, 5, 6), (3,)]
    kp = tracking_conditions(scenario)[0]
    assert (kp.name, kp.right, kp.holds) == ("kp (tracking)", 25.0, True)
    assert warnings_of(check(scenario)) == []


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"controller.kp": [[200.0, 1.0], [1.0, 200.0]]}, "diagonal"),
        ({"plant.fmu": "theirs.fmu"}, "P3 are not known"),
        ({"disturbance.axes.0.rate": 1.0}, "grows"),
    ],
)
def test_when_the_tracking_theorems_do_not_apply_the_reason_is_given(change, why):
    scenario = paper(change)
    (part,) = plant_bounds(scenario)
    assert why in part.why
    assert part.constants is None
    assert tracking_conditions(scenario) == []
    assert ultimate_bounds(scenario).tracking.paper is None


def test_p3_of_a_third_party_fmu_is_sampled_and_dependent_results_are_marked(tmp_path):
    (tmp_path / "theirs.fmu").write_bytes(build("two_link_arm", 2).read_bytes() + b"\0")
    file = paper({"plant.fmu": "theirs.fmu"}, folder=tmp_path)
    find = Sampling(file)
    ours = read_scenario(PAPER_FILE)
    checked, ultimate = check(file, find), ultimate_bounds(file, find=find)
    (part,), (steady_state,) = ultimate.robots, plant_bounds(ours)
    assert part.bounds.states > 1000
    assert json.loads(json.dumps(ultimate.as_json()))["plants"][0]["bounds"]["source"] == "sampled"
    for name in ("mu_1", "mu_2", "rho_1", "rho_2"):
        true = getattr(steady_state.constants, name)
        assert true * 0.99 < getattr(part.constants, name) < true * (1 + 1e-6)
    marked = {c["name"]: c["sampled"] for c in checked.as_json()["conditions"]}
    assert marked == {
        "alpha": False, "beta": False, "kp": False, "kd": False,
        "kp (tracking)": True, "kd (tracking)": True,
    }  # fmt: skip
    assert [row.sampled for row in bounds(ultimate)] == [False, False, True, True]
    assert [row.sampled for row in bounds(ultimate_bounds(ours))] == [False] * 4
    assert designed(file, EstimateBounds(0.5, 0.5), 0.5, find).paper.kp == pytest.approx(
        designed(ours, EstimateBounds(0.5, 0.5), 0.5).paper.kp, rel=1e-3
    )


def test_an_fmu_that_cannot_be_sampled_gives_the_reason(tmp_path):
    file = paper({"plant.fmu": "none.fmu"}, folder=tmp_path)
    (part,) = plant_bounds(file, Sampling(file))
    assert "P3 cannot be sampled: " in part.why
    assert "none.fmu: no such FMU" in part.why


def test_gains_below_the_theorems_give_no_warning():
    scenario = paper({"controller.kp": 10.0})
    kp = {c.name: c for c in check(scenario).conditions}["kp (tracking)"]
    assert not kp.holds
    assert warnings_of(check(scenario)) == []


def test_v_of_the_proof_decreases_where_inequality_1_8_says_so(tmp_path):
    """V, with M of the paper's text, along a run that starts far out with good estimates."""
    file = paper(
        {
            "run.duration": 3.0,
            "run.output_step": 0.002,
            "initial.position.uniform": [-0.2, 0.0],
            "initial.velocity.uniform": [1.0, 1.2],
        },
    )
    run(file, tmp_path / "far.mcap")
    (part,) = plant_bounds(file)
    of, drive = part.constants, part.drive
    with Reader(tmp_path / "far.mcap") as reader:
        table = np.concatenate(list(states(reader)))
    looked = 0
    for robot in range(1, 7):
        mine = table[table["robot"] == robot]
        t = mine["time_ns"] / 1e9
        motion = file.target.at(t)
        e, ed = mine["position"] - motion.position, mine["velocity"] - motion.velocity
        x, y, z = (np.linalg.norm(v, axis=1) for v in (e, ed, np.tanh(e)))
        off = [
            mine["reference_position"] - motion.position,
            mine["reference_velocity"] - motion.velocity,
        ]
        rho_3 = of.mu_1 + sum(
            K * np.linalg.norm(v, axis=1) for K, v in zip((200, 300), off, strict=True)
        )
        slope = -((drive.kd_min - of.rho_2) * y - rho_3) * y
        slope -= ((drive.kp_min - of.rho_1) * x / np.sqrt(2) - rho_3) * z
        V = [value(*row) for row in zip(mine["position"], e, ed, strict=True)]
        down = (slope[:-1] < 0) & (slope[1:] < 0)
        assert np.all(np.diff(V)[down] < 0)
        looked += int(down.sum())
    assert looked > 500


def value(q, e, ed):
    """Return V_i of equation (4.0) at Kp = 200 I, Kd = 300 I."""
    M, *_ = two_link(q, np.zeros(2))
    swing = ed @ M @ ed / 2 + ed @ M @ np.tanh(e) + 100 * e @ e
    return swing + 300 * np.sum(np.logaddexp(e, -e) - np.log(2))


def test_a_recording_of_an_algorithm_that_is_not_installed_is_not_compared(recording):
    file = read_scenario(PAPER_FILE)
    gone = file.scenario.algorithm.model_copy(update={"name": "gone"})
    other = replace(file, scenario=file.scenario.model_copy(update={"algorithm": gone}))
    with Reader(recording) as reader:
        compared = compare_to_theory(reader, other, measure(reader, file))
    assert "'gone'" in compared.why_not
    assert compared.quantities == ()


def test_a_target_at_rest_has_bounds_of_zero():
    result = ultimate_bounds(paper({"target.axes": [{"offset": 1.0}, {"offset": -1.0}]}))
    assert (result.gamma_1, result.gamma_2) == (0, 0)
    assert result.steady_state == result.worst_case == result.paper.bound == EstimateBounds(0, 0)
    assert result.tracking.paper.position < 0.2
