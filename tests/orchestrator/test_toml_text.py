"""Tables written as a text in TOML read back as the same tables."""

import tomllib
from datetime import date, datetime, time
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nrs_cosim.orchestrator.scenario.toml_text import toml_text
from tests.scenarios import SCENARIOS

SCALARS = (
    st.text(st.characters(exclude_categories=["Cs"]))
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.booleans()
)
KEYS = st.text(st.characters(exclude_categories=["Cs"]), max_size=5)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=8,
)


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_scenario_reads_back_the_same(path):
    tables = tomllib.loads(path.read_text("utf-8"))
    assert tomllib.loads(toml_text(tables)) == tables


@given(st.dictionaries(KEYS, VALUES, max_size=5))
def test_any_tables_read_back_the_same(tables):
    assert tomllib.loads(toml_text(tables)) == tables


def test_dates_times_and_what_is_no_finite_number_read_back_the_same():
    tables = {"d": date(2026, 1, 2), "t": time(3, 4), "both": datetime(2026, 1, 2, 3, 4), "x": inf}
    assert tomllib.loads(toml_text(tables)) == tables
    assert str(tomllib.loads(toml_text({"x": nan}))["x"]) == "nan"
