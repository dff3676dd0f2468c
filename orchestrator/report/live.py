"""`nrs run --live`: the run's page, from its growing recording, by a process of its own.

The command listens, and the process takes that over, so that the address is known at once.
"""

import json
import os
import socket
import sys
from dataclasses import replace
from pathlib import Path
from threading import Thread

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.logs import log_as_asked
from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.orchestrator.report.view_process import ViewProcess, file_state
from nrs_cosim.orchestrator.terminal import say
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.report.page import expect_plotly, page_data
from nrs_cosim.recordings.report.server import HOST, LiveServer

_CLOSE_UP = 60.0
"""s up to now: the longest part of a run that the page shows by itself."""
_LINGER = 3.0
"""s: how long a page that is open may take to ask for the end of a run."""


class Live(ViewProcess):
    """The page of a run that is about to begin."""

    def __init__(self, port: int, stay: bool) -> None:
        """Serve on a port, 0 for any; with `stay` until Ctrl-C."""
        super().__init__("the page", stay)
        self._port = port

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
            self.start(
                "nrs_cosim.orchestrator.report.live",
                str(recording),
                str(final),
                str(listening.fileno()),
                file_state(recording),
                pass_fds=[listening.fileno()],
            )
            say("blue", "live", f"http://{HOST}:{listening.getsockname()[1]}/")


def serve(recording: Path, final: Path, listening: socket.socket, before: str) -> None:
    """Serve a recording whose state is no more the one before, until standard input ends."""

    def current() -> Path:
        """What is to replace another recording has its name once it is complete."""
        return recording if recording.exists() else final

    def version() -> str:
        state = file_state(current())
        return "" if state == before else state

    def tell() -> bytes | None:
        try:
            with Reader(current()) as reader:
                story = replace(story_of(reader), close_up=_CLOSE_UP)
                return json.dumps(page_data([story], live=True), allow_nan=False).encode()
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
