"""Conditions between the values of a point, as a text and as a function."""

import json

import pytest

import nrs_cosim as nrs
from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.study.axes import axis_of, grid_points
from nrs_cosim.orchestrator.study.where import where_of
from tests.command import nrs as command
from tests.scenarios import PAPER_FILE, write

AXES = ["algorithm.alpha=0.5:1.5:5", "algorithm.beta=0.5:1.5:5", "run.seed=1,2,3",
        "algorithm.name=dcea1,dcea2", "network.pinning=[1,0],[0,1]"]  # fmt: skip
POINTS = list(grid_points([axis_of("", text) for text in AXES]))
KEYS = list(POINTS[0])


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("algorithm.alpha <= algorithm.beta", lambda a, b, *_: a <= b),
        ("algorithm.alpha<1 or run.seed==2", lambda a, _b, s, *_: a < 1 or s == 2),
        ("0.6 < algorithm.alpha < 1.3", lambda a, *_: 0.6 < a < 1.3),
        ("algorithm.alpha-0.5 > 2*-algorithm.beta/4", lambda a, b, *_: a - 0.5 > -b / 2),
        ("not (algorithm.alpha + algorithm.beta >= 2e0)", lambda a, b, *_: a + b < 2),
        ("algorithm.name != 'dcea2' and run.seed in [1, 3]",
         lambda _a, _b, s, name, _p: name == "dcea1" and s != 2),
        ('algorithm.name == "algorithm.alpha" or true', lambda *_: True),
        ("network.pinning == [1, 0]", lambda *values: values[4] == [1, 0]),
    ],
)  # fmt: skip
def test_a_condition_holds_where_the_same_function_does(text, same):
    where = where_of("--where", text, KEYS)
    assert [where(point) for point in POINTS] == [same(*point.values()) for point in POINTS]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("algorithm.alpa < 1", "algorithm.alpa: is on no axis; did you mean 'algorithm.alpha'?"),
        ("x.__class__", "x.__class__: is on no axis"),
        ("algorithm.alpha(1)", "expected a condition such as"),
        ("algorithm.alpha <", "expected a condition such as"),
        ("algorithm.alpha ** 9 < 1", "expected a condition such as"),
        ("(" * 9999, "expected a condition such as"),
        ("", "expected a condition such as"),
    ],
)
def test_what_is_no_condition_is_told(text, said):
    with pytest.raises(InputError, match=r"^--where: ") as error:
        where_of("--where", text, KEYS)
    assert said in str(error.value)


def test_a_condition_that_says_nothing_at_a_point_names_its_values():
    where = where_of("--where", "algorithm.name < 1", KEYS)
    with pytest.raises(InputError, match=r"says nothing at algorithm\.name = dcea1"):
        where(POINTS[0])


def test_the_command_and_python_run_the_points_at_which_it_holds(tmp_path):
    write(tmp_path / "s.toml", {"run.duration": 0.5})
    text = "algorithm.alpha <= algorithm.beta"
    arguments = (
        "sweep", tmp_path / "s.toml", "-o", tmp_path / "study", "--jobs", "0",
        "--over", "algorithm.alpha=0.8,0.9", "--over", "algorithm.beta=0.8,0.9",
    )  # fmt: skip
    done = command(*arguments, "--where", text)
    assert done.returncode == 0, done.stderr
    study = nrs.Study(tmp_path / "study")
    points = [json.loads(row.point).values() for row in study.rows]
    assert sorted(map(tuple, points)) == [(0.8, 0.8), (0.8, 0.9), (0.9, 0.9)]
    short = nrs.Scenario.load(PAPER_FILE).replace({"run.duration": 0.5})
    axes = {"algorithm.alpha": [0.8, 0.9], "algorithm.beta": [0.8, 0.9]}
    for where in (text, lambda point: point["algorithm.alpha"] <= point["algorithm.beta"]):
        assert {row.digest for row in nrs.sweep(short, axes, jobs=0, where=where).rows} == {
            row.digest for row in study.rows
        }
    assert "none is left" in command(*arguments, "--where", "algorithm.alpha > 1").stderr
