"""What a run stores of its last fifth is what its messages give, and is not trusted beyond that."""

import json

import pytest

from nrs_cosim.orchestrator.cluster.launcher import local_workers
from nrs_cosim.orchestrator.cluster.supervision import WorkerPolicy
from nrs_cosim.orchestrator.engine import last_fifth
from nrs_cosim.orchestrator.engine.run import past_of, run
from nrs_cosim.orchestrator.engine.summary import measure, stored_measurement
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.recordings.mcap.copy import recover
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import steady_state
from nrs_cosim.recordings.metadata import MEASURED
from tests.cases import cases
from tests.command import nrs
from tests.orchestrator.test_resealed import Sealed
from tests.scenarios import SHORT, example, paper


def of_messages(path, experiment):
    with Reader(path) as reader:
        return steady_state(reader, experiment.target_at, experiment.byzantine)


def stored(path, experiment):
    with Reader(path) as reader:
        return stored_measurement(reader, experiment)


@pytest.mark.parametrize("together", cases([1, 4096], [1]))
@pytest.mark.parametrize("name", ["paper_jitter", "paper_lossy_links", "byzantine_wmsr"])
def test_a_run_stores_what_its_messages_give(name, together, tmp_path, monkeypatch):
    monkeypatch.setattr(last_fifth, "_TOGETHER", together)
    experiment = example(name, {"run.duration": 3.0})
    path = run(experiment, tmp_path / "run.mcap").path
    assert stored(path, experiment) == of_messages(path, experiment)


def test_a_run_that_goes_on_and_workers_store_the_same(tmp_path):
    experiment = paper(SHORT)

    def stop(time_ns):
        if time_ns >= 900_000_000:
            raise Interrupted

    part = run(experiment, tmp_path / "part.mcap", watch=stop).path
    assert stored(part, experiment) is None
    with Reader(part) as reader:
        rest = run(experiment, tmp_path / "rest.mcap", past=past_of(reader)).path
    expected = of_messages(rest, experiment)
    assert stored(rest, experiment) == expected
    policy = WorkerPolicy(True, 60.0, lambda _text: None, 1)
    for count in cases([3], []):
        launch = local_workers(experiment, count, policy)
        path = run(experiment, tmp_path / "workers.mcap", launch).path
        assert stored(path, experiment) == expected


def test_what_is_stored_is_read_without_the_messages_and_of_its_own_scenario_alone(
    tmp_path, monkeypatch
):
    experiment, other = paper(SHORT), paper(SHORT, {"target.axes": [{"offset": 9.0}] * 2})
    path = run(experiment, tmp_path / "run.mcap").path
    with Reader(path) as reader, monkeypatch.context() as patched:
        patched.setattr(Reader, "columns", None)
        kept = measure(reader, experiment)
    with Reader(path) as reader:
        assert kept == of_messages(path, experiment)
        assert measure(reader, other).position_estimate > kept.position_estimate


def test_a_measurement_that_was_sealed_into_a_recording_is_seen_through_when_asked(tmp_path):
    experiment = paper(SHORT)
    path = run(experiment, tmp_path / "run.mcap").path
    said = json.loads(nrs("info", path, "--json").stdout)
    assert (said["measured"], said["damage"]) == ("stored", [])
    checked = nrs("info", path, "--json", "--verify")
    assert json.loads(checked.stdout) == {**said, "measured": "from messages"}

    def lie(end):
        return {**end, MEASURED: json.dumps({**json.loads(end[MEASURED]), "size": 7.0})}

    liar = Sealed(path).again(tmp_path / "liar.mcap", ending=lie)
    asked = json.loads(nrs("info", liar, "--json", "--verify").stdout)
    assert asked["damage"] == ["nrs.end: measured: is not what the messages give"]
    with Reader(liar, verify=True) as reader:
        recover(reader, tmp_path / "whole.mcap")
    assert stored(tmp_path / "whole.mcap", experiment) is None
