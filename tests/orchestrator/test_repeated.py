"""Runs in one process leave nothing behind: no descriptor, no thread, no temporary folder."""

import gc
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import pytest

from benchmarks.repeated import Holdings
from nrs_cosim.orchestrator.cluster.launcher import local_workers
from nrs_cosim.orchestrator.cluster.supervision import WorkerPolicy
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.scenarios import SHORT, paper

RUNS = cases(60, 25)


def held_after_each(
    folder: Path, runs: int, workers: int
) -> tuple[set[str | None], list[Holdings]]:
    """Return the digests of so many runs here, and what the process holds after each."""
    tempfile.tempdir = str(folder)
    file = paper(SHORT)
    launch = (
        local_workers(file, workers, WorkerPolicy(True, 60.0, lambda _text: None))
        if workers > 1
        else None
    )
    digests, held = set(), []
    for _ in range(runs):
        outcome = run(file, folder / "run.mcap", launch)
        assert outcome.status == "completed", outcome.reason
        with Reader(folder / "run.mcap") as reader:
            digests.add(reader.digest)
        gc.collect()
        held.append(Holdings.now())
        if workers > 1:  # Zenoh's network has threads that come and go
            held[-1] = replace(held[-1], threads=0)
    return digests, held


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="what is held is told by Linux only")
@pytest.mark.parametrize(("runs", "workers"), cases([(RUNS, 1), (3, 2)], [(RUNS, 1)]))
def test_many_runs_use_no_more_memory_than_one(tmp_path, runs, workers):
    # A process of its own: threads that other tests left may end at any moment.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as fresh:
        digests, held = fresh.submit(held_after_each, tmp_path, runs, workers).result()
    assert len(digests) == 1
    assert held[-1].folders == 0
    assert held == [held[0]] * runs
