"""What is compared differs in its algorithm and its period alone, and the page has all of it."""

import tomllib
from pathlib import Path

import pytest

from nrs_cosim.estimator_agents.installed import bundled_algorithms
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.orchestrator.scenario.robot_ids import with_parameters

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "scenarios").glob("compare_*.toml"))
PAGE = (ROOT / "docs" / "paper" / "comparison.md").read_text("utf-8")


def test_all_have_the_same_robots_target_network_and_start():
    tables = [tomllib.loads(path.read_text("utf-8")) for path in FILES]
    for table in tables:
        table["run"].pop("sampling_period")
        table.pop("algorithm")
    assert len(tables) > 5
    assert all(table == tables[0] for table in tables)


def test_the_algorithms_of_the_literature_are_compared_with_the_paper_s():
    names = {read_scenario(path).scenario.algorithm.name for path in FILES}
    others = {"pd_like", "impulsive", "sliding", "pi_consensus", "kalman_consensus"}
    assert {"dcea1", "dcea2"} | others <= names <= {*bundled_algorithms()}


@pytest.mark.parametrize("path", FILES, ids=[path.stem for path in FILES])
def test_the_page_has_a_row_of_each(path):
    experiment = read_scenario(path)
    chosen = experiment.scenario.algorithm
    row = f"| `{with_parameters(chosen.name, chosen.parameters)}` | "
    assert f"\n{row}{experiment.scenario.run.sampling_period:g} | " in PAGE
