"""A target may be sampled: its file is read once, and its samples then go with the text."""

import json
import os
import subprocess
import sys
from itertools import islice

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.analysis.bounds import bounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.comparison import compare_to_theory
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.engine.run import past_of, run
from nrs_cosim.orchestrator.engine.summary import experiment_of, measure
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.orchestrator.scenario.changes import Change
from nrs_cosim.orchestrator.scenario.file import changed, parse_scenario, read_scenario
from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema
from nrs_cosim.recordings.input_tables import file_columns
from nrs_cosim.recordings.mcap.reader import Reader
from tests.estimator_agents.test_cpu_features import there
from tests.orchestrator.run_oracle import target
from tests.scenarios import PAPER_FILE, paper, toml, write

TIMES = np.arange(0, 30.04, 0.05)
SAMPLES = np.array([np.concatenate(target(t)) for t in TIMES])
NAMES = ["position_1", "position_2", "velocity_1", "velocity_2"]
FROM_FILE = {"kind": "sampled", "file": "track.csv"}


def sampled(times, positions):
    return {"kind": "sampled", "times": times, "positions": positions}


def csv_of(columns: dict) -> str:
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def table(times=TIMES, names=NAMES, samples=SAMPLES) -> dict:
    return {"t": times.tolist()} | {name: samples[:, i].tolist() for i, name in enumerate(names)}


def read(folder, target=FROM_FILE, columns=None):
    """Write the paper's example with another target, and perhaps its file, and read them."""
    if columns is not None:
        (folder / "track.csv").write_text(csv_of(columns), "utf-8")
    return read_scenario(write(folder / "sampled.toml", {"target": target}))


@pytest.mark.parametrize(
    "form",
    [
        "[target]\nkind = 'sampled'  # measured\nfile = 'track.csv'\n",
        "[target]\nfile = 'track.csv'\nkind = 'sampled'",
        "target = {kind = 'sampled', file = 'track.csv'}",
        "target.kind = 'sampled'\ntarget.file = 'track.csv'",
    ],
)
def test_the_samples_of_a_file_travel_beside_the_unchanged_text(tmp_path, form):
    rest = toml({"target": None})
    text = f"{rest}\n{form}" if form[0] == "[" else f"{form}\n{rest}"
    (tmp_path / "track.csv").write_text(csv_of(table()), "utf-8")
    (tmp_path / "sampled.toml").write_text(text, "utf-8")
    file = read_scenario(tmp_path / "sampled.toml")
    (tmp_path / "track.csv").unlink()
    again = parse_scenario(file.text, "again", tmp_path / "elsewhere", "again", file.assets)
    assert again.scenario == file.scenario
    assert again.scenario.target.times == tuple(TIMES)
    np.testing.assert_array_equal(again.scenario.target.positions, SAMPLES[:, :2])
    assert file.text == again.text == text
    assert file.assets.keys() == {"target.file"}


def test_parquet_is_read_as_csv_is(tmp_path):
    pyarrow.parquet.write_table(pyarrow.table(table()), tmp_path / "track.parquet")
    other = read(tmp_path, columns=table())
    assert read(tmp_path, FROM_FILE | {"file": "track.parquet"}).scenario == other.scenario


def test_blank_lines_are_ignored(tmp_path):
    expected = read(tmp_path, columns=table()).scenario
    lines = csv_of(table()).splitlines()
    (tmp_path / "track.csv").write_text("\n  \t\n\n".join(lines) + "\n  \t\n\n", "utf-8")
    assert read(tmp_path).scenario == expected


def test_parquet_needs_pyarrow(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    (tmp_path / "track.parquet").write_bytes(b"PAR1")
    with pytest.raises(
        ScenarioError, match=r"target.file: .*\.parquet file needs pyarrow, which is not"
    ):
        read(tmp_path, FROM_FILE | {"file": "track.parquet"})


def test_a_scenario_without_a_target_file_is_unchanged():
    assert read_scenario(PAPER_FILE).text == PAPER_FILE.read_text("utf-8")


BAD_FILES = {
    "no file": (None, "track.csv: no such file"),
    "no header": ("", "got none, without t"),
    "no time": ("time,position_1\n0,1\n", "got time, position_1, without t"),
    "gap": ("t,position_1,position_3\n0,1,2\n", "got 2, without position_2"),
    "few velocities": ("t,position_1,position_2,velocity_1\n0,1,2,3\n", "without velocity_2"),
    "many velocities": ("t,position_1,velocity_1,velocity_2\n0,1,2,3\n", "got 2"),
    "text": ("t,position_1\n0,1\n1,x\n", "line 3: position_1: expected a number, got 'x'"),
    "short row": ("t,position_1\n0,1\n1\n", "line 3: expected 2 values, as in the header, got 1"),
    "semicolons": ("t;position_1\n0;1,5\n", "separated by commas in its first line, and a point"),
    "underscore": (
        "t,position_1\n0,1_0\n1,1\n",
        "line 2: position_1: expected a number, got '1_0'",
    ),
    "another script": (
        "t,position_1\n0,١\n1,1\n",
        "line 2: position_1: expected a number, got '١'",
    ),
    "a word": (
        "t,position_1\n0,1\n1,infinity\n",
        "line 3: position_1: expected a number, got 'inf",
    ),
    "infinite": (
        "t,position_1\n0,1\n1,1e999\n",
        "position_1 of sample 1: expected a finite number",
    ),
    "twice": ("t,t,position_1\n0,0,1\n", "expected columns of different names"),
    "no text": (b"\xff\xfe", "it is no text in UTF-8"),
    "wrong velocity": (
        "t,position_1,velocity_1\n0,0,1\n20,20,1\n40,40,2\n",
        "velocity_1 of sample 2: expected 1 as the positions have it, within 0.1, got 2",
    ),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_an_error_in_the_target_file_names_field_and_fault(tmp_path, case):
    content, message = BAD_FILES[case]
    if content is not None:
        raw = content if isinstance(content, bytes) else content.encode()
        (tmp_path / "track.csv").write_bytes(raw)
    with pytest.raises(ScenarioError) as error:
        read(tmp_path)
    assert "sampled.toml: target.file: " in str(error.value)
    assert message in str(error.value)


def test_a_file_that_is_no_table_is_refused():
    with pytest.raises(InputError, match=r"track.mat: expected a file named .csv or .parquet"):
        file_columns(b"", "track.mat")
    with pytest.raises(InputError, match=r"track\.parquet: no table of numbers"):
        file_columns(b"PAR1", "track.parquet")


def test_the_velocity_columns_do_not_change_the_target(tmp_path):
    with_them = read(tmp_path, columns=table()).scenario
    assert with_them == read(tmp_path, columns=table(names=NAMES[:2])).scenario
    transient = np.tile([0.1, 0.7, 0.0, 0.0], (len(TIMES), 1))
    assert read(tmp_path, columns=table(samples=transient)).scenario.m == 2


def test_a_target_file_beside_times_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match=r"target.file: got 'track.csv' and target.times too"):
        read(tmp_path, FROM_FILE | {"times": [0, 1]}, columns=table())


BAD_TABLES = {
    "kind": (
        {"kind": "spline"},
        "target.kind: expected 'harmonic', 'sampled' or 'fmu', got 'spline'",
    ),
    "key of the other kind": (
        {"kind": "sampled", "axes": []},
        "target.axes: unknown key; there are kind, file, times, positions",
    ),
    "misspelt": (
        {"kind": "sampled", "time": []},
        "target.time: unknown key; did you mean 'times'?",
    ),
    "nothing": ({"kind": "sampled"}, "target.times: expected two times at least, got 0; give"),
    "unread file": ({"kind": "sampled", "file": "a.csv"}, "target.file: 'a.csv' is read where"),
    "rows": (sampled([0, 40], [[1]]), "target.positions: expected 2 rows"),
    "row": (
        sampled([0, 40], [[1, 2], [1]]),
        "target.positions[1]: expected 2 numbers, as in the first row, got 1",
    ),
    "no axes": (sampled([0, 40], [[], []]), "target.positions[0]: expected"),
    "equal times": (
        sampled([0, 1, 1.0, 40], [[1], [1], [1], [1]]),
        "target.times[2]: expected times that increase, got 1.0 after 1.0",
    ),
    "no number": (sampled([0, float("nan")], [[1], [2]]), "target.times[1]: expected a finite"),
    "late": (
        sampled([0.5, 40], [[1], [2]]),
        "target.times: expected times that cover 0 to 30.0 s, the end of the run, got 0.5 to 40.0",
    ),
    "early": (
        sampled([0, 29], [[1], [2]]),
        "target.times: expected times that cover 0 to 30.0 s",
    ),
    "beyond floats": (
        sampled([0, 1e-9, 40], [[-1e308], [1e308], [0]]),
        "target.positions: expected a motion of finite velocity",
    ),
    "too near": (
        sampled([0, 5e-324, 1e-323, 40], [[1], [2], [3], [4]]),
        "target.positions: expected a motion of finite velocity",
    ),
    "axes of others": (
        sampled([0, 40], [[1, 2, 3], [1, 2, 3]]),
        "disturbance.axes: expected 3 axes, one for each of the target's axes, got 2",
    ),
}


@pytest.mark.parametrize("case", BAD_TABLES)
def test_an_error_in_the_target_table_names_field_and_value(case):
    given, message = BAD_TABLES[case]
    with pytest.raises(ScenarioError) as error:
        paper({"target": given})
    assert f"paper.toml: {message}" in str(error.value)


def test_the_schema_has_both_kinds_of_target():
    kinds = json.loads(json.dumps(json_schema()))["$defs"]
    assert kinds["SampledTarget"]["properties"].keys() == {"kind", "file", "times", "positions"}
    assert kinds["HarmonicTarget"]["properties"].keys() == {"kind", "axes"}


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The paper's run, and the same with its target sampled densely: recordings."""
    folder = tmp_path_factory.mktemp("targets")
    run(read_scenario(PAPER_FILE), folder / "harmonic.mcap")
    run(read(folder, columns=table()), folder / "sampled.mcap")
    with Reader(folder / "harmonic.mcap") as one, Reader(folder / "sampled.mcap") as other:
        yield one, other


def test_the_papers_run_keeps_its_digest(ran):
    digest = "5433c6582a5a773a978b6f1bbacdc338b082e3b0b35e249b5bce1c8ffc897337"
    assert ran[0].digest == digest


def test_a_processor_with_fewer_instructions_comes_to_the_same_digest(ran, tmp_path):
    fewer = {
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
        "NPY_DISABLE_CPU_FEATURES": " ".join(there()),
        "OPENBLAS_CORETYPE": "Prescott",
    }
    command = [sys.executable, "-m", "nrs_cosim.orchestrator", "run", PAPER_FILE]
    path = tmp_path / "fewer.mcap"
    subprocess.run([*command, "-o", path], env=os.environ | fewer, check=True)
    with Reader(path) as reader:
        assert reader.digest == ran[0].digest


def test_a_run_after_samples_is_close_to_that_of_the_formula(ran):
    harmonic, sampled = (measure(reader, experiment_of(reader)) for reader in ran)
    for name in ("position_estimate", "velocity_estimate", "position_tracking"):
        assert getattr(sampled, name) == pytest.approx(getattr(harmonic, name), rel=1e-3)
    one, other = (story_of(reader) for reader in ran)
    np.testing.assert_allclose(other.target["position"], one.target["position"], atol=1e-4)


def test_the_run_can_be_repeated_from_the_recording_alone(ran, tmp_path):
    file = experiment_of(ran[1])
    assert "track.csv" in file.text
    run(file, tmp_path / "again.mcap")
    with Reader(tmp_path / "again.mcap") as again:
        assert again.digest == ran[1].digest


def test_replays_and_resumed_runs_need_no_file(ran, tmp_path):
    file = experiment_of(ran[1])
    verification = verify(ran[1], file, plants=False)
    assert verification.difference is None
    assert verification.ticks == 300
    run(file, tmp_path / "rest.mcap", past=islice(past_of(ran[1]), 201))
    with Reader(tmp_path / "rest.mcap") as transient:
        assert transient.digest == ran[1].digest
    other = changed(file, [Change.of("--algorithm", "algorithm.alpha=0.8")])
    assert other.scenario.target == file.scenario.target


def test_a_sampled_target_has_worst_case_bounds_and_is_within_them(ran):
    file = experiment_of(ran[1])
    result = ultimate_bounds(file)
    harmonic = ultimate_bounds(experiment_of(ran[0]))
    assert result.steady_state is None
    assert result.source == "of the spline through its 601 samples"
    assert result.as_json()["estimates"]["steady_state"] is None
    for row, other in zip(bounds(result), bounds(harmonic), strict=True):
        assert row.steady_state is None
        assert row.worst_case == pytest.approx(other.worst_case, rel=1e-2)
        assert row.paper == pytest.approx(other.paper, rel=1e-2)
    compared = compare_to_theory(ran[1], file, measure(ran[1], experiment_of(ran[1])))
    assert [row.against_bound for row in compared.quantities] == ["within"] * 4
    assert compared.measured_radius is None
    assert (
        compared.spectral_radius
        == compare_to_theory(ran[0], file, measure(ran[0], experiment_of(ran[0]))).spectral_radius
    )
    assert [c.holds for c in check(file).conditions] == [True] * 6


def test_a_measurement_beyond_the_worst_case_bound_is_reported(ran):
    """The same run judged by a target that stood still: what it did was not allowed."""
    still = paper({"target": sampled([0, 40], [[0, 0], [0, 0]])})
    assert still.target.bounds() == (0, 0)
    compared = compare_to_theory(ran[1], still, measure(ran[1], experiment_of(ran[1])))
    assert compared.quantities[0].against_bound == "exceeds"


def test_the_duration_may_end_with_the_last_sample():
    target = sampled([0.0, 0.1, 0.2, 0.3], [[0, 0]] * 4)
    assert paper({"run.duration": 0.3, "target": target}).scenario.m == 2
