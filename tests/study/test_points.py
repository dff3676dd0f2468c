"""A point of a study: its scenario, what follows its sampling period, and its key."""

from decimal import Decimal

import pytest

from nrs_cosim.bus.clock import nanoseconds
from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.scenario.file import parse_scenario, tables_of
from nrs_cosim.orchestrator.study.points import PointReader
from tests.scenarios import paper, toml

BASES = {"paper": paper()}


def run_table(**values):
    """Return the table `run` of a point."""
    point = PointReader(BASES).at({key.replace("__", "."): value for key, value in values.items()})
    return tables_of(point.experiment.text)["run"]


def test_a_point_is_the_scenario_with_other_values():
    point = PointReader(BASES).at({"algorithm.alpha": 0.8, "run.seed": 4})
    assert tables_of(point.experiment.text) == tables_of(
        toml({"algorithm.alpha": 0.8, "run.seed": 4})
    )
    assert (point.values, point.experiment.seed, point.experiment.clock.ticks) == (
        {"algorithm.alpha": 0.8},
        4,
        300,
    )


@pytest.mark.parametrize(
    "period", [0.05, 0.07, 0.1, 0.03, 0.001, 0.333333333, 0.0123, 1.0, 29.0, 0.019, 0.0200001]
)
def test_duration_and_output_step_follow_the_sampling_period(period):
    run = run_table(run__sampling_period=period)
    h, step = nanoseconds(period), nanoseconds(run["output_step"])
    ticks = Decimal(repr(run["duration"])) / Decimal(repr(period))
    assert ticks == ticks.to_integral_value()
    assert abs(run["duration"] - 30.0) <= period / 2 + 1e-9
    assert h % step == 0
    fits = [h // n for n in range(1, 65 + h // 20_000_000) if h % n == 0 and h // n <= 20_000_000]
    assert step == (max(fits) if fits else h)
    point = PointReader(BASES).at({"run.sampling_period": period})
    assert parse_scenario(point.experiment.text, "a", BASES["paper"].folder, "a").clock.period == h


def test_what_is_given_does_not_follow():
    run = run_table(run__sampling_period=0.05, run__duration=1.0, run__output_step=0.05)
    assert (run["duration"], run["output_step"]) == (1.0, 0.05)


def test_the_key_depends_on_what_is_run_and_not_on_the_axes():
    there = PointReader(BASES).at({})
    same = PointReader(BASES).at({"algorithm.alpha": 0.9, "run.seed": 1})
    assert same.key == there.key
    reformatted = {"paper": paper({"run.duration": 30})}
    assert PointReader(reformatted).at({}).key == there.key
    keys = [
        PointReader(BASES).at({key: value}).key
        for key, value in [
            ("algorithm.alpha", 0.8), ("run.seed", 2), ("controller.kp", 100.0),
            ("algorithm.name", "dcea2"), ("run.divergence_limit", 10.0),
        ]
    ]  # fmt: skip
    assert len({there.key, *keys}) == 6


def test_a_point_that_is_no_scenario_is_told_with_its_values():
    with pytest.raises(InputError, match=r"algorithm\.alpha = -1: algorithm\.alpha: expected"):
        PointReader(BASES).at({"algorithm.alpha": -1})
    with pytest.raises(InputError, match="unknown key; did you mean 'alpha'"):
        PointReader(BASES).at({"algorithm.alpa": 1})


def test_an_fmu_of_others_is_in_the_key_by_content(tmp_path):
    fmu = tmp_path / "arm.fmu"
    fmu.write_bytes(b"one")
    bases = {"own": paper({"plant.fmu": "arm.fmu"}, folder=tmp_path)}
    first = PointReader(bases).at({})
    fmu.write_bytes(b"another")
    assert PointReader(bases).at({}).key != first.key
    fmu.unlink()
    with pytest.raises(InputError, match="no such FMU"):
        PointReader(bases).at({})
