"""A run whose workers come from elsewhere, as a test directs it: step by step, told all it shows.

    with Run(file, folder / "run.mcap", listen=(meet,), pauses=(50,)) as run:
        left = worker("--connect", meet, "--name", "left")
        run.until("paused at tick 50")

The run is in a thread of the test; `python -m tests.cluster.remote_workers` has it in a process of
its own, which prints what the run shows and goes on after a pause by a line of input.
"""

import json
import os
import queue
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Event, Timer
from typing import ClassVar

from nrs_cosim.bus.network.certificates import Tls
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.orchestrator.cluster.launcher import remote_workers
from nrs_cosim.orchestrator.cluster.supervision import WorkerPolicy
from nrs_cosim.orchestrator.cluster.worker_client import JoinOptions, serve
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.orchestrator.scenario.file import Experiment, read_scenario
from nrs_cosim.recordings.mcap.reader import Reader
from tests.guard import GUARD
from tests.scenarios import Changes, write

ROOT = Path(__file__).parents[2]


def paper_file(folder: Path, ticks: int, *changes: Changes) -> Path:
    """Write the paper's example with so many ticks, changed in a few places; return its path."""
    run = {"run.duration": ticks / 10}
    if ticks > 20:
        run["run.checkpoint_every"] = 16
    return write(folder / "paper.toml", run, *changes)


def alone(file: Experiment, folder: Path) -> str:
    """Return the digest of a run in one process."""
    outcome = run(file, folder / "alone.mcap")
    assert outcome.status == "completed", outcome.reason
    return digest_of(outcome.path)


def digest_of(path: Path) -> str:
    """Return the digest of a recording that is closed."""
    with Reader(path) as reader:
        return reader.digest


class Output:
    """Lines as they come."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._coming: queue.SimpleQueue[str | None] = queue.SimpleQueue()

    def take(self, line: str | None) -> None:
        """Take a line; None after the last."""
        self._coming.put(line)

    def until(self, text: str) -> str:
        """Return the next line that has a text."""
        while (line := self._coming.get(timeout=GUARD)) is not None:
            self.lines.append(line)
            if text in line:
                return line
        raise AssertionError(f"{text!r} is not among {self.lines}")

    def all_lines(self) -> list[str]:
        """Return all lines, up to the last."""
        while (line := self._coming.get(timeout=GUARD)) is not None:
            self.lines.append(line)
        self._coming.put(None)
        return self.lines


class OverError(Exception):
    """The test is over."""


class Worker(Output):
    """A worker in a thread of its own."""

    started: ClassVar[list["Worker"]] = []

    def __init__(
        self,
        endpoint: str,
        name: str,
        robots=None,
        run=None,
        wait=GUARD,
        looks=None,
        tls=None,
        **options,
    ) -> None:
        """Join at an endpoint: wait for somebody there, and then look for a run."""
        super().__init__()
        self._over = False
        joining = JoinOptions(name, robots, run, looks or wait, False, True, self._show)
        endpoints = Endpoints(
            connect=(endpoint,), **{"tls": tls, "wait": wait, "insecure_tcp": True} | options
        )

        def whole() -> None:
            try:
                serve(joining, endpoints)
            finally:
                self.take(None)

        pool = ThreadPoolExecutor(1)
        self._whole = pool.submit(whole)
        pool.shutdown(wait=False)
        self.started.append(self)

    def _show(self, text: str) -> None:
        if self._over:
            raise OverError
        self.take(text)

    @classmethod
    def end_all(cls) -> None:
        """End those that are still there, at the next that they have to say."""
        workers, cls.started = cls.started, []
        for worker in workers:
            worker._over = True
        for worker in workers:
            worker._whole.exception(2 * GUARD)

    def end(self) -> None:
        """Wait for its end; raises what it was refused with."""
        self._whole.result(GUARD)


class Run(Output):
    """A run in a thread of its own."""

    def __init__(
        self,
        file: Experiment,
        output: Path,
        pauses=(),
        assignment=None,
        expected=1,
        wait=GUARD,
        restart=True,
        **endpoints,
    ) -> None:
        super().__init__()
        self.go_on, self._over = Event(), False
        clock = file.clock
        at = {clock.t(k): k for k in pauses}

        def watch(time_ns: int) -> None:
            if k := at.pop(time_ns, None):
                self.take(f"paused at tick {k}")
                assert self.go_on.wait(GUARD)
                self.go_on.clear()
            if self._over:
                raise Interrupted

        def whole():
            try:
                ends = Endpoints(
                    **{"workers": assignment or {}, "wait": wait, "insecure_tcp": True} | endpoints
                )
                policy = WorkerPolicy(restart, wait, self.take, expected)
                launch = remote_workers(file, ends, assignment or {}, policy)
                return run(file, output, launch, watch=watch)
            finally:
                self.take(None)

        self._pool = ThreadPoolExecutor(1)
        self._whole = self._pool.submit(whole)

    def __enter__(self) -> "Run":
        return self

    def __exit__(self, kind: type | None, *_: object) -> None:
        self._over = kind is not None
        self.go_on.set()
        self._pool.shutdown()

    def outcome(self):
        """Return how it ended."""
        return self._whole.result(GUARD)

    def digest(self) -> str:
        """Return the digest of the run, which is to be completed."""
        outcome = self.outcome()
        assert outcome.status == "completed", outcome.reason
        return digest_of(outcome.path)


class Command(Output):
    """A process whose lines are read as they come; it is ended with its `with`, or in the end."""

    def __init__(self, *command, environment=None) -> None:
        super().__init__()
        self.process = subprocess.Popen(
            [*map(str, command)],
            env={**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "500", **(environment or {})},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._guard = Timer(2 * GUARD, self.process.kill)
        self._guard.daemon = True
        self._guard.start()
        self._reader = ThreadPoolExecutor(1)
        self._reader.submit(self._read)

    def _read(self) -> None:
        for line in self.process.stdout:
            self.take(line.rstrip())
        self.take(None)

    def say(self) -> None:
        """Give it a line of input."""
        self.process.stdin.write("\n")
        self.process.stdin.flush()

    def kill(self) -> None:
        """End it without warning."""
        self.process.kill()
        self.end()

    def end(self) -> tuple[int, str]:
        """Wait for its end; return its status and all that it printed."""
        status = self.process.wait(GUARD)
        self._guard.cancel()
        self._reader.shutdown()
        self.all_lines()
        for pipe in (self.process.stdin, self.process.stdout):
            pipe.close()
        return status, "\n".join(self.lines)


NRS = (sys.executable, "-u", "-m", "nrs_cosim.orchestrator")
PROCESS = (sys.executable, "-u", "-m", "tests.cluster.remote_workers")


@contextmanager
def commands():
    """Yield a function that starts commands of this project; those that still run end after it."""
    started: list[Command] = []

    def start(*command, environment=None, program=NRS) -> Command:
        started.append(Command(*program, *command, environment=environment))
        return started[-1]

    try:
        yield start
    finally:
        with ExitStack() as stack:
            for command in started:
                stack.callback(command.kill)


def main() -> None:
    """Run as a JSON object says: the arguments of `Run`, with paths as text."""
    arguments = json.loads(sys.argv[1])
    if arguments.get("tls"):
        arguments["tls"] = Tls(*map(Path, arguments["tls"]))
    for name in ("listen", "connect"):
        arguments[name] = tuple(arguments.get(name, ()))
    with Run(
        read_scenario(Path(arguments.pop("file"))), Path(arguments.pop("output")), **arguments
    ) as directed:
        while (line := directed._coming.get()) is not None:
            print(line)
            if line.startswith("paused"):
                sys.stdin.readline()
                directed.go_on.set()
        print(directed.outcome().status, directed.outcome().reason)


if __name__ == "__main__":
    main()
