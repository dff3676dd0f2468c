"""Errors of estimates are those of the states at t_k: of all robots, whether they sent or not."""

import numpy as np
import pytest

from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import measure
from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.recordings.export.tables import samples, states
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import errors_by_tick
from tests.scenarios import example, paper


def of_samples(experiment, reader):
    """Return what robots sent, and the ∞-norms of its errors, (rows, 2)."""
    found = np.concatenate(list(samples(reader)))
    found = found[found["robot"] > 0]
    target = experiment.target_at(found["t"])
    errors = [found[n] - z for n, z in zip(("position", "velocity"), target, strict=True)]
    return found, np.stack([np.abs(error).max(axis=1) for error in errors], axis=1)


@pytest.mark.parametrize("name", ["paper_first_order", "paper_jitter", "switching"])
def test_where_all_send_at_every_tick_nothing_differs_from_samples(name, tmp_path):
    experiment = example(name, {"run.duration": 4.0})
    with Reader(run(experiment, tmp_path / "run.mcap").path) as reader:
        found, norms = of_samples(experiment, reader)
        measured, story = measure(reader, experiment), story_of(reader, experiment)
        last = found["time_ns"] >= reader.end_ns - reader.end_ns // 5
        suprema = [measured.position_estimate, measured.velocity_estimate]
        assert suprema == norms[last].max(axis=0).tolist()
        parts = errors_by_tick(reader, experiment.target_at)
        whole = {int(k): x for ks, errors in parts for k, x in zip(ks, errors, strict=True)}
        assert sorted(whole) == list(range(1, reader.ticks + 1))
        target = experiment.target_at(found["t"])
        for row, sample in enumerate(found):
            position, velocity = whole[sample["k"]][:, sample["robot"] - 1]
            assert position.tolist() == (sample["position"] - target[0][row]).tolist()
            assert velocity.tolist() == (sample["velocity"] - target[1][row]).tolist()
        for number, quantity in enumerate(("position_estimate", "velocity_estimate")):
            by_tick = [norms[found["k"] == k, number].max() for k in range(1, reader.ticks + 1)]
            assert story.envelopes[quantity].largest.tolist() == by_tick


def test_a_robot_that_sends_nothing_is_measured_all_the_same(tmp_path):
    silent = {"faults.robots": [{"id": 6, "outages": [[0.1, 9.0]]}]}
    experiment = paper({"run.duration": 2.0}, silent)
    with Reader(run(experiment, tmp_path / "run.mcap").path) as reader:
        sent, norms = of_samples(experiment, reader)
        assert 6 not in sent["robot"]
        measured, story = measure(reader, experiment), story_of(reader, experiment)
        kept = np.concatenate(list(states(reader)))
        ticks = {k for ks, _ in errors_by_tick(reader, experiment.target_at) for k in ks.tolist()}
    assert ticks == set(range(1, 21))
    last = experiment.clock.t(20)
    errors = np.abs(kept["reference_position"] - experiment.target_at(kept["t"])[0]).max(axis=1)
    times = np.isin(kept["time_ns"], [experiment.clock.t(k) for k in range(1, 21)])
    fifth = times & (kept["time_ns"] >= last - last // 5)
    assert measured.position_estimate == errors[fifth].max()
    assert measured.position_estimate > norms[sent["time_ns"] >= last - last // 5, 0].max()
    by_tick = [errors[times & (kept["k"] == k)].max() for k in range(1, 21)]
    assert story.envelopes["position_estimate"].largest.tolist() == by_tick
