"""The package's recordings and replays: what commands print of them, in Python."""

import json
from pathlib import Path

import numpy as np
import pytest

import nrs_cosim as nrs
from tests.command import nrs as command


@pytest.fixture(scope="module")
def recording(paper, tmp_path_factory):
    with nrs.run(paper, tmp_path_factory.mktemp("api") / "run.mcap") as recording:
        yield recording


class TestRecording:
    def test_the_analysis_is_what_the_command_prints(self, recording):
        printed = json.loads(command("info", recording.path, "--json").stdout)
        assert json.loads(json.dumps(recording.analysis())) == printed

    def test_errors_agree_with_the_targets_formula(self, recording):
        states, errors = recording.states(), recording.errors()
        t = states["t"]
        position = np.stack([2 * t + np.sin(t), -2 * t - np.cos(t)], axis=1)
        for quantity, value in (
            ("position_tracking", "position"),
            ("position_estimate", "reference_position"),
        ):
            np.testing.assert_allclose(errors[quantity], states[value] - position, atol=1e-12)
        three = recording.errors(robots=3, start=10.0, end=20.0)
        assert set(three["robot"]) == {3}
        assert (three["t"].min(), three["t"].max()) == (10.0, 19.98)

    def test_the_target_is_on_the_grids_of_its_samples_and_of_the_states(self, recording):
        samples = recording.samples(robots=0)
        for grid, ticks in (("sampling", samples), ("output", recording.states(robots=1))):
            t = recording.times(grid)
            assert (t == ticks["t"]).all()
            position, velocity = recording.target(grid)
            assert position.shape == velocity.shape == (len(t), 2)
            formula = np.stack([2 * t + np.sin(t), -2 * t - np.cos(t)], axis=1)
            np.testing.assert_allclose(position, formula, atol=1e-12)
            slope = np.stack([2 + np.cos(t), -2 + np.sin(t)], axis=1)
            np.testing.assert_allclose(velocity, slope, atol=1e-12)
        np.testing.assert_allclose(recording.target("sampling")[0], samples["position"], atol=1e-12)
        assert [x.shape for x in recording.target(1.0)] == [(2,), (2,)]
        assert [x.shape for x in recording.target(np.ones((3, 4)))] == [(3, 4, 2)] * 2

    @pytest.mark.parametrize("table", ["states", "samples", "link_events", "errors", "to_pandas"])
    def test_robots_are_a_number_or_several_of_those_there_are(self, recording, table):
        pytest.importorskip("pandas")
        read = getattr(recording, table)
        robots = (lambda *args: read("states", *args)) if table == "to_pandas" else read
        several = [len(robots(of)) for of in ([1, 3], (3, 1), {1, 3}, np.array([1, 3]), [1, 3, 3])]
        assert len({*several}) == 1
        assert len(robots(3)) + len(robots(1)) == several[0]
        assert len(robots(np.int64(3))) == len(robots([3])) == len(robots(range(3, 4)))
        least = "0, the target," if table == "samples" else "1"
        wrong = [9, [1, 9], -1, 2.0, "3", [None], *([0] if least == "1" else [])]
        for of in wrong:
            with pytest.raises(nrs.errors.InputError, match=f"robots: expected {least} to 6, got"):
                robots(of)

    @pytest.mark.parametrize("table", ["states", "samples", "link_events", "errors"])
    def test_a_range_of_time_has_its_start_and_not_its_end(self, recording, table):
        rows = getattr(recording, table)(None, 1.0, 2.0)["t"]
        if table != "link_events":
            assert (rows.min(), rows.max()) == (1.0, 1.9 if table == "samples" else 1.98)
        for wrong in (float("nan"), "1", [1.0]):
            for name in ("start", "end"):
                with pytest.raises(nrs.errors.InputError, match=f"{name}: expected a time in s"):
                    getattr(recording, table)(**{name: wrong})

    @pytest.mark.parametrize(
        ("call", "words"),
        [
            (lambda r: r.times("samples"), "grid: expected output or sampling, got 'samples'"),
            (lambda r: r.target("samples"), "grid: expected output or sampling, got 'samples'"),
            (lambda r: r.target([0.0, None, "x"]), "t: expected times in s, got "),
            (lambda r: r.target(float("nan")), "t: expected times in s, got nan"),
            (
                lambda r: r.to_pandas("state"),
                "table: expected states or samples or agent_states or measurements or link_events",
            ),
            (lambda r: r.report("a.docx"), r"a\.docx: expected a name that ends in one of \.html"),
            (lambda r: r.report("README.md/a.html"), "README.md: is a file and not a folder"),
        ],
    )  # fmt: skip
    def test_a_wrong_selection_is_named(self, recording, monkeypatch, call, words):
        monkeypatch.chdir(Path(__file__).parents[2])
        with pytest.raises(nrs.errors.InputError, match=words):
            call(recording)

    def test_a_report_destroys_no_other_file(self, recording, tmp_path):
        (tmp_path / "a.html").write_text("my thesis", "utf-8")
        with pytest.raises(nrs.errors.InputError, match="exists and is no report"):
            recording.report(tmp_path / "a.html")
        assert (tmp_path / "a.html").read_text("utf-8") == "my thesis"

    def test_a_table_of_pandas_is_the_rows_of_its_name(self, recording):
        pytest.importorskip("pandas")
        frame = recording.to_pandas("errors", robots=3, start=10.0, end=20.0)
        rows = recording.errors(robots=3, start=10.0, end=20.0)
        assert (frame["velocity_tracking_2"] == rows["velocity_tracking"][:, 1]).all()
        assert list(recording.to_pandas("link_events").columns)[4:6] == ["source", "lost"]

    def test_a_closed_recording_still_has_a_repr(self, short):
        with nrs.run(short) as recording:
            pass
        for read in (recording.states, recording.errors, recording.dataset, recording.analysis):
            with pytest.raises(nrs.errors.InputError, match="is closed here; open it again"):
                read()
        assert repr(recording).endswith(", closed)")
        assert "20 ticks" in recording._repr_html_()

    def test_a_recording_gives_back_its_scenario(self, recording, paper):
        assert recording.to_scenario() == paper

    def test_a_table_of_pandas_has_a_column_for_each_number(self, recording):
        pytest.importorskip("pandas")
        table = recording.to_pandas()
        assert list(table.columns[4:6]) == ["position_1", "position_2"]
        assert list(table.columns[-2:]) == ["reference_velocity_1", "reference_velocity_2"]
        assert (table["position_2"].to_numpy() == recording.states()["position"][:, 1]).all()

    def test_a_recordings_repr_is_one_line(self, recording):
        assert repr(recording) == (
            "Recording('run.mcap': completed, 6 robots, 300 ticks, digest 5433c658)"
        )

    def test_a_report_is_a_page(self, recording, tmp_path):
        pytest.importorskip("plotly")
        assert recording.report(tmp_path / "a.html").read_text("utf-8").startswith("<!doctype html")


class TestReplay:
    def test_a_recording_is_verified_with_and_without_its_plants(self, short, tmp_path):
        with nrs.run(short, tmp_path / "run.mcap") as recording:
            for agents_only in (False, True):
                found = nrs.replay.verify(recording, agents_only=agents_only)
                assert (found.status, found.ticks) == ("identical", recording.ticks)
                assert found.messages == found.as_json()["messages"] > 500
        assert nrs.replay.verify(tmp_path / "run.mcap").status == "identical"

    def test_what_if_equals_that_of_the_command(self, short, tmp_path):
        path = tmp_path / "run.mcap"
        with nrs.run(short, path) as recording:
            assert command(
                "replay", path, "--plant", "robots=2,controller.kp=150.0", "-o", tmp_path / "a.mcap"
            ).returncode == 0  # fmt: skip
            stiff = {"controller.kp": 150.0}
            with nrs.replay.what_if(recording, stiff, tmp_path / "b.mcap", robots=[2]) as mine:
                found = nrs.compare(mine, tmp_path / "a.mcap")
                assert found.is_same
                assert nrs.compare(recording, mine).first.robot == 2
            with nrs.replay.what_if(path, {"algorithm.beta": 0.5}) as other:
                assert other.to_scenario()["algorithm.beta"] == 0.5
                with nrs.run(short.replace({"algorithm.beta": 0.5})) as fresh:
                    assert other.digest == fresh.digest

    @pytest.mark.parametrize(
        ("changes", "robots", "words"),
        [
            ({}, None, "changes: expected a key and a value at least"),
            ({"algorithm.beta": 0.5}, [1], "robots: expected some, and changes of their plants"),
            ({"controller.kp": 1.0}, [], "robots: expected some"),
            ({"run.seed": 2}, None, "expected a key of plant, controller or disturbance"),
            ({"algorithm.bet": 0.5}, None, "did you mean 'beta'"),
        ],
        ids=["none", "robots of an algorithm", "no robots", "another key", "a typo"],
    )
    def test_an_impossible_change_is_named(self, short, changes, robots, words):
        with nrs.run(short) as recording, pytest.raises(nrs.errors.InputError, match=words):
            nrs.replay.what_if(recording, changes, robots=robots)

    def test_the_parent_recording_is_refused_as_output(self, short, tmp_path):
        path = tmp_path / "run.mcap"
        with nrs.run(short, path) as recording, pytest.raises(nrs.errors.InputError):
            nrs.replay.what_if(recording, {"controller.kp": 1.0}, path, force=True)
        assert nrs.replay.verify(path, agents_only=True).status == "identical"
