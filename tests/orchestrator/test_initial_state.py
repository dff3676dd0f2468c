"""What agents keep beside an estimate starts as the scenario, or else its declaration, says."""

import sys

import numpy as np
import pytest

from nrs_cosim.bus.random_streams import random_stream
from nrs_cosim.orchestrator.errors import ScenarioError
from tests.scenarios import paper

MODULE = """
from dataclasses import dataclass
from typing import ClassVar

import nrs_cosim as nrs
from nrs_cosim.bus.fields import ESTIMATE, Field


@dataclass(frozen=True)
class Keeper(nrs.Algorithm):
    MISSING: ClassVar = ("hold",)
    STATE: ClassVar = {
        **ESTIMATE,
        "integral": Field(doc="of the disagreement"),
        "share": Field((), initial=0.5),
        "covariance": Field((2, "m"), initial=1.0),
    }
    alpha: float = 0.9
    beta: float = 0.9

    def jump(self, estimate, disagreement):
        return estimate
"""


@pytest.fixture
def keeper(tmp_path, monkeypatch):
    """Return the paper's example with an algorithm that keeps more, and a start of it."""
    (tmp_path / "keeper.py").write_text(MODULE, "utf-8")
    about = tmp_path / "keeper-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: keeper\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[nrs.algorithms]\nkeeper = keeper:Keeper\n")
    monkeypatch.syspath_prepend(str(tmp_path))

    def changed(start=None, own=None):
        initial = {f"initial.{name}": value for name, value in (start or {}).items()}
        robots = {"robots": [{"id": 3, "initial": own}]} if own else {}
        return paper({"algorithm": {"name": "keeper"}}, initial, robots)

    yield changed
    sys.modules.pop("keeper", None)


def test_an_initial_agent_state_defaults_to_the_declared_one(keeper):
    state = keeper().initial_state()
    assert [*state] == ["position", "velocity", "integral", "share", "covariance"]
    assert state["integral"].tolist() == [[0.0, 0.0]] * 6
    assert state["share"].tolist() == [0.5] * 6
    assert state["covariance"].tolist() == [[[1.0, 1.0]] * 2] * 6
    estimates = keeper().initial_estimates()
    np.testing.assert_array_equal(state["position"], estimates.position)
    np.testing.assert_array_equal(state["velocity"], estimates.velocity)


@pytest.mark.parametrize(
    ("start", "name", "row"),
    [
        ({"integral": 2}, "integral", [2, 2]),
        ({"integral": [1, 2]}, "integral", [1, 2]),
        ({"share": 2.5}, "share", 2.5),
        ({"covariance": 4}, "covariance", [[4, 4], [4, 4]]),
        ({"covariance": [[1, 2], [3, 4]]}, "covariance", [[1, 2], [3, 4]]),
    ],
)
def test_a_number_or_its_shape_is_that_of_all_robots(keeper, start, name, row):
    assert keeper(start).initial_state()[name].tolist() == [row] * 6
    assert keeper(own=start).initial_state([3])[name].tolist() == [row]


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("integral", np.arange(12.0).reshape(6, 2)),
        ("share", np.arange(6.0)),
        ("covariance", np.arange(24.0).reshape(6, 2, 2)),
    ],
)
def test_rows_are_those_of_each_robot_wherever_it_runs(keeper, name, rows):
    experiment = keeper({name: rows})
    np.testing.assert_array_equal(experiment.initial_state()[name], rows)
    np.testing.assert_array_equal(experiment.initial_state([5, 2])[name], rows[[4, 1]])
    own = keeper({name: rows}, {name: -1}).initial_state()[name]
    np.testing.assert_array_equal(own[2], np.full(rows[2].shape, -1))
    np.testing.assert_array_equal(np.delete(own, 2, 0), np.delete(rows, 2, 0))


def test_a_draw_is_keyed_by_seed_name_and_robot(keeper):
    experiment = keeper({"covariance": {"uniform": [-1, 3]}})
    drawn = experiment.initial_state()["covariance"]
    stream = random_stream(experiment.seed, "initial covariance", 4)
    np.testing.assert_array_equal(drawn[3], -1 + 4 * stream.random((2, 2)))
    np.testing.assert_array_equal(experiment.initial_state([4])["covariance"], drawn[[3]])
    assert len(np.unique(drawn)) == 24


@pytest.mark.parametrize(
    ("start", "own", "fault"),
    [
        ({"integrall": 1}, {}, "initial.integrall: unknown key; did you mean 'integral'?"),
        ({}, {"shares": 1}, "robots[0].initial.shares: unknown key; did you mean 'share'?"),
        (
            {"integral": [1, 2, 3]},
            {},
            "initial.integral: expected 2 numbers, or 6 x 2 numbers, a row "
            "for each robot, got 3 numbers",
        ),
        (
            {"covariance": [[1, 2], [3]]},
            {},
            "initial.covariance: expected 2 x 2 numbers, or 6 x 2 x 2 "
            "numbers, a row for each robot, got lists of several lengths",
        ),
        (
            {"share": [1, 2]},
            {},
            "initial.share: expected a number, or 6 numbers, a row for each robot, got 2 numbers",
        ),
        (
            {},
            {"integral": [[1, 2]]},
            "robots[0].initial.integral: expected 2 numbers, got 1 x 2 numbers",
        ),
        (
            {"integral": {"uniform": [2, 1]}},
            {},
            "initial.integral.uniform: expected [low, high] with low <= high, got [2.0, 1.0]",
        ),
        (
            {"integral": [1, float("nan")]},
            {},
            "initial.integral: expected lists of finite numbers, in one another, got [1, nan]",
        ),
        ({"integral": True}, {}, "initial.integral: expected a valid number, got True"),
        ({"share": "x"}, {}, "initial.share: expected a valid number, got 'x'"),
    ],
)
def test_a_wrong_initial_agent_state_names_key_and_expectation(keeper, start, own, fault):
    with pytest.raises(ScenarioError) as error:
        keeper(start, own)
    assert str(error.value) == f"paper.toml: {fault}"


def test_an_algorithm_that_keeps_no_more_takes_no_more():
    with pytest.raises(ScenarioError) as error:
        paper({"initial.posiiton": 1})
    assert str(error.value) == (
        "paper.toml: initial.posiiton: unknown key; did you mean 'position'?"
    )


def test_a_field_with_the_name_of_a_joint_s_state_is_refused(keeper, tmp_path):
    module = tmp_path / "keeper.py"
    module.write_text(module.read_text("utf-8").replace('"share"', '"qd"'), "utf-8")
    with pytest.raises(ScenarioError, match="STATE: qd is a key of"):
        keeper()
