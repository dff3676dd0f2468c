"""With how many threads a worker steps is told to its process, here and elsewhere."""

from unittest.mock import Mock

import pytest

from nrs_cosim.orchestrator.cluster import local_worker
from nrs_cosim.orchestrator.engine.in_process import threads_worth_it
from tests.command import nrs


@pytest.mark.parametrize(
    ("robots", "processes", "threads"),
    [(15, 1, 1), (32, 1, 2), (1000, 1, 4), (1000, 2, 2), (1000, 3, 1), (1000, 8, 1), (64, 2, 2)],
)
def test_processes_share_the_processors(monkeypatch, robots, processes, threads):
    monkeypatch.setattr("os.cpu_count", lambda: 4)
    assert threads_worth_it(robots, processes) == threads


def test_a_worker_started_here_is_told_its_threads(tmp_path, monkeypatch):
    start = Mock()
    monkeypatch.setattr(local_worker, "start_python", start)
    local_worker.LocalWorker("local-1", [1, 2], "unixsock-stream/bus", tmp_path, threads=3)
    command = start.call_args.args
    assert command[command.index("--threads") + 1] == "3"


@pytest.mark.parametrize(("options", "threads"), [((), 1), (("--threads", "3"), 3)])
def test_a_worker_elsewhere_has_one_thread_unless_more_are_given(monkeypatch, options, threads):
    serve = Mock()
    monkeypatch.setattr("nrs_cosim.orchestrator.cluster.worker_client.serve", serve)
    assert nrs("worker", "--connect", "unixsock-stream//tmp/bus", *options).returncode == 0
    assert serve.call_args.args[0].threads == threads
