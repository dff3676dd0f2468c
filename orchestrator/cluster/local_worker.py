"""A worker process on this machine, as the orchestrator starts, watches and ends it."""

import os
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from nrs_cosim.bus.errors import RunError
from nrs_cosim.orchestrator.cluster.worker_state import STARTING_UP
from nrs_cosim.orchestrator.logs import are_logs_asked
from nrs_cosim.plant_fmu.processes import (
    describe_ending,
    end_group,
    last_words,
    printed_tail,
    start_python,
    wait_group,
)


class LocalWorker:
    """A process of this machine that runs `orchestrator.cluster.worker_main` for some robots."""

    def __init__(
        self, name: str, robots: Sequence[int], endpoint: str, folder: Path, threads: int
    ) -> None:
        """Start it; it will join over an endpoint. What it prints is kept in a folder.

        What it logs goes where this process logs, for a user reads that while the run goes on.
        """
        self.name = name
        self._printed = folder / f"{name}.txt"
        temporary = folder / name  # what it leaves when it is killed goes with the run's folder
        temporary.mkdir(exist_ok=True)
        command = ["--connect", endpoint, "--name", name, "--robots", ",".join(map(str, robots))]
        command += ["--wait", f"{STARTING_UP:g}", "--threads", str(threads)]
        try:
            with ExitStack() as stack:
                printed, logs = stack.enter_context(self._printed.open("wb")), list[int]()
                if are_logs_asked():
                    logs.append(os.dup(2))  # the worker's own standard error is the file
                    stack.callback(os.close, logs[0])
                    command += ["--log-to", str(logs[0])]
                self._process = start_python(
                    "nrs_cosim.orchestrator.cluster.worker_main",
                    *command,
                    stdout=printed,
                    stderr=printed,
                    temporary=temporary,
                    pass_fds=logs,
                )
        except OSError as error:
            raise RunError(f"worker {name} cannot be started: {error.strerror}") from None

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    def ending(self) -> str | None:
        """Return how it ended, with the last that it printed; None while it runs."""
        status = wait_group(self._process)
        return None if status is None else f"{describe_ending(status)}{self.last_words()}"

    def kill(self) -> str:
        """End it, whatever it does; return how it ended."""
        return f"{describe_ending(end_group(self._process))}{self.last_words()}"

    def wait(self, seconds: float) -> None:
        """Wait for its end, for which it was told the reason; kill it when it takes too long."""
        wait_group(self._process, seconds)
        end_group(self._process)

    def last_words(self) -> str:
        """Return the last that it printed, as the end of a sentence; nothing when it did not."""
        return last_words(printed_tail(self._printed))
