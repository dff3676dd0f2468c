"""What is measured of one run, one loop, or one part by itself, each in a process of its own.

A run is timed from its first tick until its recording is closed; all before is its set-up: reading
the scenario, starting workers, opening the plants. Its memory is the most that its processes have
had, all together.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from zenoh.handlers import Callback

from benchmarks.bare import timed
from benchmarks.memory import peak, workers
from benchmarks.work import scenario
from benchmarks.writers import as_columns, ours_of_columns, ticks_of
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.sessions import open_session
from nrs_cosim.orchestrator.cluster.launcher import local_workers
from nrs_cosim.orchestrator.cluster.supervision import WorkerPolicy
from nrs_cosim.orchestrator.engine.in_process import in_process
from nrs_cosim.orchestrator.engine.pace import AtOnce
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.mcap.reader import Reader

Found = dict[str, float]
POLICY = WorkerPolicy(restart=False, wait=60.0, show=lambda _text: None)
_LOOK = 0.2
"""s: between two looks at the memory of workers."""
_BATCH = 100
_PAYLOAD = bytes(59)
"""As long as a sample."""


def apart(measure: Callable[..., Mapping[str, float]], *arguments: Any) -> Found:
    """Return what is measured in a process of its own, and that process's peak memory, bytes."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(_measured, measure, arguments).result()


def _measured(measure: Callable[..., Mapping[str, float]], arguments: tuple[Any, ...]) -> Found:
    found = measure(*arguments)
    return {"peak": peak(), **found}


class Begun(AtOnce):
    """Notes when simulated time begins to pass, and how much memory the workers have then."""

    def __init__(self, n_workers: int) -> None:
        self._n_workers = n_workers
        self.at = self.cpu = self._looked = 0.0
        self._peaks: dict[int, int] = {}

    def start(self, time_ns: int) -> None:  # noqa: ARG002
        """Note that the set-up is over."""
        self.at, self.cpu = time.perf_counter(), time.process_time()

    def wait(self, time_ns: int, ask: Callable[[], None]) -> None:  # noqa: ARG002
        """Look at the memory of workers now and then, where they are in other processes."""
        if self._n_workers > 1 and time.perf_counter() - self._looked >= _LOOK:
            self._peaks |= {pid: peak(pid) for _, pid in workers()}
            self._looked = time.perf_counter()

    @property
    def peak(self) -> int:
        """The most memory that this process and its workers have had, bytes."""
        return peak() + sum(self._peaks.values())


def recorded(n: int, ticks: int, n_workers: int, path: Path, threads: int = 1) -> Found:
    """Run arms into a recording, on one worker in this process or on some of their own.

    In this process so many threads step the FMUs.
    """
    return recorded_file(lambda: scenario(n, ticks), ticks, n_workers, path, threads)


def recorded_file(
    read: Callable[[], Experiment], ticks: int, n_workers: int, path: Path, threads: int = 1
) -> Found:
    """Run a scenario, which is yet to be read, likewise."""
    began, cpu_began, begun = time.perf_counter(), time.process_time(), Begun(n_workers)
    file = read()
    n = file.n
    apart = n_workers > 1
    launch = local_workers(file, n_workers, POLICY) if apart else in_process(file, threads)
    outcome = run(file, path, launch, pace=begun)
    ended, cpu = time.perf_counter(), time.process_time()
    assert outcome.status == "completed", outcome.reason
    every = file.scenario.run.checkpoint_every
    assert outcome.messages == ticks * (2 * n + 1) + n + ticks // every * n
    with Reader(path) as reader:
        digest = reader.digest
    return {
        "seconds": ended - begun.at,
        **({} if apart else {"cpu": cpu - begun.cpu, "setup_cpu": begun.cpu - cpu_began}),
        "setup": begun.at - began,
        "peak": begun.peak,
        "bytes": path.stat().st_size,
        "digest": int(digest[:12], 16),
    }


def zenoh_put_and_received(count: int, payload: bytes = _PAYLOAD) -> Found:
    """Put messages one by one on a key of a session without sockets, and take them out again."""
    session = open_session(Endpoints())
    received: deque[Any] = deque()
    session.declare_subscriber("nrs/x/samples/a", Callback(received.append, indirect=False))
    put = session.declare_publisher("nrs/x/samples/a").put
    taken = 0

    def work() -> None:
        nonlocal taken
        for _ in range(count // _BATCH):
            for _ in range(_BATCH):
                put(payload)
            while received:
                taken += len(received.popleft().payload.to_bytes())

    spent = timed(work)
    session.close()
    assert taken == count // _BATCH * _BATCH * len(payload)
    return spent


def written(n: int, ticks: int, path: Path) -> Found:
    """Write ticks that are there already, as runs hand them to the recording's writer."""
    made = ticks_of(n, ticks)
    columns = as_columns(n, made)
    spent = timed(lambda: ours_of_columns(path, n, columns))
    return {**spent, "messages": sum(map(len, made))}
