"""Switching networks, and separate ones for positions and velocities, as a scenario says them."""

import pytest

from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.file import parse_scenario
from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema
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
from tests.scenarios import SCENARIOS, example


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
            "but no path leads from the target to robots 5-6; let one of them receive from the ",
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
            "no path leads from the target to robot 1; let one of them receive from the target",
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
