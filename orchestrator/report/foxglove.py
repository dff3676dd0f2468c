"""`--foxglove`: a run as it goes on, or a replay, to Foxglove and all that speak its protocol.

The command finds a free port, so that a run waits for nothing. The process serves there once there
is a recording. It says by a line on its standard output that it does, and by others what a user
must know.
"""

import json
import os
import socket
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from threading import Event, Thread
from typing import Any

from nrs_cosim.bus.errors import InputError, MissingExtraError
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.logs import log_as_asked
from nrs_cosim.orchestrator.report.view_process import LISTENS, ViewProcess, file_state
from nrs_cosim.orchestrator.terminal import say
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import TargetAt
from nrs_cosim.recordings.report.server import HOST

_NEEDED = {"foxglove": "foxglove-sdk", "foxglove_schemas_protobuf": "foxglove-schemas-protobuf"}
_BEHIND = (
    "a client of Foxglove's protocol takes messages more slowly than they come, and the oldest "
    "ones are left out for it; the recording has them all"
)


class Foxglove(ViewProcess):
    """A server of a run that is about to begin, or of a recording."""

    def __init__(self, port: int, stay: bool = False) -> None:
        """Serve on a port, 0 for any; with `stay` until Ctrl-C."""
        super().__init__("the Foxglove server", stay)
        self._port = port

    @property
    def address(self) -> str:
        """Where it serves."""
        return f"ws://{HOST}:{self._port}"

    def begin(self, recording: Path, final: Path) -> None:
        """Serve what a run writes into a recording from now on; `InputError` where it cannot."""
        del final  # the file that is open stays the same by another name
        self._serve({"recording": str(recording), "before": file_state(recording)})
        say("blue", "foxglove", self.address)

    def replay(self, recording: Path, start_ns: int, end_ns: int, speed: float) -> None:
        """Serve a recording, and wait until it is served; `InputError` where it cannot be."""
        times = {"start_ns": start_ns, "end_ns": end_ns, "speed": speed}
        self._serve({"recording": str(recording.absolute()), **times})
        if self.is_served():
            say("blue", "foxglove", self.address)

    def is_served(self) -> bool:
        """Wait until it serves, and return True, or has ended; to be asked once."""
        found = self.process.stdout.readline() if self.process and self.process.stdout else b""
        return found.decode().strip() == LISTENS

    def _serve(self, what: dict[str, Any]) -> None:
        for module, package in _NEEDED.items():
            if find_spec(module) is None:
                raise MissingExtraError(f"--foxglove: needs {package}", "foxglove")
        with socket.socket() as free:
            try:
                free.bind((HOST, self._port))
            except OSError as error:
                raise InputError(f"--port {self._port}: {error.strerror}") from None
            self._port = free.getsockname()[1]
        self.start(
            "nrs_cosim.orchestrator.report.foxglove",
            json.dumps({**what, "port": self._port}),
            stdout=subprocess.PIPE,
        )


def _serve(what: dict[str, Any]) -> None:
    """Serve until standard input ends."""
    from nrs_cosim.recordings.foxglove import live, replay  # noqa: PLC0415, which need an extra
    from nrs_cosim.recordings.foxglove.server import Server  # noqa: PLC0415

    over, behind = Event(), Event()

    def wait_for_the_end() -> None:
        sys.stdin.read()
        over.set()

    def falls_behind() -> None:
        if not behind.is_set():
            behind.set()
            print(_BEHIND)

    Thread(target=wait_for_the_end, daemon=True).start()
    path, port = Path(what["recording"]), what["port"]
    if "speed" in what:
        with Reader(path) as reader:
            played = what["start_ns"], what["end_ns"]
            player = replay.Player(reader, *played, what["speed"])
            with Server(
                reader,
                port,
                target_at=_target_at(reader),
                played=played,
                control=player.control,
                falls_behind=falls_behind,
            ) as server:
                print(LISTENS)
                player.serve(server, over)
    elif growing := live.head_of(path, lambda: file_state(path) not in ("", what["before"]), over):
        target_at = _target_at(growing)
        with (
            growing,
            Server(growing, port, target_at=target_at, falls_behind=falls_behind) as server,
        ):
            print(LISTENS)
            live.follow(growing, server, over, lambda: server.has_listeners)


def _target_at(reader: Reader) -> TargetAt | None:
    """Return where the target is at any time; None where this machine cannot say."""
    try:
        return experiment_of(reader).target_at
    except (InputError, UnreadableError):
        return None


def main() -> None:
    """Serve what the command line names."""
    log_as_asked()
    os.nice(10)  # the run goes first
    try:
        _serve(json.loads(sys.argv[1]))
    except OSError as error:
        sys.exit(str(error))
    os._exit(0)  # at once, whatever clients have not taken yet
