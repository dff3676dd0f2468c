"""The paper's example, whole and short, for the tests of the package in Python."""

import pytest

import nrs_cosim as nrs
from tests.scenarios import SCENARIOS


@pytest.fixture(scope="module")
def paper() -> nrs.Scenario:
    return nrs.Scenario.load(SCENARIOS / "paper_first_order.toml")


@pytest.fixture(scope="module")
def short(paper) -> nrs.Scenario:
    return paper.replace({"run.duration": 2.0})
