"""What agents keep beside their estimates is recorded, verified, resumed and compared."""

import json

import numpy as np
import pytest

from nrs_cosim.bus.messages import STATE, Codec
from nrs_cosim.orchestrator.engine.run import past_of, run
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.replay.diff import compare
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.mcap.copy import copy_of, ending
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.schemas import recorded_types
from tests.command import nrs
from tests.scenarios import SHORT, paper, write

WITH_INTEGRAL = {"algorithm.name": "pi_consensus", "algorithm.kappa": 0.3}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kept")
    scenario = write(folder / "pi.toml", SHORT, WITH_INTEGRAL)
    done = nrs("run", scenario, "-o", folder / "run.mcap")
    assert done.returncode == 0, done.stderr
    return folder / "run.mcap"


def test_every_robots_state_is_there_at_every_tick_and_counted(recorded):
    with Recording(recorded) as recording:
        kept, digest = recording.agent_states(), recording.digest
        assert recording.agent_states([2], 0.5, 0.6)["robot"].tolist() == [2]
    assert kept.dtype.names == ("k", "time_ns", "t", "robot", "integral")
    keys = list(zip(kept["k"].tolist(), kept["robot"].tolist(), strict=True))
    assert keys == [(k, robot) for k in range(1, 11) for robot in range(1, 7)]
    assert (kept["time_ns"] == kept["k"].astype(np.int64) * 100_000_000).all()
    assert np.abs(kept["integral"]).max() > 0
    assert digest
    with Reader(recorded, verify=True) as reader:
        assert not reader.damage
        topics = [channel.topic for channel in reader.channels if channel.counted]
        assert topics.count("/robot_3/agent_state") == 1


def test_the_recorded_agent_state_is_that_after_the_jump(recorded):
    """This integral grows by the disagreement with what was received: by the samples alone."""
    with Recording(recorded) as recording, Reader(recorded) as reader:
        experiment = experiment_of(reader)
        kept, samples = recording.agent_states(), recording.samples()
    topology = experiment.topologies.links
    at = {(row["k"], row["robot"]): row["position"] for row in samples}
    integral = {(row["k"], row["robot"]): row["integral"] for row in kept}
    integral |= {(0, robot): np.zeros(2) for robot in range(1, 7)}
    for k in range(1, 11):
        for robot in range(1, 7):
            mine = topology.sink == robot
            pairs = zip(topology.source[mine], topology.normalised[mine], strict=True)
            apart = sum(weight * (at[k, j] - at[k, robot]) for j, weight in pairs)
            before, after = integral[k - 1, robot], integral[k, robot]
            np.testing.assert_allclose(after - before, apart, rtol=1e-9, atol=1e-9)


def altered(recorded, path, topic, tick, field):
    """Write a copy of a recording in which one message's field is another."""
    with Reader(recorded) as reader, copy_of(reader, path, {}) as writer:
        kind = topic.rpartition("/")[2]
        codec: Codec = recorded_types(reader).codecs[kind]
        for messages in past_of(reader):
            changed = []
            for time_ns, of, k, data in messages:
                if (of, k) == (topic, tick):
                    records = codec.decode([data]).copy()
                    records[field] += 1.0
                    (data,) = codec.encode(records)  # noqa: PLW2901
                changed.append((time_ns, of, k, data))
            writer.write(changed)
        writer.finish(*ending(reader))
    return path


def test_a_replay_finds_the_first_state_that_does_not_come_out_again(recorded, tmp_path):
    with Reader(recorded) as reader:
        assert verify(reader, experiment_of(reader), plants=False).status == "identical"
    path = altered(recorded, tmp_path / "a.mcap", "/robot_4/agent_state", 6, "integral")
    with Reader(path) as reader:
        found = verify(reader, experiment_of(reader), plants=False).difference
    assert found
    assert (found.k, found.topic, found.robot, found.field) == (
        *(6, "/robot_4/agent_state", 4, "integral"),
    )
    with Reader(recorded) as one, Reader(path) as other:
        apart = compare(one, other)
    assert apart.first
    assert apart.first.recorded == found.replayed
    assert apart.first.replayed == found.recorded
    assert not apart.is_same


def test_two_algorithms_are_compared_by_their_states_and_the_schemas_that_differ(
    recorded, tmp_path
):
    other = run(paper(SHORT), tmp_path / "dcea1.mcap").path
    with Reader(recorded) as one, Reader(other) as two:
        found = compare(one, two, curves=6)
    assert found.schemas == {"agent_state": ("integral (m)", "none")}
    assert not found.is_same
    assert {distance.quantity for distance in found.distances} >= {"position", "effort"}
    assert {robot for robot, _ in found.apart} == {*range(1, 7)}
    assert not any(name.startswith("agent_") for _, name in found.apart)
    done = nrs("diff", recorded, other)
    assert done.returncode == 1
    assert "agent_states: integral (m) -> none" in done.stdout


def test_distances_are_of_what_agents_keep_too(recorded, tmp_path):
    scenario = write(tmp_path / "s.toml", SHORT, WITH_INTEGRAL, {"algorithm.kappa": 0.2})
    assert nrs("run", scenario, "-o", tmp_path / "b.mcap").returncode == 0
    with Recording(recorded) as one, Recording(tmp_path / "b.mcap") as two:
        a, b = one.agent_states(robots=4), two.agent_states(robots=4)
    apart = np.linalg.norm(a["integral"] - b["integral"], axis=1)
    done = nrs("diff", recorded, tmp_path / "b.mcap", "--json", "--picture", tmp_path / "a.png")
    distances = json.loads(done.stdout)["distances"]
    of_robot = {d["quantity"]: d for d in distances if d["robot"] == 4}
    assert [*of_robot] == [*STATE.fields, "agent_integral"]
    found = of_robot["agent_integral"]
    assert found["largest"] == pytest.approx(apart.max(), rel=1e-12)
    assert found["at"] == a["t"][apart.argmax()]
    assert found["rms"] == pytest.approx(np.sqrt(np.mean(apart**2)), rel=1e-12)
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_a_run_is_resumed_with_the_states_that_it_had(recorded, tmp_path):
    with Reader(recorded) as reader, copy_of(reader, tmp_path / "half.mcap", {}) as writer:
        for k, messages in enumerate(past_of(reader)):
            if k <= 5:
                writer.write(messages)
        writer.finish("interrupted", "half way")
    done = nrs("resume", tmp_path / "half.mcap", "-o", tmp_path / "whole.mcap")
    assert done.returncode == 0, done.stderr
    with Reader(recorded) as one, Reader(tmp_path / "whole.mcap") as two:
        assert one.digest == two.digest
