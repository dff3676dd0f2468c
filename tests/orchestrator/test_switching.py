"""Networks in turn, and apart for positions and velocities: files, runs, and what is promised."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from nrs_cosim.bus.matrices import as_array
from nrs_cosim.orchestrator.analysis.bounds import designed, ultimate_bounds
from nrs_cosim.orchestrator.analysis.comparison import compare_to_theory
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.cli.main import app
from nrs_cosim.orchestrator.engine.run import past_of, run
from nrs_cosim.orchestrator.engine.summary import experiment_of, measure
from nrs_cosim.orchestrator.errors import Interrupted, ScenarioError
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.orchestrator.report.subject import subject_of
from nrs_cosim.orchestrator.scenario.file import parse_scenario, read_scenario
from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema
from nrs_cosim.recordings.export.tables import samples
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cluster.local_workers import digest, switching
from tests.estimator_agents.paper import second_order
from tests.orchestrator.networks import (
    PAPER,
    PAPERS,
    PATH,
    edges,
    generator,
    on,
    phases,
    read_on,
    separate,
)
from tests.scenarios import SCENARIOS, example, paper, tables


def compared(path, file):
    with Reader(path) as reader:
        return compare_to_theory(reader, file, measure(reader, experiment_of(reader)))


# What a scenario says


def test_each_phase_may_have_any_form_of_network():
    network = phases((1, PAPER), (4, separate(PATH, PAPER)), repeat=9)
    scenario = on(network)
    topologies = scenario.topologies
    path = {(i, i + 1) for i in range(6)}
    assert [topologies.at(k) for k in (1, 3, 4, 9, 10)] == [0, 0, 1, 1, 0]
    first, second = topologies.exchanges
    assert first.position is first.velocity
    assert edges(first.position) == edges(second.velocity) == set(PAPERS)
    assert edges(second.position) == path
    assert edges(topologies.links) == path | set(PAPERS)
    assert scenario.n == topologies.n == 6


def test_the_random_network_of_a_phase_depends_on_its_place():
    random = generator(kind="random_k_in", n=40, k=3)
    one, two = on(phases((1, random), (2, random))).topologies.exchanges
    assert edges(one.position) != edges(two.position)
    again = on(phases((1, random), (5, random), repeat=7)).topologies
    assert edges(again.exchanges[1].position) == edges(two.position)


def test_the_edges_of_each_phase_travel_beside_the_text(tmp_path):
    for name, rows in (("a", PAPERS), ("b", [(i, i + 1) for i in range(6)])):
        lines = ["source,sink", *(f"{j},{i}" for j, i in rows)]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines), "utf-8")
    network = phases(
        (1, {"edges": "a.csv"}),
        (3, separate({"edges": "b.csv"}, {"edges": "a.csv"})),
        (8, {"edges": "b.csv"}),
    )
    file = read_on(network, tmp_path)
    again = parse_scenario(file.text, "again", SCENARIOS / "nowhere", "again", file.assets)
    assert again.scenario == file.scenario
    assert len(file.assets) == 4
    first, second, third = file.topologies.exchanges
    assert edges(first.position) == edges(second.velocity) == set(PAPERS)
    assert edges(second.position) == edges(third.position) == {(i, i + 1) for i in range(6)}
    (tmp_path / "a.csv").unlink()
    with pytest.raises(
        ScenarioError, match=r"network\.switching\[0\]\.edges: a\.csv: no such file"
    ):
        read_on(network, tmp_path)


@pytest.mark.parametrize(
    ("network", "result"),
    [
        (
            phases((2, PAPER)),
            "network.switching[0].from: expected 1, the first tick, in the first",
        ),
        (
            phases((1, PAPER), (1, PATH)),
            "network.switching[1].from: expected more than 1, as entri",
        ),
        (
            phases((1, PAPER), (10, PATH), (11, PAPER), (2100, PATH), repeat=2100),
            "network.switching[2].from: expected at most 10, the last tick of the run, got 11; ",
        ),
        (
            phases((1, PAPER), (9, PATH), repeat=8),
            "network.repeat: expected at least 9, where the",
        ),
        ({"repeat": 3, **PAPER}, "network.repeat: is of network.switching, got 3; leave it out"),
        (
            phases((1, PAPER), repeat=0),
            "network.repeat: expected greater than or equal to 1, got 0",
        ),
        (
            phases((0, PAPER)),
            "network.switching[0].from: expected greater than or equal to 1, got",
        ),
        (phases((1.5, PAPER)), "network.switching[0].from: expected a whole number, got 1.5"),
        ({"switching": [PAPER]}, "network.switching[0].from: missing, it has no defaul"),
        ({"switching": []}, "network.switching: expected at least one, got []"),
        (
            phases((1, {})),
            "network.switching[0]: expected one of adjacency (with pinning), generat",
        ),
        (PAPER | phases((1, PAPER)), "got edge_list and switching; keep one of them"),
        (
            phases((1, PAPER), (5, {"generator": {"kind": "path", "n": 5}})),
            "network.switching[1]: expected 6 robots, as network.switching[0] has, got 5",
        ),
        (
            phases(
                (1, PAPER), (5, {"edge_list": [[0, 1], [1, 2], [1, 3], [1, 4], [5, 6], [6, 5]]})
            ),
            "network.switching[1]: expected a spanning tree rooted at the target (assumption A2), "
            "but no path leads from the target to robots 5-6; let one of them hear the target (an ",
        ),
        (
            phases((1, PAPER), (5, {"edge_list": [[0, 1], [1, 1]]})),
            "switching[1].edge_list[1]: expe",
        ),
        (
            phases((1, PAPER), (5, {"edge_lst": [[0, 1]]})),
            "network.switching[1].edge_lst: unknown k",
        ),
        ({"position": PAPER}, "network.velocity: missing, it has no default beside net"),
        (
            separate(PAPER, {}),
            "network.velocity: expected one of adjacency (with pinning), generator",
        ),
        (
            separate(PAPER, {"generator": {"kind": "path", "n": 5}}),
            "network.velocity: expected 6 robots, as network.position has, got 5",
        ),
        (
            separate(PAPER, {"generator": {"kind": "path", "n": 6, "pinned": [2]}}),
            "network.velocity: expected a spanning tree rooted at the target (assumption A2), but "
            "no path leads from the target to robot 1; let one of them hear the target (network.ve",
        ),
        (
            separate(PAPER, {"edges": "a.csv"}),
            "network.velocity.edges: 'a.csv' is read where a scena",
        ),
    ],
)
def test_a_wrong_switching_network_names_field_value_and_remedy(network, result):
    with pytest.raises(ScenarioError) as error:
        on(network)
    assert result in str(error.value)


@pytest.mark.parametrize(
    ("name", "alpha", "beta"), [("dcea2", 1.1, 0.9), ("pd_like", 1.1, 1.0), ("impulsive", 0.5, 0.5)]
)
def test_two_digraphs_are_refused_where_an_algorithm_has_use_for_one(name, alpha, beta):
    with pytest.raises(ScenarioError) as error:
        example("hetero_information", {"algorithm": {"name": name, "alpha": alpha, "beta": beta}})
    assert str(error.value) == (
        f"hetero_information.toml: network.velocity: {name} receives positions and velocities over "
        "one digraph; give network one digraph, or take dcea1"
    )


def test_sliding_uses_separate_digraphs_for_positions_and_velocities():
    sliding = {"name": "sliding", "alpha": 0.5, "beta": 0.5}
    checked = check(example("hetero_information", {"algorithm": sliding}))
    assert len(checked.phases[0].digraphs) == 2


def test_the_schema_has_switching_networks():
    schema = json_schema()["$defs"]
    assert schema["PhaseTable"]["properties"].keys() >= {
        "from",
        "edge_list",
        "position",
        "velocity",
    }
    assert schema["Network"]["properties"].keys() >= {
        "switching",
        "repeat",
        "position",
        "generator",
    }


# Runs


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
    heard = table[np.lexsort((table["robot"], table["k"]))].reshape(40, 7)
    for k in range(1, 40):
        now, then = heard[k - 1], heard[k]
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


# What is promised


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
    ultimate = ultimate_bounds(file, checked.rho)
    assert ultimate.paper is None
    path = run(file, tmp_path / "run.mcap").path
    found = compared(path, file)
    assert [row.against_bound for row in found.quantities] == ["within"] * 4
    for row in found.quantities[:2]:
        assert 0.99 * row.bound.steady_state < row.measured <= row.bound.steady_state * (1 + 1e-6)
        assert row.bound.steady_state < row.bound.worst_case
    assert found.measured_radius == pytest.approx(result["spectral_radius"], abs=0.01)


def test_gains_above_1_that_suit_each_phase_may_diverge_under_switching(tmp_path):
    """Now robot 1 and now robot 2 hears the target: docs/theory.md has the numbers."""
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
        assert bool(checked.warnings()) != settles
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
    ultimate = ultimate_bounds(scenario, checked.rho)
    assert ultimate.why_not.endswith(why_not)
    assert (ultimate.why_not == "") == (ultimate.worst_case is not None) == (name != "switching")
    assert (checked.spectral_radius < 1) == settles


def test_check_describes_switching_networks():
    nrs = CliRunner()
    result = nrs.invoke(app, ["check", str(SCENARIOS / "switching.toml")]).output
    assert "3 phases, repeated after 25 ticks" in result
    assert "converge in any order of these digraphs, for both gains are below 1" in result
    assert "no small-value norm is of a switching topology" in result
    result = nrs.invoke(app, ["check", "--json", str(SCENARIOS / "hetero_information.toml")]).output
    assert len(json.loads(result)["topologies"]) == 1


def test_a_design_for_switching_uses_the_period():
    scenario = read_scenario(SCENARIOS / "switching.toml")
    found = designed(scenario, ultimate_bounds(scenario).tracking.worst_case, 0.5)
    assert found.paper.period is None
    assert found.proven.period > 0


def test_a_report_says_which_networks_are_active_when():
    switching, has_two_digraphs, paper = (
        subject_of(read_scenario(SCENARIOS / f"{name}.toml"), "rad")
        for name in ("switching", "hetero_information", "paper_first_order")
    )
    assert switching.phases.startswith("3 phases of the network, again after 25 ticks: these are")
    assert has_two_digraphs.phases.startswith(
        "Positions and velocities travel over digraphs of their own: "
    )
    assert paper.phases == ""
    path, star = {(i, i + 1) for i in range(6)}, {(0, 6), *((6, i) for i in range(1, 6))}
    assert edges(switching.topology) == {*PAPERS} | path | star
