"""A worker process on this machine, as the orchestrator starts, watches and ends it."""

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from nrs_cosim.bus.errors import RunError
from nrs_cosim.orchestrator.cluster.worker_state import STARTING_UP

_PRINTED = 2000


class LocalWorker:
    """A process of this machine that runs `orchestrator.cluster.worker_main` for some robots."""

    def __init__(self, name: str, robots: Sequence[int], endpoint: str, folder: Path) -> None:
        """Start it; it will join over an endpoint. What it prints is kept in a folder."""
        self.name = name
        self._printed = folder / f"{name}.txt"
        temporary = folder / name  # what it leaves when it is killed goes with the run's folder
        temporary.mkdir(exist_ok=True)
        command = ["--connect", endpoint, "--name", name, "--robots", ",".join(map(str, robots))]
        command += ["--wait", f"{STARTING_UP:g}", "--parent", str(os.getpid())]
        modules = os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)
        try:
            with self._printed.open("wb") as printed:
                self._process = subprocess.Popen(
                    [
                        sys.executable,
                        "-P",
                        "-m",
                        "nrs_cosim.orchestrator.cluster.worker_main",
                        *command,
                    ],
                    stdin=subprocess.DEVNULL,
                    stdout=printed,
                    stderr=printed,
                    env={**os.environ, "PYTHONPATH": modules, "TMPDIR": str(temporary)},
                    start_new_session=True,
                )
        except OSError as error:
            raise RunError(f"worker {name} cannot be started: {error.strerror}") from None

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    def ending(self) -> str | None:
        """Return how it ended, with the last that it printed; None while it runs."""
        status = self._process.poll()
        return None if status is None else f"{_how(status)}{self.last_words()}"

    def kill(self) -> str:
        """End it, whatever it does; return how it ended."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        return self.ending() or ""

    def wait(self, seconds: float) -> None:
        """Wait for its end, for which it was told the reason; kill it when it takes too long."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        self.kill()

    def last_words(self) -> str:
        """Return the last that it printed, as the end of a sentence; nothing when it did not."""
        with suppress(OSError):
            lines = self._printed.read_text(errors="replace")[-_PRINTED:].splitlines()
            ours = "worker: "  # what it says of itself, as it is said here too
            said = [line.strip() for line in lines if line.strip() and not line.startswith(ours)]
            return f"; it printed: {' / '.join(said[-3:])}" if said else ""
        return ""


def _how(status: int) -> str:
    if status >= 0:
        return f"exited with status {status}"
    names = {number.value: number.name for number in signal.Signals}
    return f"was ended by {names.get(-status, f'signal {-status}')}"
