"""A study from the command line and from Python: its rows, what it finds again, what it says."""

import hashlib
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import nrs_cosim as nrs
from nrs_cosim.orchestrator.cli.output_paths import locked
from nrs_cosim.orchestrator.cli.terminal_study import show_study, study_summary
from nrs_cosim.orchestrator.study.axes import axis_of, seeds_of, with_draw
from nrs_cosim.orchestrator.study.dispatch import AHEAD
from nrs_cosim.orchestrator.study.engines import local_engine
from nrs_cosim.orchestrator.study.plan import TRIED, StudyPlan, task_of
from nrs_cosim.orchestrator.study.point_run import NeedsFmus, run_point
from nrs_cosim.orchestrator.study.points import PointReader
from nrs_cosim.orchestrator.study.rows import QUANTITIES, STATUSES
from nrs_cosim.orchestrator.study.store import StudyStore
from nrs_cosim.orchestrator.study.study import sweep_into
from nrs_cosim.orchestrator.terminal import out
from tests.command import nrs as command
from tests.plant_fmu.faulty_fmu import FAULTS, built, three_robots
from tests.scenarios import PAPER, PAPER_FILE, example, write

SHORT = nrs.Scenario.load(PAPER_FILE).replace({"run.duration": 1.0})
ALPHAS = {"algorithm.alpha": [0.9, 1.5]}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Return a study of two gains, of which one diverges, and two seeds, in this process."""
    scenario = SHORT.replace({"run.duration": 3.0})
    return nrs.sweep(scenario, ALPHAS, seeds=2, out=tmp_path_factory.mktemp("study"), jobs=0)


def test_a_row_has_what_the_recording_of_its_run_says(study):
    assert {(row.seed, row.status) for row in study.rows} == {
        (1, "converged"), (2, "converged"), (1, "diverged"), (2, "diverged"),
    }  # fmt: skip
    for row in study.rows:
        with nrs.run(study.scenario(row.key)) as recording:
            result = recording.analysis()
        assert row.digest == recording.digest
        assert (row.ticks, row.messages) == (recording.ticks, result["messages"])
        assert row.samples == result["samples"]["count"]
        for name, quantity in zip(QUANTITIES, result["theory"]["quantities"], strict=True):
            assert getattr(row, name) == quantity["measured"]
            found = json.loads(row.bounds)[name]
            assert found == quantity["bounds"] | {"status": quantity["status"]}
        theory = nrs.check(study.scenario(row.key))
        assert row.spectral_radius == theory.spectral_radius
        assert row.convergence == theory.as_json()["convergence"]
        cause = result["cause"] or {"kind": None, "tick": None, "robot": None, "quantity": None}
        assert (row.cause_kind, row.cause_tick) == (cause["kind"], cause["tick"])
        assert (row.cause_robot, row.cause_quantity) == (cause["robot"], cause["quantity"])


def test_the_margin_is_of_the_condition_that_is_nearest_to_its_bound(study):
    for row in study.rows:
        conditions = nrs.check(study.scenario(row.key)).as_json()["conditions"]
        margins = [c["margin"] / c["bound"] for c in conditions if c["bound"]]
        assert row.margin == pytest.approx(min(margins), rel=1e-12)
        assert row.violated == ", ".join(c["name"] for c in conditions if c["status"] == "violated")


def test_the_same_again_runs_nothing_and_more_runs_what_is_new(tmp_path):
    first = nrs.sweep(SHORT, ALPHAS, out=tmp_path, jobs=0)
    started = {row.key: row.started for row in first.rows}
    seen = []
    axes = {"algorithm.alpha": [0.9, 1.5, 0.8], "algorithm.beta": [1.1]}
    more = nrs.sweep(
        SHORT, axes, seeds=2, out=tmp_path, jobs=0,
        progress=lambda now: seen.append((now.done, now.points)),
    )  # fmt: skip
    assert seen == [(0, 6), (2, 6), (4, 6), (5, 6), (6, 6)]
    rows = {row.key: row for row in more.rows}
    assert {key: rows[key].started for key in started} == started
    assert more.keys == ("algorithm.alpha", "algorithm.beta")
    frame = more.to_pandas()
    assert frame[["algorithm.alpha", "algorithm.beta", "seed"]].values.tolist() == [
        [alpha, 1.1, seed] for alpha in (0.8, 0.9, 1.5) for seed in (1, 2)
    ]


def test_another_scenario_in_the_folder_is_refused(tmp_path):
    nrs.sweep(SHORT, ALPHAS, out=tmp_path, jobs=0)
    with pytest.raises(nrs.errors.InputError, match="is a study of another scenario"):
        nrs.sweep(SHORT.replace({"algorithm.beta": 0.5}), ALPHAS, out=tmp_path, jobs=0)


def test_the_dataset_has_the_axes_and_seeds_as_dimensions(study):
    data = study.dataset()
    assert dict(data.sizes) == {"algorithm.alpha": 2, "seed": 2}
    assert (data.status.sel({"algorithm.alpha": 1.5}) == "diverged").all()
    for row in study.rows:
        alpha = json.loads(row.point)["algorithm.alpha"]
        here = data.sel({"algorithm.alpha": alpha, "seed": row.seed})
        assert float(here.position_estimate) == row.position_estimate
        assert str(here.digest.values) == row.digest
    assert np.isnan(data.cause_tick.sel({"algorithm.alpha": 0.9})).all()


def test_of_rows_of_two_versions_the_last_is_in_the_table(tmp_path):
    study = nrs.sweep(SHORT, ALPHAS, out=tmp_path, jobs=0)
    row = study.rows[0]
    with StudyStore(tmp_path) as store:
        store.put(replace(row, key="0" * 64, status="failed", point=" " + row.point))
    assert [len(study.rows), len(study)] == [3, 2]
    assert sorted(study.to_pandas()["status"]) == sorted(["failed", study.rows[1].status])


def test_several_scenarios_are_an_axis(tmp_path):
    other = SHORT.replace({"algorithm.name": "dcea2"}, name="second")
    study = nrs.sweep([SHORT, other], {}, out=tmp_path, jobs=0)
    assert study.keys == ("scenario",)
    names = {row.scenario: study.scenario(row.key)["algorithm.name"] for row in study.rows}
    assert names == {"paper_first_order": "dcea1", "second": "dcea2"}


def test_a_study_that_another_process_writes_is_refused(tmp_path):
    write(tmp_path / "s.toml", {"run.duration": 1.0})
    (tmp_path / "study").mkdir()
    with locked(StudyStore(tmp_path / "study").journal):
        done = command("sweep", tmp_path / "s.toml", "-o", tmp_path / "study", "--jobs", "0")
    assert done.returncode == 2
    assert "is being written by" in done.stderr


def test_keys_that_go_together_are_one_dimension(tmp_path):
    axes = {("run.sampling_period", "run.duration"): [(0.1, 1.0), (0.2, 2.0)]}
    study = nrs.sweep(SHORT, axes, seeds=2, out=tmp_path, jobs=0)
    data = study.dataset()
    assert dict(data.sizes) == {"run.sampling_period": 2, "seed": 2}
    assert data["run.duration"].sel(seed=1).values.tolist() == [1.0, 2.0]
    assert (data.ticks_planned == 10).all()


def test_a_loss_of_links_is_an_axis_and_the_row_has_the_critical_one():
    scenario = SHORT.replace({"algorithm.missing": "drop", "faults.links": [{"loss": 0.0}]})
    study = nrs.sweep(scenario, {"faults.links.0.loss": [0.2, 0.4]}, jobs=0)
    for row in study.rows:
        (link,) = study.scenario(row.key)["faults.links"]
        assert link["loss"] == json.loads(row.point)["faults.links.0.loss"]
        theory = nrs.check(study.scenario(row.key)).as_json()
        assert row.critical_loss == theory["links"]["loss"]["critical"]
        growth = theory["links"]["simulated"]
        assert [row.almost_sure_lower, row.almost_sure] == [growth["lower"], growth["upper"]]
        assert row.spectral_radius == theory["links"]["loss"]["mean_square"]["upper"]
        assert row.convergence == theory["convergence"]


def test_values_that_are_no_scenario_together_are_a_row_that_failed_and_the_others_run(tmp_path):
    axes = {"run.sampling_period": [0.1, 0.3], "run.duration": [0.9, 1.0]}
    study = nrs.sweep(SHORT, axes, out=tmp_path, jobs=0)
    found = {(*json.loads(row.point).values(),): row for row in study.rows}
    assert [found[h, t].status for h in (0.1, 0.3) for t in (0.9, 1.0)] == [
        "converged", "converged", "converged", "failed",
    ]  # fmt: skip
    assert found[0.3, 1.0].cause_kind == "input"
    assert "run.duration" in found[0.3, 1.0].reason
    started = {row.key: row.started for row in study.rows}
    again = nrs.sweep(SHORT, axes, out=tmp_path, jobs=0)
    assert {row.key: row.started for row in again.rows} == started


def test_the_first_run_waits_for_no_point_but_one_of_each_value(tmp_path, monkeypatch):
    read, read_at_first_row = [], []
    at = PointReader.at
    monkeypatch.setattr(PointReader, "at", lambda *args: read.append(args) or at(*args))
    axes = [axis_of("", "algorithm.alpha=0.5:0.9:40"), seeds_of("", "1000")]
    plan = StudyPlan({PAPER: example(PAPER, {"run.duration": 0.1})}, with_draw(axes, None))

    def follow(progress, row):
        assert progress.points == 40_000
        if row:
            read_at_first_row.append(len(read))

    with StudyStore(tmp_path) as store:
        sweep_into(store, plan, local_engine(0), follow, lambda: bool(read_at_first_row))
    assert read_at_first_row[0] <= 40 + TRIED + AHEAD


def test_a_plant_that_fails_is_a_row_with_its_cause_recording_and_line_to_run_it_again(tmp_path):
    """Where the estimates had grown without bound, it is these that are the cause."""
    shutil.copy(built(tmp_path), tmp_path / "faulty.fmu")
    write(tmp_path / "s.toml", base=three_robots(isolate=False, parameters={"fault_time": 0.55}))
    over, folder = f"plant.parameters.fault={FAULTS.index('none')},{FAULTS.index('error')}", "study"
    done = command(
        "sweep", "s.toml", "--over", over, "--over", "algorithm.alpha=0.9,3",
        "-o", folder, "--jobs", "0", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    info = json.loads(command("study", "info", folder, "--json", cwd=tmp_path).stdout)
    expected = ("converged", "not_converged", "failed", "diverged")
    assert info["statuses"] == dict.fromkeys(expected, 1)
    (failure,) = info["failures"]
    assert (failure["status"], failure["cause"]) == ("failed", "plant")
    assert failure["reason"] in " ".join(done.stderr.split())
    (diverged,) = (row for row in nrs.Study(tmp_path / folder).rows if row.status == "diverged")
    assert (diverged.cause_kind, diverged.cause_robot) == ("diverged", 1)
    radius, grown = diverged.reason.split(": the estimates' errors had grown to ")
    assert radius == "the estimates diverge (spectral radius 2 over the links)"
    assert grown.endswith(f"at each sampling time, and a plant gave up: {failure['reason']}")
    again = command(*failure["command"].split()[1:], "-o", "again.mcap", cwd=tmp_path)
    assert again.returncode == 1
    digests = [
        json.loads(command("info", path, "--json", cwd=tmp_path).stdout)["digest"]
        for path in ("again.mcap", f"{folder}/{failure['recording']}")
    ]
    assert digests[0] == digests[1]


def test_a_command_runs_a_study_and_tells_it_in_lines_of_json(tmp_path):
    write(tmp_path / "s.toml", {"run.duration": 1.0})
    arguments = (
        "sweep", tmp_path / "s.toml", "--over", "run.sampling_period=0.05,0.1", "--seeds", "2",
        "-o", tmp_path / "study", "--jobs", "0", "--keep", "all", "--json",
    )  # fmt: skip
    done = command(*arguments)
    assert done.returncode == 0, done.stderr
    assert "follows: run.duration" in done.stderr
    first, *lines = map(json.loads, done.stdout.splitlines())
    assert (first["points"], [line["done"] for line in lines]) == (4, [1, 2, 3, 4])
    for line in lines:
        row = line["row"]
        assert row["status"] in STATUSES
        info = json.loads(command("info", tmp_path / "study" / row["recording"], "--json").stdout)
        assert (info["digest"], info["ticks"]) == (row["digest"], row["ticks"])
    again = command(*arguments)
    assert [json.loads(line)["done"] for line in again.stdout.splitlines()] == [0, 4]


def test_a_dry_run_says_how_much_it_would_be_and_writes_nothing(tmp_path):
    write(tmp_path / "s.toml", {"run.duration": 1.0})
    done = command(
        "sweep", tmp_path / "s.toml", "--over", "algorithm.alpha=0.1:1:10", "--dry-run",
        "-o", tmp_path / "study",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "10, of which 0 have a row" in done.stdout
    assert "100" in done.stdout
    assert not (tmp_path / "study").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--over", "algorithm.alpa=1,2"), "unknown key; did you mean 'alpha'"),
        (("--seeds", "x"), "--seeds: expected a number of seeds"),
        (("--keep", "some"), "--keep: expected none, failed, all or every:N"),
        (("--shard", "3/2"), "--shard: expected i/N"),
        (("--dask", "tcp://lab.example:8786"), "only tls:// is taken"),
        (("--width", "0.1"), "--width requires --refine"),
        (("--refine", "algorithm.alpha"), "expected boundary, or a key with an axis of its own"),
        (("--timeout", "0"), "--timeout: expected more than 0"),
        (("-o", "map.mcap"), "is the name of a recording, and a study is a folder"),
    ],
)
def test_a_wrong_option_is_one_message_and_makes_no_study(tmp_path, options, said):
    write(tmp_path / "s.toml", {"run.duration": 1.0})
    done = command("sweep", tmp_path / "s.toml", "-o", tmp_path / "study", *options)
    assert done.returncode == 2
    assert said in done.stderr
    assert not (tmp_path / "study" / "study.json").exists()


def test_parts_of_a_study_are_merged_into_the_table_of_the_whole(tmp_path):
    write(tmp_path / "s.toml", {"run.duration": 1.0})
    arguments = ("sweep", tmp_path / "s.toml", "--over", "algorithm.alpha=0.5:1:6", "--jobs", "0")
    for part in ("1/2", "2/2"):
        done = command(*arguments, "-o", tmp_path / part[0], "--shard", part)
        assert done.returncode == 0, done.stderr
    assert command(*arguments, "-o", tmp_path / "whole").returncode == 0
    done = command("study", "merge", tmp_path / "1", tmp_path / "2", "-o", tmp_path / "merged")
    assert done.returncode == 0, done.stderr
    merged, whole = nrs.Study(tmp_path / "merged"), nrs.Study(tmp_path / "whole")
    assert len(merged) == 6
    assert 0 < len(nrs.Study(tmp_path / "1")) < 6
    assert merged.digest == whole.digest


def test_a_part_that_has_no_point_is_a_study_too(tmp_path, capsys):
    with StudyStore(tmp_path) as store:
        axes = [axis_of("", "algorithm.alpha=0.5,0.9")]
        plan = StudyPlan({PAPER: example(PAPER, {"run.duration": 1.0})}, axes, shard=(1, 2**31))
        sweep_into(store, plan, local_engine(0))
    found = study_summary(tmp_path)
    assert (found["rows"], found["axes"]) == (0, {"algorithm.alpha": []})
    show_study(out, found)
    assert "algorithm.alpha 0 values\n" in capsys.readouterr().out
    assert repr(nrs.Study(tmp_path)) == "Study(0 runs: none)"
    nrs.Study(tmp_path).report(tmp_path / "a.html")


def test_an_fmu_that_is_sent_runs_only_where_that_is_allowed(tmp_path, monkeypatch):
    fmu = built(tmp_path)
    monkeypatch.setenv("NRS_CACHE", str(tmp_path / "cache"))
    base = example(three_robots(fmu=str(fmu)), folder=tmp_path, name="faulty")
    plan = StudyPlan({"faulty": base}, [], sent=True)
    task = task_of(PointReader(plan.scenarios).at({}), plan, StudyStore(tmp_path))
    row = run_point(task)
    assert (row["status"], row["cause_kind"]) == ("failed", "input")
    assert (
        "this worker runs no FMU that is sent to it; start it with NRS_ALLOW_FMUS=1"
        in row["reason"]
    )
    monkeypatch.setenv("NRS_ALLOW_FMUS", "1")
    sha256 = hashlib.sha256(fmu.read_bytes()).hexdigest()
    assert run_point(task) == NeedsFmus((sha256,))
    content = fmu.read_bytes()
    fmu.unlink()
    assert run_point(replace(task, content={sha256: content}))["status"] == "converged"
    assert run_point(task)["status"] == "converged", "it is kept, by content"
    wrong = replace(task, content={"0" * 64: content})
    assert "to have sha256 000" in run_point(wrong)["reason"]
