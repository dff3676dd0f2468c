"""What pinned robots measure of the target is recorded, verified, resumed and compared."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from nrs_cosim import Algorithm
from nrs_cosim.bus.random_streams import keyed_normal
from nrs_cosim.orchestrator.engine.run import past_of, run
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.replay.diff import compare
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.mcap.copy import copy_of
from nrs_cosim.recordings.mcap.reader import Reader
from tests.command import nrs
from tests.orchestrator.test_agent_states import altered
from tests.scenarios import example, write

R = 0.04
BASE = "compare_kalman_consensus"
TAKEN_IN_TURNS = {
    "run.duration": 1.0,
    "algorithm.r": R,
    "network": {
        "switching": [
            {"from": 1, "edge_list": [[0, 1], [0, 3], [1, 2], [1, 4], [1, 5], [1, 6]]},
            {"from": 4, "edge_list": [[0, 2], [2, 1], [2, 3], [2, 4], [2, 5], [2, 6]]},
        ],
        "repeat": 4,
    },
    "faults.links": [{"from": 0, "loss": 0.5, "noise": {"position": 0.1}}],
}
"""Robots 1 and 3 are pinned for three ticks, then robot 2 for one, over links that lose."""
EXPECTED = [(k, robot) for k in range(1, 11) for robot in ([2] if k % 4 == 0 else [1, 3])]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("measured")
    done = nrs(
        *("run", write(folder / "s.toml", TAKEN_IN_TURNS, base=BASE)), "-o", folder / "run.mcap"
    )
    assert done.returncode == 0, done.stderr
    return folder / "run.mcap"


def test_each_pinned_robots_measurement_is_there_and_is_the_target_with_its_own_noise(recorded):
    with Recording(recorded) as recording:
        measured, target = recording.measurements(), recording.samples(robots=0)
    assert list(zip(measured["k"].tolist(), measured["robot"].tolist(), strict=True)) == EXPECTED
    assert (measured["time_ns"] == measured["k"].astype(np.int64) * 100_000_000).all()
    at = {int(row["k"]): row for row in target}
    for row in measured:
        k, robot = int(row["k"]), int(row["robot"])
        noise = keyed_normal(1, "measured position", np.array([robot]), k, 2)[0]
        np.testing.assert_allclose(
            row["position"], at[k]["position"] + np.sqrt(R) * noise, rtol=1e-15
        )
        assert (row["velocity"] == at[k]["velocity"]).all()


def test_a_robot_goes_by_the_recorded_measurement_where_its_link_leaves_it_alone(tmp_path):
    sound = example(BASE, TAKEN_IN_TURNS, {"faults": None})
    with Recording(run(sound, tmp_path / "a.mcap").path) as recording:
        measured, sent = recording.measurements(), recording.samples()
    said = {(row["k"], row["robot"]): row["information"] for row in sent}
    for row in measured:
        assert (said[row["k"], row["robot"]] == row["position"] / R).all()


def test_measurements_enter_the_digest_and_a_replay_finds_the_first_that_is_another(
    recorded, tmp_path
):
    with Reader(recorded, verify=True) as reader:
        assert not reader.damage
        counted = {channel.topic for channel in reader.channels if channel.counted}
        assert {t for t in counted if t.endswith("measurement")} == {
            f"/robot_{robot}/measurement" for robot in (1, 2, 3)
        }
        for plants in (True, False):
            assert verify(reader, experiment_of(reader), plants=plants).status == "identical"
    path = altered(recorded, tmp_path / "a.mcap", "/robot_2/measurement", 4, "velocity")
    with Reader(recorded) as one, Reader(path) as other:
        found = verify(other, experiment_of(other), plants=False).difference
        apart = compare(one, other)
    assert found
    assert apart.first
    assert (found.k, found.topic, found.field) == (4, "/robot_2/measurement", "velocity")
    assert apart.first.recorded == found.replayed


def test_a_resumed_run_and_a_changed_plant_have_the_measurements_of_the_run(recorded, tmp_path):
    with Reader(recorded) as reader, copy_of(reader, tmp_path / "half.mcap", {}) as writer:
        for k, messages in enumerate(past_of(reader)):
            if k <= 6:
                writer.write(messages)
        writer.finish("interrupted", "half way")
    for arguments in (
        ["resume", tmp_path / "half.mcap", "-o", tmp_path / "whole.mcap"],
        ["replay", recorded, "--plant", "controller.kp=150", "-o", tmp_path / "other.mcap"],
    ):
        done = nrs(*arguments)
        assert done.returncode == 0, done.stderr
    with Reader(recorded) as one, Reader(tmp_path / "whole.mcap") as two:
        assert one.digest == two.digest
    with Recording(recorded) as one, Recording(tmp_path / "other.mcap") as other:
        assert one.digest != other.digest
        assert one.measurements().tobytes() == other.measurements().tobytes()


def test_a_run_whose_algorithm_measures_nothing_of_its_own_has_no_topic_of_it(tmp_path):
    plain = example("paper_first_order", {"run.duration": 0.2})
    with Reader(run(plain, tmp_path / "a.mcap").path) as reader:
        assert not [t for t in reader.topics.values() if t.endswith("measurement")]
    with Recording(tmp_path / "a.mcap") as recording:
        assert len(recording.measurements()) == 0


@dataclass(frozen=True)
class Blind(Algorithm):
    """A sensor that fails at tick 2, for robot 3 alone."""

    MISSING: ClassVar = ("hold",)

    def measure(self, now, target):
        fails = (now.k == 2) & (now.robots == 3)
        return target.replace(position=np.where(fails[:, None], np.nan, target.position))

    def jump(self, estimate, disagreement):  # noqa: ARG002
        return estimate


def test_a_measurement_that_is_no_number_ends_the_run_with_its_place(tmp_path, monkeypatch):
    experiment = example("paper_first_order", {"run.duration": 1.0})
    monkeypatch.setitem(vars(experiment), "algorithm", Blind())
    outcome = run(experiment, tmp_path / "a.mcap")
    assert outcome.status == "failed"
    assert outcome.reason.startswith(
        f"algorithm Blind: measure returned a position of nan for robot 3 at tick 2, at {__file__}"
    )
