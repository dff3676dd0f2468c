"""Runs in one process leave nothing behind: no descriptor, no thread, no temporary folder."""

import gc
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.repeated import Holdings
from nrs_cosim.orchestrator.cluster.launcher import local_workers
from nrs_cosim.orchestrator.cluster.policy import WorkerPolicy
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.mcap.reader import Reader
from tests.scenarios import SHORT, paper

RUNS = 60


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="what is held is told by Linux only")
@pytest.mark.parametrize(("runs", "workers"), [(RUNS, 1), (3, 2)], ids=["alone", "two workers"])
def test_many_runs_use_no_more_memory_than_one(tmp_path, monkeypatch, runs, workers):
    folder = tmp_path / "t"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    file = paper(SHORT)
    launch = (
        local_workers(file, workers, WorkerPolicy(True, 60.0, lambda _text: None))
        if workers > 1
        else None
    )
    digests, held = set(), []
    for _ in range(runs):
        outcome = run(file, tmp_path / "run.mcap", launch)
        assert outcome.status == "completed", outcome.reason
        with Reader(tmp_path / "run.mcap") as reader:
            digests.add(reader.digest)
        gc.collect()
        held.append(Holdings.now())
        if workers > 1:  # Zenoh's network has threads that come and go
            held[-1] = replace(held[-1], threads=0)
    assert len(digests) == 1
    assert held[-1].folders == 0
    assert held == [held[0]] * runs
