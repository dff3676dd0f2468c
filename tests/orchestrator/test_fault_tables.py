"""The tables of faults in a scenario: what they mean, and what is wrong with them."""

import numpy as np
import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.links.links import LinkFault
from nrs_cosim.estimator_agents import installed
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.faults import link_faults
from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema
from tests.orchestrator.test_faults import FAULTY, faulty_links, faulty_robots
from tests.scenarios import paper


def both(position, velocity):
    return {"position": position, "velocity": velocity}


def test_later_fault_entries_override_earlier_ones_by_key():
    scenario = paper(FAULTY)
    faults = link_faults(scenario.scenario, scenario.topologies.links, ("position", "velocity"))
    assert len(faults) == 10
    assert faults[1, 2] == LinkFault(loss=0.3, noise=both(0.5, 0.5))
    late = {"loss": 0.3, "noise": {"velocity": 0.25}, "quantisation": both(0.5, 0.5)}
    assert faults[3, 6] == LinkFault(delay=(1, 1), **late)
    spans = ((1_000_000_000, 1_250_000_000), (1_500_000_000, 1_600_000_000))
    assert faults[3, 5] == LinkFault(delay=(0, 3), outages=spans, **late)


@pytest.mark.parametrize("key", ["noise", "quantisation"])
def test_a_field_that_is_not_sent_is_named_with_the_nearest(key):
    with pytest.raises(ScenarioError) as raised:
        paper(faulty_links({key: {"velocty": 0.1, "effort": 1}}))
    first, second = str(raised.value).splitlines()
    assert f"faults.links[0].{key}.velocty: unknown key; did you mean 'velocity'?" in first
    assert f"faults.links[0].{key}.effort: unknown key" in second


def test_the_faults_of_some_robots_are_those_on_their_in_links():
    scenario = paper(faulty_links({"from": 1, "loss": 0.5}))
    assert scenario.links_into(np.array([2, 3])).sink.tolist() == [2]
    assert scenario.links_into(np.array([3, 6])).sink.tolist() == []
    assert paper().links_into(np.array([2, 3])) is None


def test_the_default_missing_policy_is_the_algorithms_first():
    assert paper().missing == "hold"
    asked = paper({"algorithm.missing": "drop"})
    assert asked.missing == "drop"


class Installed:
    """An algorithm's entry point, as an installed package has it."""

    name, value = "other", "others:Other"

    def __init__(self, missing):
        self.load = lambda: type("Other", (FirstOrder,), {"MISSING": missing})


@pytest.mark.parametrize("missing", [None, (), ("guess",)])
def test_an_algorithm_without_a_missing_policy_is_refused(monkeypatch, missing):
    monkeypatch.setattr(installed, "_others", lambda: (Installed(missing),))
    with pytest.raises(InputError, match=r"^algorithm\.name: other: MISSING: expected a tuple of"):
        installed.policies_of("other")


def test_an_unknown_missing_policy_is_refused(monkeypatch):
    monkeypatch.setattr(installed, "_others", lambda: (Installed(("drop",)),))
    with pytest.raises(ScenarioError) as error:
        paper({"algorithm.name": "other", "algorithm.missing": "hold"})
    assert str(error.value) == (
        "paper.toml: algorithm.missing: expected one of drop, which other knows, got 'hold'"
    )


BAD = [
    (faulty_links({"los": 0.1}), "faults.links[0].los: unknown key; did you mean 'loss'?"),
    (faulty_links({"fro": 1}), "faults.links[0].fro: unknown key; did you mean 'from'?"),
    (
        faulty_links({"loss": 1.1}),
        "faults.links[0].loss: expected a probability, from 0 to 1, got 1.1",
    ),
    (
        faulty_links({"loss": -0.1}),
        "faults.links[0].loss: expected a probability, from 0 to 1, got -0.1",
    ),
    (
        faulty_links({"loss": float("nan")}),
        "faults.links[0].loss: expected a finite number, got nan",
    ),
    (
        faulty_links({"delay": 1.5}),
        "faults.links[0].delay: expected a whole number of sampling periods, got 1.5",
    ),
    (
        faulty_links({"delay": -1}),
        "faults.links[0].delay: expected greater than or equal to 0, got -1",
    ),
    (
        faulty_links({"delay": 1001}),
        "faults.links[0].delay: expected less than or equal to 1000, got 1001",
    ),
    (
        faulty_links({"delay": {"unifrom": [0, 1]}}),
        "links[0].delay.unifrom: unknown key; did you mean 'uni",
    ),
    (
        faulty_links({"delay": {"uniform": [0, 1.5]}}),
        "links[0].delay.uniform[1]: expected a whole number of",
    ),
    (
        faulty_links({"delay": {"uniform": [3, 1]}}),
        "faults.links[0].delay.uniform: expected [low, high] with low <= high, got [3, 1]",
    ),
    (
        faulty_links({"noise": -1}),
        "faults.links[0].noise: expected greater than or equal to 0, got -1",
    ),
    (
        faulty_links({"noise": {"positon": 1}}),
        "links[0].noise.positon: unknown key; did you mean 'pos",
    ),
    (
        faulty_links({"quantisation": "a"}),
        "faults.links[0].quantisation: expected a valid number, got 'a'",
    ),
    (faulty_links({"outages": [1, 2]}), "faults.links[0].outages[0]: expected a list, got 1"),
    (faulty_links({"outages": [[1]]}), "faults.links[0].outages[0][1]: missing"),
    (
        faulty_links({"outages": [[2, 2]]}),
        "faults.links[0].outages[0]: expected [from, to] in s with from < to, got [2.0, 2.0]",
    ),
    (
        faulty_links({"outages": [[0, 1], [0, 1e-10]]}),
        "faults.links[0].outages[1]: expected whole nanoseconds, but 1e-10 s is no whole number",
    ),
    (
        faulty_links({"outages": [[-1, 2]]}),
        "outages[0][0]: expected greater than or equal to 0, got -1",
    ),
    (faulty_links({"from": 7}), "faults.links[0].from: expected 0 to 6, got 7"),
    (faulty_links({"to": 0}), "faults.links[0].to: expected 1 to 6, got 0"),
    (faulty_links({"from": 1.5}), "faults.links[0].from: expected a whole number, got 1.5"),
    (
        faulty_links({"from": 6}),
        "faults.links[0]: expected a link of the network, but no robot receives from node 6",
    ),
    (
        faulty_links({"loss": 0}, {"from": 2, "to": 3}),
        "faults.links[1]: expected a link of the network, but robot 3 does not receive from "
        "node 2; it receives from 0",
    ),
    (faulty_robots({"outages": [[1, 2]]}), "faults.robots[0].id: missing"),
    (faulty_robots({"id": 0}), "faults.robots[0].id: expected greater than or equal to 1, got 0"),
    (faulty_robots({"id": 7}), "faults.robots[0].id: expected 1 to 6, got 7"),
    (
        faulty_robots({"id": 2}, {"id": 2}),
        "faults.robots[1].id: robot 2 has been given before; give all its outages in "
        "faults.robots[0]",
    ),
    (
        faulty_robots({"id": 2, "outages": [[3, 1]]}),
        "faults.robots[0].outages[0]: expected [from, to] in s",
    ),
    (
        faulty_robots({"id": 2, "loss": 1}),
        "faults.robots[0].loss: unknown key; there are id, outages",
    ),
    ({"faults": {"links": 3}}, "faults.links: expected a list, got 3"),
    ({"faults": {"robts": 3}}, "faults.robts: unknown key; did you mean 'robots'?"),
]


@pytest.mark.parametrize(("faults", "message"), BAD)
def test_bad_faults(faults, message):
    with pytest.raises(ScenarioError) as error:
        paper(faults)
    assert message in str(error.value)
    assert all(line.startswith("paper.toml: ") for line in str(error.value).splitlines())


def test_bad_policy():
    with pytest.raises(
        ScenarioError, match=r"algorithm\.missing: expected 'hold' or 'drop', got 'wa"
    ):
        paper({"algorithm.missing": "wait"})


def test_faults_do_not_hide_a_wrong_network():
    with pytest.raises(ScenarioError, match=r"adjacency\[1\]: expected 6 weights, got 2") as error:
        paper({"network.adjacency.1": [1, 0]}, faulty_links({"from": 6}))
    assert len(str(error.value).splitlines()) == 1


def test_the_schema_knows_every_key_of_faults():
    table = json_schema()["$defs"]["FaultyLink"]["properties"]
    assert set(table) == {
        *("from", "to", "loss", "duplicate", "delay", "outages", "noise", "quantisation")
    }


@pytest.mark.parametrize("value", [-0.1, 1.5, True, "often"])
def test_an_invalid_probability_of_duplication_is_refused(value):
    with pytest.raises(ScenarioError, match=r"faults\.links\[0\]\.duplicate: expected"):
        paper(faulty_links({"duplicate": value}))
