"""What an axis of a study says, and which values it has."""

import numpy as np
import pytest
from scipy.stats import qmc

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.study.axes import Draw, axis_of, grid_points, seeds_of, with_draw


def values(text):
    """Return the values of an axis of one key."""
    return [value for (value,) in axis_of("--over", text).values]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("algorithm.alpha=0.1:1.3:25", [round(0.1 + 0.05 * i, 10) for i in range(25)]),
        ("run.seed=1:5:5", [1, 2, 3, 4, 5]),
        ("run.seed=1:2:3", [1.0, 1.5, 2.0]),
        ("algorithm.alpha=log:0.01:1:3", [0.01, 0.1, 1.0]),
        ("run.sampling_period=0.05,0.1,0.2", [0.05, 0.1, 0.2]),
        ("algorithm.name=dcea1,dcea2", ["dcea1", "dcea2"]),
        ('plant.fmu="a,b.fmu"', ["a,b.fmu"]),
        ("network.pinning=[1,0],[0,1]", [[1, 0], [0, 1]]),
        ("controller.kp=10", [10]),
        ("algorithm.alpha=-1:1:3", [-1, 0, 1]),
        ("run.sampling_period=log:0.02:0.8:4", [0.02, 0.068399, 0.233921, 0.8]),
    ],
)
def test_an_axis_has_the_values_that_its_text_says(text, expected):
    assert values(text) == expected
    assert [type(value) for value in values(text)] == [type(value) for value in expected]


def test_keys_with_a_semicolon_between_go_together():
    axis = axis_of("--over", "algorithm.alpha=0.8,0.9;algorithm.beta=1.1,1.0")
    assert list(grid_points([axis])) == [
        {"algorithm.alpha": 0.8, "algorithm.beta": 1.1},
        {"algorithm.alpha": 0.9, "algorithm.beta": 1.0},
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("alpha=1", "expected KEY=VALUES"),
        ("algorithm.alpha", "expected KEY=VALUES"),
        ("algorithm.alpha=", "expected values, got none"),
        ("algorithm.alpha=[1", "expected values of TOML"),
        ("algorithm.alpha=log:0:1:3", "above 0"),
        ("algorithm.alpha=0:1:1", "n of 2 or more"),
        ("algorithm.alpha=1,2;algorithm.beta=1", "as many values each"),
        ("algorithm.alpha=1:2;algorithm.beta=1", "stands by itself"),
        ("algorithm.alpha=1;algorithm.alpha=2", "given twice"),
    ],
)
def test_a_wrong_axis_is_told_with_what_is_expected(text, said):
    with pytest.raises(InputError, match=r"^--over") as error:
        axis_of("--over", text)
    assert said in str(error.value)


def test_the_product_has_the_last_axis_the_fastest():
    axes = [axis_of("--over", "algorithm.alpha=1,2"), seeds_of("--seeds", "2")]
    assert [(one["algorithm.alpha"], one["run.seed"]) for one in grid_points(axes)] == [
        (1, 1), (1, 2), (2, 1), (2, 2),
    ]  # fmt: skip


RANGES = ("algorithm.alpha=0.1:1.3", "run.sampling_period=log:0.01:1")


def drawn(text):
    """Return the points that are drawn from both ranges, (N, 2)."""
    axes = with_draw([axis_of("--over", text) for text in RANGES], Draw.of("--draw", text))
    return np.array([list(one.values()) for one in grid_points(axes)])


def test_a_latin_hypercube_has_one_point_in_each_part_of_each_range():
    points = drawn("lhs:16:3")
    unit = np.column_stack([(points[:, 0] - 0.1) / 1.2, np.log10(points[:, 1]) / 2 + 1])
    for column in unit.T:
        assert sorted((column * 16).astype(int)) == list(range(16))
    assert (points == drawn("lhs:16:3")).all()
    assert (points != drawn("lhs:16:4")).any()


def test_a_longer_draw_of_sobol_begins_with_the_shorter_one():
    points = drawn("sobol:64")
    assert (points[:20] == drawn("sobol:20")).all()
    unit = np.column_stack([(points[:, 0] - 0.1) / 1.2, np.log10(points[:, 1]) / 2 + 1])
    assert qmc.discrepancy(unit.clip(0, 1)) < 0.01


def test_ranges_and_draws_need_one_another():
    with pytest.raises(InputError, match=r"algorithm\.alpha: of a range a:b values are drawn"):
        with_draw([axis_of("--over", RANGES[0])], None)
    with pytest.raises(InputError, match="no key has a range"):
        with_draw([axis_of("--over", "algorithm.alpha=1,2")], Draw.of("--draw", "lhs:4"))
    with pytest.raises(InputError, match="is on two axes"):
        with_draw([axis_of("--over", "algorithm.alpha=1,2")] * 2, None)


def test_more_points_than_can_be_run_are_told_before_any_is_counted():
    axes = [axis_of("", f"algorithm.{key}=0:1:10000") for key in ("alpha", "beta")]
    with pytest.raises(InputError, match="at most 10,000,000 points in all, got 100,000,000"):
        with_draw(axes, None)


@pytest.mark.parametrize("text", ["0", "-1", "a", "1,b", ""])
def test_seeds_are_a_number_or_a_list(text):
    with pytest.raises(InputError, match="--seeds: expected a number of seeds"):
        seeds_of("--seeds", text)
    assert [seed for (seed,) in seeds_of("--seeds", "5,1,5").values] == [5, 1]
