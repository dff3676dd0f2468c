"""What shows a recording to other programs: a process of its own, which the command starts.

So a run neither waits for who looks nor shares its interpreter with them. The process ends when its
standard input does, and so never outlives the command.
"""

import subprocess
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import Self

import typer

from nrs_cosim.orchestrator.exit_status import INTERRUPTED
from nrs_cosim.orchestrator.logs import are_logs_asked
from nrs_cosim.orchestrator.terminal import say
from nrs_cosim.plant_fmu.processes import describe_ending, last_words, start_python

LISTENS = "listens"
"""The line by which a process says that it can be reached; others are for the user."""


class ViewProcess:
    """A process that serves what is asked for; a context manager that ends it."""

    def __init__(self, what: str, stay: bool) -> None:
        """Call it what it is; with `stay` it serves until Ctrl-C, else as long as the block."""
        self._what, self._stay = what, stay
        self.process: subprocess.Popen[bytes] | None = None

    def start(
        self,
        module: str,
        *arguments: str,
        stdout: int = subprocess.DEVNULL,
        pass_fds: Collection[int] = (),
    ) -> subprocess.Popen[bytes]:
        """Start a module."""
        self.process = start_python(
            module,
            *arguments,
            stdin=subprocess.PIPE,
            stdout=stdout,
            stderr=None if are_logs_asked() else subprocess.PIPE,
            pass_fds=pass_fds,
        )
        return self.process

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if self.process is None:
            return
        ended_by_itself = isinstance(error, typer.Exit) and error.exit_code != INTERRUPTED
        if self._stay and ended_by_itself:
            say("blue", "live", f"{self._what} stays until Ctrl-C")
            self.wait()
        warnings, printed = self.process.communicate()
        for line in (warnings or b"").decode().splitlines():
            if line != LISTENS:
                say("yellow", "warning", line)
        if status := self.process.returncode:
            words = f"{describe_ending(status)}{last_words(printed or b'')}"
            say("yellow", "warning", f"the process of {self._what} {words}; the recording is whole")

    @property
    def has_failed(self) -> bool:
        """Whether it ended otherwise than it was told to."""
        return bool(self.process and self.process.returncode)

    def wait(self) -> None:
        """Wait until Ctrl-C, or until the process ends by itself."""
        if self.process:
            with suppress(KeyboardInterrupt):
                self.process.wait()


def file_state(recording: Path) -> str:
    """Name the state of a file."""
    try:
        stat = recording.stat()
    except OSError:
        return ""
    return f"{stat.st_size}-{stat.st_mtime_ns}"
