"""Robots spread over processes of this machine say, bit by bit, what they say in one process."""

import json

import pytest

from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import RUN
from tests.cases import cases
from tests.cluster.local_workers import LocalRun, digest, lossy, mixed, story, switching
from tests.cluster.remote_workers import Run, Worker, alone
from tests.scenarios import SCENARIOS, SHORT, example, paper

pytestmark = pytest.mark.usefixtures("nothing_is_left")

PAPER = sorted(path.stem for path in SCENARIOS.glob("paper_*.toml"))
NETWORKS = {
    "switching": example("switching", {"run.duration": 9.0}),
    "switching, with faults": switching(duration=16.0),
    "of positions and velocities": example("hetero_information", {"run.duration": 3.0}),
}


def test_any_number_of_workers_gives_one_digest(tmp_path):
    """With lost and late samples."""
    run(lossy(), tmp_path / "1.mcap")
    for workers in (2, 4):
        spread = LocalRun(lossy(), workers)
        outcome = spread.run(tmp_path / f"{workers}.mcap")
        assert (outcome.status, outcome.reason, outcome.rejected) == ("completed", "", {})
        assert len(spread.coordinator.assignment) == workers
        assert story(outcome.path) == story(tmp_path / "1.mcap")
        assert digest(outcome.path) == digest(tmp_path / "1.mcap")


@pytest.mark.parametrize("name", cases(PAPER, PAPER[::4]))
def test_the_papers_scenarios_give_one_digest_on_any_number_of_workers(tmp_path, name):
    workers = cases((2, 6), (2 + 4 * (PAPER.index(name) // 4 % 2),))  # one after the other
    assert_same(tmp_path, example(name, {"run.duration": 4.5}), workers)


@pytest.mark.parametrize("name", cases([*NETWORKS], [*NETWORKS][1:]))
def test_switching_and_separate_networks_give_one_digest_on_any_number_of_workers(tmp_path, name):
    assert_same(tmp_path, NETWORKS[name], cases((2, 3, 6), (3,)))


def assert_same(folder, file, workers):
    """On workers that share a process and meet at a socket, for what they say is the same."""
    one = alone(file, folder)
    for n in workers:
        meet = f"unixsock-stream/{folder}/{n}"
        with Run(file, folder / f"{n}.mcap", listen=(meet,), expected=n) as spread:
            workers = [Worker(meet, f"worker-{i}") for i in range(n)]
            assert spread.digest() == one
        for worker in workers:
            worker.end()


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Return recordings of robots that are driven in many ways, in one process."""
    path = tmp_path_factory.mktemp("driven") / "1.mcap"
    run(mixed(), path)
    return path


def plants(path):
    with Reader(path) as reader:
        return json.loads(reader.metadata[RUN]["plants"])


@pytest.mark.parametrize("workers", cases([2, 6], [2]))
def test_all_kinds_of_plants_give_one_digest_on_any_number_of_workers(tmp_path, driven, workers):
    path = tmp_path / "n.mcap"
    assert LocalRun(mixed(), workers).run(path).status == "completed"
    assert story(path) == story(driven)
    assert digest(path) == digest(driven)
    assert plants(path) == plants(driven)


def test_the_measured_error_of_a_group_is_recorded_wherever_its_robots_run(tmp_path):
    """The error of a held torque is measured at some robots, and told of all."""
    file = paper(SHORT, {"plant.control": "hold"})
    run(file, tmp_path / "1.mcap")
    LocalRun(file, 3).run(tmp_path / "3.mcap")
    (result,) = plants(tmp_path / "1.mcap")
    assert result["robots"] == [1, 2, 3, 4, 5, 6]
    assert plants(tmp_path / "3.mcap") == [result]
