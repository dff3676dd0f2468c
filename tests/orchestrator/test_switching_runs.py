"""Runs on switching and separate networks, against dense matrices and the theory of them."""

import numpy as np
import pytest

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.orchestrator.analysis.accuracy import designed
from nrs_cosim.orchestrator.analysis.bounds import ultimate_bounds
from nrs_cosim.orchestrator.analysis.check_warnings import warnings_of
from nrs_cosim.orchestrator.analysis.comparison import compare_to_theory
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.engine.run import past_of, run
from nrs_cosim.orchestrator.engine.summary import experiment_of, measure
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.orchestrator.report.subject import subject_of
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.recordings.export.tables import samples
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cluster.local_workers import digest, switching
from tests.estimator_agents.paper import second_order
from tests.orchestrator.networks import (
    PAPERS,
    edges,
    on,
    phases,
)
from tests.scenarios import SCENARIOS, example, paper, tables


def compared(path, file):
    with Reader(path) as reader:
        return compare_to_theory(reader, file, measure(reader, experiment_of(reader)))


@pytest.mark.parametrize("name", ["switching", "hetero_information"])
def test_recorded_samples_agree_with_dense_switching_matrices(tmp_path, name):
    """x(t_{k+1}) from x(t_k) by the digraphs of k, read from the file by themselves."""
    given = tables({"run.duration": 4.0}, base=name)
    path = run(example(given), tmp_path / "run.mcap").path
    alpha, beta, h = given["algorithm"]["alpha"], given["algorithm"]["beta"], 0.1

    def share(form):
        w = np.zeros((6, 7))
        if "adjacency" in form:
            w = np.column_stack([form["pinning"], form["adjacency"]])
        elif "generator" in form:
            w[:, :6] = np.eye(6)
        else:
            for j, i in form["edge_list"]:
                w[i - 1, j] = 1
        return w / w.sum(axis=1, keepdims=True)

    network = given["network"]
    if "switching" in network:
        found = [share(phase) for phase in network["switching"]]
        order = [found[0 if p < 10 else 1 if p < 20 else 2] for p in range(network["repeat"])]
        both = [(one, one) for one in order]
    else:
        both = [(share(network["position"]), share(network["velocity"]))]
    with Reader(path) as reader:
        table = np.concatenate(list(samples(reader)))
    received = table[np.lexsort((table["robot"], table["k"]))].reshape(40, 7)
    for k in range(1, 40):
        now, then = received[k - 1], received[k]
        of_position, of_velocity = both[(k - 1) % len(both)]
        position, velocity = now["position"], now["velocity"]
        v = velocity[1:] + beta * (of_velocity @ velocity - velocity[1:])
        p = position[1:] + alpha * (of_position @ position - position[1:]) + h * v
        np.testing.assert_allclose(then["position"][1:], p, atol=1e-11)
        np.testing.assert_allclose(then["velocity"][1:], v, atol=1e-11)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return a run of networks in turn with faulty links, in one process."""
    return run(switching(), tmp_path_factory.mktemp("whole") / "1.mcap").path


def test_a_switching_run_is_resumed_and_verified(tmp_path, whole):
    def stop(time_ns):
        if time_ns >= 12_300_000_000:
            raise Interrupted

    cut = run(switching(), tmp_path / "cut.mcap", watch=stop)
    assert cut.status == "interrupted"
    with Reader(cut.path) as reader:
        outcome = run(switching(), tmp_path / "rest.mcap", past=past_of(reader))
    assert outcome.copied > 100
    assert digest(outcome.path) == digest(whole)
    with Reader(whole) as reader:
        assert verify(reader, switching(), plants=True).difference is None


def test_a_periodic_switching_run_is_within_its_bounds(tmp_path):
    file = read_scenario(SCENARIOS / "switching.toml")
    checked = check(file)
    result = checked.as_json()
    assert result["spanning_tree"] is True
    assert result["network"] is None
    assert [phase["from"] for phase in result["topologies"]] == [1, 11, 21]
    assert [phase["digraphs"][0]["network"]["pinned"] for phase in result["topologies"]] == [
        (3,), (1,), (6,),
    ]  # fmt: skip
    radii = [phase["spectral_radius"] for phase in result["topologies"]]
    assert radii == pytest.approx([0.2 + 0.8 * 0.5**0.5, 0.2, 0.2])
    assert result["alpha_beta_bound"] == pytest.approx(4 - 2 * 2**0.5, abs=1e-9)
    assert result["switching"]["repeat"] == 25
    assert result["switching"]["any_order"]["status"] == "proven"
    assert result["switching"]["any_order"]["by_gains"] is True
    ultimate = ultimate_bounds(file, checked.links.radius)
    assert ultimate.paper is None
    path = run(file, tmp_path / "run.mcap").path
    found = compared(path, file)
    assert [row.against_bound for row in found.quantities] == ["within"] * 4
    for row in found.quantities[:2]:
        assert 0.99 * row.bound.steady_state < row.measured <= row.bound.steady_state * (1 + 1e-6)
        assert row.bound.steady_state < row.bound.worst_case
    assert found.measured_radius == pytest.approx(result["spectral_radius"], abs=0.01)


def test_gains_above_1_that_suit_each_phase_may_diverge_under_switching(tmp_path):
    """Now robot 1 and now robot 2 receives the target: docs/theory.md has the numbers."""
    first, second = {"edge_list": [[0, 1], [1, 2]]}, {"edge_list": [[0, 2], [2, 1]]}
    pair = {
        "network": phases((1, first), (2, second), repeat=2),
        "run.output_step": 0.1,
        "run.duration": 60.0,
    }
    for gain, settles in ((0.97, True), (1.03, False)):
        file = paper(pair, {"algorithm.alpha": gain, "algorithm.beta": gain})
        checked = check(file)
        assert all(condition.holds for condition in checked.conditions)
        assert (checked.spectral_radius < 1) == settles
        assert checked.any_order.status == ("proven" if settles else "refuted")
        assert bool(warnings_of(checked)) != settles
        outcome = run(file, tmp_path / f"{gain}.mcap")
        with Reader(outcome.path) as reader:
            table = np.concatenate(list(samples(reader)))
        of = table["robot"] == 1
        apart = np.abs(table["velocity"][of] - table["velocity"][table["robot"] == 0]).max(axis=1)
        assert (apart[-50:].max() < 4) == settles
        assert (apart[-50:].max() > apart[:50].max()) != settles
        found = compared(outcome.path, file)
        assert found.why_not == ("" if settles else "the estimates diverge")


def test_bounds_of_switching_that_ends_are_of_the_last_phase(tmp_path):
    once = {"network.repeat": None}
    file = example("switching", once)
    last = on({"edge_list": [[0, 6], [6, 1], [6, 2], [6, 3], [6, 4], [6, 5]]})
    checked = check(file)
    assert checked.spectral_radius == pytest.approx(0.2)
    assert check(last).alpha_beta_bound == pytest.approx(2)
    found = compared(run(file, tmp_path / "run.mcap").path, file)
    assert [row.against_bound for row in found.quantities] == ["within"] * 4
    assert found.quantities[0].measured == pytest.approx(
        found.quantities[0].bound.steady_state, rel=0.02
    )
    file = example("switching", once, {"network.switching.2.from": 270})
    found = compared(run(file, tmp_path / "late.mcap").path, file)
    assert [row.against_bound for row in found.quantities] == ["unknown"] * 4


def test_each_quantity_of_hetero_information_has_its_own_bound(tmp_path):
    file = read_scenario(SCENARIOS / "hetero_information.toml")
    checked = check(file)
    bounds = {condition.name: condition.right for condition in checked.conditions}
    assert bounds["alpha"] == pytest.approx(4 - 2 * 2**0.5, abs=1e-9)
    assert bounds["beta"] == pytest.approx(2)
    assert checked.spectral_radius == pytest.approx(0.1 + 0.9 * 0.5**0.5)
    (phase,) = checked.as_json()["topologies"]
    assert [digraph["of"] for digraph in phase["digraphs"]] == ["positions", "velocities"]
    assert "switching" not in checked.as_json()
    found = compared(run(file, tmp_path / "run.mcap").path, file)
    assert [row.against_bound for row in found.quantities] == ["within"] * 4
    for row in found.quantities[:2]:
        assert row.measured == pytest.approx(row.bound.steady_state, rel=1e-3)
        assert row.bound.steady_state <= row.bound.worst_case <= row.bound.paper


def test_theorem_3_in_each_phase_is_not_enough_for_any_order():
    scenario = example("switching", {"algorithm.name": "dcea2"})
    checked = check(scenario)
    assert all(condition.holds for phase in checked.phases for condition in phase.conditions)
    assert (checked.spectral_radius < 1, checked.any_order.status) == (True, "refuted")
    assert checked.any_order.order == (2, 3, 2, 2, 2, 3, 2)
    worst = np.eye(12)
    for phase in checked.any_order.order:
        D = as_array(scenario.topologies.exchanges[phase - 1].position.D)
        worst = second_order(0.9, 0.8, 0.1, D) @ worst
    rho = np.abs(np.linalg.eigvals(worst)).max() ** (1 / 7)
    assert rho == pytest.approx(1.007, abs=5e-4)
    assert checked.any_order.lower == pytest.approx(rho, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "algorithm", "why_not", "settles"),
    [
        ("hetero_information", "dcea1", "", True),
        ("switching", "dcea1", "there are bounds at periodic sampling times alone", True),
        ("switching", "dcea2", "at times that are not periodic it is not computed", False),
        ("switching", "sliding", "the algorithm does not jump linearly", False),
    ],
)
def test_with_jitter_the_reason_for_missing_bounds_is_given(name, algorithm, why_not, settles):
    scenario = example(name, {"algorithm.name": algorithm, "run.sampling_jitter": 0.2})
    checked = check(scenario)
    ultimate = ultimate_bounds(scenario, checked.links.radius)
    assert ultimate.why_not.endswith(why_not)
    assert (ultimate.why_not == "") == (ultimate.worst_case is not None) == (name != "switching")
    assert (checked.spectral_radius < 1) == settles


def test_a_design_for_switching_uses_the_period():
    scenario = read_scenario(SCENARIOS / "switching.toml")
    found = designed(scenario, ultimate_bounds(scenario).tracking.worst_case, 0.5)
    assert found.paper.period is None
    assert found.proven.period > 0


def test_a_report_says_which_networks_are_active_when():
    switching, has_two_digraphs, paper = (
        subject_of(read_scenario(SCENARIOS / f"{name}.toml"), ["rad", "rad"])
        for name in ("switching", "hetero_information", "paper_first_order")
    )
    assert switching.phases.startswith("3 phases of the network, again after 25 ticks: these are")
    assert has_two_digraphs.phases.startswith(
        "Positions and velocities travel over digraphs of their own: "
    )
    assert paper.phases == ""
    path, star = {(i, i + 1) for i in range(6)}, {(0, 6), *((6, i) for i in range(1, 6))}
    assert edges(switching.topology) == {*PAPERS} | path | star
