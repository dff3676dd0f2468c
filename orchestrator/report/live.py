"""`nrs run --live`: the run's page, from its growing recording, by a process of its own.

So the run neither waits for a page nor shares its interpreter with one. The command listens, and
the process takes that over, so that the address is known at once; it ends when its standard input
does, and so never outlives the command.
"""

import json
import os
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import Self

import typer

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.exit_status import INTERRUPTED
from nrs_cosim.orchestrator.logs import are_logs_asked, log_as_asked
from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.orchestrator.terminal import say
from nrs_cosim.plant_fmu.processes import describe_ending, last_words, start_python
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.report.page import expect_plotly, page_data
from nrs_cosim.recordings.report.server import HOST, LiveServer

_LINGER = 3.0
"""s: how long a page that is open may take to ask for the end of a run."""


class Live:
    """The page of a run that is about to begin; a context manager that ends it."""

    def __init__(self, port: int, stay: bool) -> None:
        """Serve on a port, 0 for any; with `stay` until Ctrl-C."""
        self._port, self._stay = port, stay
        self._server: subprocess.Popen[bytes] | None = None

    def begin(self, recording: Path, final: Path) -> None:
        """Serve what a run writes into a recording from now on, whatever its name is at the end.

        `InputError` where it cannot.
        """
        expect_plotly()
        with socket.socket() as listening:
            try:
                listening.bind((HOST, self._port))
            except OSError as error:
                raise InputError(f"--port {self._port}: {error.strerror}") from None
            listening.listen()
            self._server = start_python(
                "nrs_cosim.orchestrator.report.live",
                str(recording),
                str(final),
                str(listening.fileno()),
                _state(recording),
                stdin=subprocess.PIPE,
                stderr=None if are_logs_asked() else subprocess.PIPE,
                pass_fds=[listening.fileno()],
            )
            say("blue", "live", f"http://{HOST}:{listening.getsockname()[1]}/")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if self._server is None:
            return
        ended_by_itself = isinstance(error, typer.Exit) and error.exit_code != INTERRUPTED
        if self._stay and ended_by_itself:
            say("blue", "live", "the page stays until Ctrl-C")
            with suppress(KeyboardInterrupt):
                self._server.wait()
        _, printed = self._server.communicate()
        if status := self._server.returncode:
            words = f"{describe_ending(status)}{last_words(printed or b'')}"
            say("yellow", "warning", f"the process of the page {words}; the recording is whole")


def _state(recording: Path) -> str:
    """Name the state of a file."""
    try:
        stat = recording.stat()
    except OSError:
        return ""
    return f"{stat.st_size}-{stat.st_mtime_ns}"


def serve(recording: Path, final: Path, listening: socket.socket, before: str) -> None:
    """Serve a recording whose state is no more the one before, until standard input ends."""

    def current() -> Path:
        """What is to replace another recording has its name once it is complete."""
        return recording if recording.exists() else final

    def version() -> str:
        state = _state(current())
        return "" if state == before else state

    def tell() -> bytes | None:
        try:
            with Reader(current()) as reader:
                return json.dumps(page_data([story_of(reader)]), allow_nan=False).encode()
        except UnreadableError:
            return None

    with LiveServer(listening, version, tell) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        sys.stdin.read()
        server.linger(_LINGER)


def main() -> None:
    """Serve what the command line names."""
    log_as_asked()
    os.nice(10)  # the run goes first
    serve(Path(sys.argv[1]), Path(sys.argv[2]), socket.socket(fileno=int(sys.argv[3])), sys.argv[4])
