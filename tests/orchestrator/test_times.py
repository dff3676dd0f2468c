"""Sampling times that are not periodic: exact to the ns, and drawn alike by whoever asks."""

import json
from contextlib import ExitStack
from itertools import accumulate
from zipfile import ZipFile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nrs_cosim.bus.clock import BLOCK, Clock, Jitter
from nrs_cosim.orchestrator.analysis.bounds import ultimate_bounds
from nrs_cosim.orchestrator.analysis.check_warnings import warnings_of
from nrs_cosim.orchestrator.analysis.comparison import compare_to_theory
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.engine.plants import group_by_archive, open_fleet
from nrs_cosim.orchestrator.engine.run import past_of, run
from nrs_cosim.orchestrator.engine.summary import describe, experiment_of, measure
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.recordings.export.tables import samples, states
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import SteadyState
from nrs_cosim.recordings.report.page import page_data
from nrs_cosim.recordings.report.text import lead
from tests.orchestrator.run_oracle import along
from tests.orchestrator.test_run import rows_of
from tests.scenarios import SECOND_ORDER, SHORT, paper

quick = settings(max_examples=60, deadline=None, derandomize=True, database=None)
JITTER = {"run.sampling_jitter": 0.35}


def listed(times, **run):
    """Return changes of the paper's example to a list of sampling times."""
    return {"run": {"sampling_times": times, "seed": 1, **run}}


clocks = st.builds(
    lambda gaps, parts, early: Clock(
        tuple(accumulate(gap + parts for gap in gaps)),
        parts,
        300,
        Jitter(3, min(early, gaps[0])) if len(gaps) == 1 and early and gaps[0] else None,
    ),
    st.lists(st.integers(0, 50), min_size=1, max_size=5),
    st.integers(1, 4),
    st.integers(0, 40),
)


@quick
@given(clocks, st.integers(0, 3000))
def test_a_clock_finds_the_tick_of_any_time(clock, time):
    gaps = np.diff([0, *clock.times])
    nominal = np.cumsum([0, *np.resize(gaps, 900)])
    early = [clock.jitter.at(k) if clock.jitter else 0 for k in range(901)]
    times = [int(t) - e for t, e in zip(nominal, early, strict=True)]
    assert [clock.t(k) for k in range(901)] == times
    spans = np.diff(times)
    assert clock.parts <= clock.shortest <= spans.min()
    assert spans.max() <= clock.longest
    known = [k for k in range(901) if times[k] >= time]
    assert not known or clock.since(time) == known[0]


@quick
@given(clocks, st.integers(1, 200))
def test_outputs_are_equal_parts_to_the_ns_and_end_at_t_k(clock, k):
    outputs = [clock.t(k - 1), *clock.outputs(k)]
    assert len(outputs) == clock.parts + 1
    assert outputs[-1] == clock.t(k)
    assert np.ptp(np.diff(outputs)) <= 1
    assert np.diff(outputs).min() > 0


def test_jitter_is_drawn_for_each_sampling_time_alone():
    clock = paper(JITTER).clock
    early = np.array([100_000_000 * k - clock.t(k) for k in range(1, 4 * BLOCK)])
    assert 0 <= early.min() < 1e6
    assert 34e6 < early.max() <= 35_000_000
    assert abs(early.mean() - 17.5e6) < 4 * 35e6 / np.sqrt(12 * len(early))
    assert abs(np.corrcoef(early[1:], early[:-1])[0, 1]) < 4 / np.sqrt(len(early))
    backwards = [100_000_000 * k - clock.t(k) for k in range(4 * BLOCK - 1, 0, -1)]
    assert early.tolist() == backwards[::-1]
    longer = paper(JITTER, {"run.duration": 300.0}).clock
    assert early.tolist() == [100_000_000 * k - longer.t(k) for k in range(1, 4 * BLOCK)]
    other = paper(JITTER, {"run.seed": 2}).clock
    assert early[7] != 800_000_000 - other.t(8)


def test_a_jitter_of_0_is_periodic_sampling():
    periodic = paper().clock
    assert paper({"run.sampling_jitter": 0}).clock == periodic
    assert paper(listed([0.1], duration=30, output_step=0.02)).clock == periodic


BAD = {
    "both": (
        {"run.sampling_times": [0.1]},
        "run.sampling_times: give these or run.sampling_period, not both",
    ),
    "neither": (
        {"run.sampling_period": None},
        "run.sampling_period: missing; give it, or run.sampling_times",
    ),
    "no times": (listed([]), "run.sampling_times: expected at least one, got []"),
    "no duration": ({"run.duration": None}, "run.duration: missing, it has no default"),
    "jittered list": (
        listed([0.1], sampling_jitter=0.1),
        "run.sampling_jitter: expected none beside run.sampling_times, got 0.1",
    ),
    "times that fall": (
        listed([0.1, 0.3, 0.2]),
        "run.sampling_times[2]: expected times that increase, got 0.2 after 0.3",
    ),
    "the same time": (listed([0.1, 0.1]), "run.sampling_times[1]: expected times that increase"),
    "time zero": (listed([0, 0.1]), "run.sampling_times[0]: expected greater than 0, got 0"),
    "between nanoseconds": (
        listed([0.1, 0.25000000001]),
        "run.sampling_times[1]: expected a whole number of nanoseconds, but 0.25000000001 s is",
    ),
    "beyond the duration": (
        listed([0.1, 0.4], duration=0.3),
        "run.duration: expected the last of run.sampling_times, 0.4 s, or a multiple of it, for "
        "the list is repeated, such as 0.4; got 0.3 s",
    ),
    "no whole turns": (listed([0.1, 0.4], duration=1.0), "such as 0.8 or 1.2; got 1.0 s"),
    "nearest periods": (
        {"run.duration": 25.0, "run.sampling_period": 0.15},
        "periods of 0.15 s, such as 24.9 or 25.05, got 25.0 s",
    ),
    "shorter than a period": (
        {"run.duration": 0.05},
        "of 0.1 s, such as 0.1, got 0.05 s",
    ),
    "60 Hz": (
        {"run.sampling_period": 0.016666666666666666},
        "no whole number of nanoseconds; the nearest is 0.016666667 s",
    ),
    "a third": (
        {"run.sampling_period": 0.3333333333333333},
        "no whole number of nanoseconds; the nearest is 0.333333333 s",
    ),
    "neither period nor duration": (
        {"run.duration": None, "run.sampling_period": None},
        "paper.toml: run.duration: missing, it has no default\n"
        "paper.toml: run.sampling_period: missing; give it, or run.sampling_times",
    ),
    "more parts than ns": (
        listed([1e-9, 1.0], output_step=0.25),
        "run.output_step: expected 1 parts of each interval at most, which is as many as the "
        "shortest has ns, got 0.25 s, which makes 4",
    ),
    "jitter of a whole period": (
        {"run.sampling_jitter": 1.0},
        "run.sampling_jitter: expected less than 1, got 1.0",
    ),
    "jitter that leaves no room": (
        {"run.sampling_jitter": 0.99999999},
        "run.sampling_jitter: expected a part that leaves every interval 5 ns at least, one for "
        "each output step, got 0.99999999",
    ),
    "text": (listed(["0.1"]), "run.sampling_times[0]: expected a valid number, got '0.1'"),
    "one time": (listed(0.1), "run.sampling_times: expected a list, got 0.1"),
}


@pytest.mark.parametrize(("change", "message"), BAD.values(), ids=BAD.keys())
def test_wrong_sampling_times_name_field_and_value(change, message):
    with pytest.raises(ScenarioError) as error:
        paper(change)
    assert message in str(error.value)


TIMES = [0.07, 0.1, 0.25, 0.333333333, 0.4]


START = "reference_position", "reference_velocity", "position", "velocity"


@pytest.mark.parametrize("order", [1, 2], ids=["first", "second"])
def test_listed_sampling_times_are_exact_and_agree_with_dop853(tmp_path, order):
    times = listed(TIMES, duration=2.0, output_step=0.05)
    outcome = run(paper(times, SECOND_ORDER if order == 2 else {}), tmp_path / "run.mcap")
    assert (outcome.status, outcome.ticks) == ("completed", 25)
    turns = [turn * 400_000_000 for turn in range(5)]
    exact = [turn + t for turn in turns for t in (70e6, 100e6, 250e6, 333_333_333, 400e6)]
    with Reader(outcome.path) as reader:
        recorded, sampled = rows_of(states(reader), 6), rows_of(samples(reader), 7)
    assert sampled["time_ns"][:, 0].tolist() == exact
    at_t_k = recorded[::3]
    assert at_t_k["time_ns"][:, 0].tolist() == [0, *exact]
    alpha, beta = (0.9, 1.1) if order == 1 else (1.1, 0.9)
    start = [at_t_k[0][name] for name in START]
    times = np.array([0, *exact]) / 1e9
    q, estimates = along(order, alpha, beta, times, *start)
    assert np.abs(at_t_k["position"] - q).max() < 1e-7
    for name, ours in (("position", 0), ("velocity", 1)):
        scale = np.abs(estimates[1:, ours]).max()
        np.testing.assert_allclose(sampled[name][:, 1:], estimates[1:, ours], atol=1e-12 * scale)


def test_listed_sampling_times_without_duration_are_run_once(tmp_path):
    outcome = run(paper(listed(TIMES)), tmp_path / "run.mcap")
    assert (outcome.status, outcome.ticks) == ("completed", 5)


def test_a_report_draws_values_at_their_sampling_times(tmp_path):
    path = run(paper(listed(TIMES, duration=0.8, output_step=0.05)), tmp_path / "run.mcap").path
    with Reader(path) as reader:
        drawn, recorded = story_of(reader), rows_of(states(reader), 6)
        sampled, duration = (
            rows_of(samples(reader), 7),
            describe(reader, experiment_of(reader))["duration"],
        )
    assert duration == drawn.seconds == 0.8
    assert drawn.t_k.tolist() == sampled["t"][:, 0].tolist()
    assert drawn.t.tolist() == recorded["t"][:, 0].tolist()
    assert drawn.vectors["position"].tolist() == recorded["position"].tolist()
    ours = np.abs(sampled["position"][:, 1:] - sampled["position"][:, :1]).max(axis=(1, 2))
    np.testing.assert_allclose(drawn.envelopes["position_estimate"].largest, ours, rtol=1e-12)
    assert "samples 0.03 to 0.15 s after one another and" in " ".join(lead(drawn))


def test_a_page_without_a_spectral_radius_has_null(tmp_path):
    with Reader(run(paper(JITTER, SECOND_ORDER, SHORT), tmp_path / "run.mcap").path) as reader:
        (page,) = page_data([story_of(reader)])["runs"]
    assert page["spectral_radius"] is None
    assert "samples every 0.1 s, each up to 0.035 s early, drawn from the seed, and" in " ".join(
        page["lead"]
    )
    json.dumps(page, allow_nan=False)


def test_runs_with_jitter_or_listed_times_are_within_their_bounds(tmp_path):
    """Of both algorithms, and of a list: what is measured is within what is proven."""
    for name, changes in {
        "first": (JITTER, {"run.duration": 12.0}),
        "second": (JITTER, SECOND_ORDER, {"run.duration": 12.0}),
        "list": (listed(TIMES, duration=12.0), SECOND_ORDER),
    }.items():
        file = paper(*changes)
        with Reader(run(file, tmp_path / f"{name}.mcap").path) as reader:
            compared = compare_to_theory(reader, file, measure(reader, experiment_of(reader)))
        assert compared.why_not == ""
        assert [row.against_bound for row in compared.quantities] == ["within"] * 4
        assert compared.measured_radius is None
        for row in compared.quantities:
            assert (row.bound.steady_state, row.bound.paper) == (None, None)
            assert 0.1 * row.bound.worst_case < row.measured or row.bound.name.startswith("|q")


def test_with_listed_times_an_excess_is_reported_with_its_tick(tmp_path):
    file = paper(listed(TIMES, duration=4.0))
    with Reader(run(file, tmp_path / "run.mcap").path) as reader:
        broken = SteadyState(1e3, 0.0, 0.0, 0.0, (3_700_000_001, 0, 0, 0))
        compared = compare_to_theory(reader, file, broken)
    assert compared.quantities[0].against_bound == "exceeds"
    assert compared.quantities[0].tick == 5 * 9 + 2


def test_jitter_adds_fields_to_the_theory_as_json():
    periodic, jittered = (check(paper(*more)).as_json() for more in ((), (JITTER,)))
    assert jittered.keys() - periodic.keys() == {"aperiodic"}
    assert periodic.keys() <= jittered.keys()
    more = jittered["aperiodic"]
    assert (more["shortest"], more["longest"]) == (pytest.approx(0.065), pytest.approx(0.135))
    assert more["status"] == "proven"
    assert more["lower"] == more["upper"] == jittered["spectral_radius"]
    assert jittered["rate"] == pytest.approx(periodic["rate"])


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ({"run.sampling_period": 0.5}, "the estimates diverge: their error"),
        (listed([0.5], duration=30.0), "the estimates diverge: their error"),
        (
            {"run.sampling_period": 0.5, "run.sampling_jitter": 0.2},
            "some jitter lets the estimates diverge",
        ),
    ],
)
def test_divergence_with_jitter_or_listed_times_is_warned_of(times, words):
    scenario = paper(SECOND_ORDER, {"run.output_step": None}, times)
    assert words in warnings_of(check(scenario))[-1]
    assert "diverge" in ultimate_bounds(scenario).why_not


def test_with_jitter_a_fixed_step_fmu_is_refused_by_name(tmp_path):
    old = build("two_link_arm", 3)
    with ZipFile(old) as archive, ZipFile(tmp_path / "even.fmu", "w") as new:
        for name in archive.namelist():
            data = archive.read(name).replace(b'canHandleVariableCommunicationStepSize="true"', b"")
            new.writestr(name, data)
    plant = {"fmu": str(tmp_path / "even.fmu"), "control": "hold"}
    scenario = paper(JITTER, {"plant": plant})
    with ExitStack() as stack, pytest.raises(FmuError, match="canHandleVariableCommunicationStep"):
        open_fleet(stack, group_by_archive(scenario), scenario.bodies())


def test_a_run_with_jitter_is_resumed_to_the_same_digest(tmp_path):
    file = paper(
        JITTER,
        {"run.duration": 3.0, "run.checkpoint_every": 10},
    )
    whole = run(file, tmp_path / "whole.mcap").path
    with Reader(whole) as reader:
        some = [tick for k, tick in enumerate(past_of(reader)) if k <= 17]
        digest = reader.digest
    with Reader(run(file, tmp_path / "again.mcap", past=iter(some)).path) as reader:
        assert (reader.digest, reader.ticks) == (digest, 30)
