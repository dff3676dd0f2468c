"""Scenarios for the tests: the paper's example, changed in a few places."""

from pathlib import Path

import pytest

from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import parse_scenario

SCENARIOS = Path(__file__).parents[2] / "scenarios"


@pytest.fixture
def paper():
    """Return a function that gives the paper's example with some of its text replaced."""
    text = (SCENARIOS / "paper_first_order.toml").read_text("utf-8")

    def changed(*replacements: tuple[str, str]) -> Experiment:
        new = text
        for old, replacement in replacements:
            assert old in new, f"{old!r} is not in the scenario"
            new = new.replace(old, replacement, 1)
        return parse_scenario(new, "paper", SCENARIOS, "paper.toml")

    return changed


SHORT = ("duration = 30.0", "duration = 1.0")
SECOND_ORDER = (
    'name = "dcea1"            # dcea1 | dcea2 | the name of a plug-in\nalpha = 0.9\nbeta = 1.1',
    'name = "dcea2"\nalpha = 1.1\nbeta = 0.9',
)
