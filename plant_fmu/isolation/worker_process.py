"""A worker as its parent sees it: asked, answered in time, and gone when it is done with.

The deadline is one call's of the FMU: as long as calls follow one another, a worker may take the
time that its robots need.
"""

import os
import select
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Self

from nrs_cosim.bus.errors import Cause
from nrs_cosim.bus.plurals import numbered
from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.errors import FmuError, StepError, before_run
from nrs_cosim.plant_fmu.isolation.progress import STEP, Announced, Progress
from nrs_cosim.plant_fmu.isolation.sharing import BAD_FMU, DONE, HEAD, ROBOT, send
from nrs_cosim.plant_fmu.plants import called
from nrs_cosim.plant_fmu.processes import (
    PRINTED,
    describe_ending,
    end_group,
    last_words,
    start_python,
)

STARTING = 60.0
"""s: the deadline before the FMU's first call: Python starts, and the archive is unpacked."""
LOOKS = 16
"""How often in a deadline it is looked whether a call is over: so much of it may be waited more."""

_TRIAL = "its stability or the error of a held torque was measured"
"""What a step is of that is made before there is a time."""


class StuckError(Exception):
    """Calls did not return in time."""

    def __init__(self, text: str, calls: Sequence[Announced]) -> None:
        super().__init__(text)
        self.calls = calls


class FmuProcess:
    """A process that runs `plant_fmu.isolation.worker`; a context that ends it."""

    def __init__(
        self,
        task: Path,
        progress: Progress,
        deadline: float,
        archive: Archive,
        robots: Sequence[int],
    ) -> None:
        """Start it on a pickled task in a folder where it also keeps its temporary files.

        It has begun to open its plants, which `answer` waits for. `FmuError` when it cannot start.
        """
        self._progress, self._deadline = progress, deadline
        label = archive.label
        self._label, self._needs, self._robots = label, archive.needs, robots
        self._printed = b""
        try:
            self._process = start_python(
                "nrs_cosim.plant_fmu.isolation.worker",
                str(task),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                temporary=task.parent,
            )
        except OSError as error:
            raise FmuError(f"{label}: no worker process can start: {error.strerror}") from None
        stdin, stdout, stderr = self._process.stdin, self._process.stdout, self._process.stderr
        assert stdin is not None
        assert stdout is not None
        assert stderr is not None
        self._pipes = (stdin, stdout, stderr)
        self._replies, self._prints = stdout.fileno(), stderr.fileno()
        self._poll = select.poll()
        for end in (self._replies, self._prints):
            self._poll.register(end, select.POLLIN)
        self._busy = True
        self._since: dict[int, tuple[int, float]] = {}
        """Of each thread that is in a call: its number, and since when that is known."""

    def ask(self, request: bytes) -> None:
        """Send a frame."""
        self._busy = True
        with suppress(BrokenPipeError):  # the answer will tell how it ended
            send(self._pipes[0], request)

    def answer(self, seconds: float | None = None) -> bytes:
        """Wait for what was asked at a time, in s, and return what the answer carries.

        `StepError`, or before there is a time `FmuError`, with the worker's own words, or with the
        robot in whose call the FMU ended the process or did not return within the deadline.
        """
        got = bytearray()
        try:
            while len(got) < HEAD.size or len(got) < HEAD.size + HEAD.unpack_from(got)[1]:
                received = self._receive()
                if not received:
                    ended = describe_ending(self._end())
                    raise self._failure(ended, self._progress.culprits(), seconds)
                got += received
        except StuckError as silence:
            self._end()
            raise self._failure(str(silence), silence.calls, seconds) from None
        self._busy = False
        kind, payload = HEAD.unpack_from(got)[0], bytes(got[HEAD.size :])
        if kind != DONE:
            self._end()
            (robot,), text = ROBOT.unpack_from(payload), payload[ROBOT.size :].decode()
            if kind == BAD_FMU:
                raise FmuError(text)
            raise StepError(text, _cause(robot or None, seconds))
        return payload

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Let an idle worker free its FMUs; kill it when it is in a call or does not end."""
        if self._process.returncode is not None:
            return
        self._pipes[0].close()
        with suppress(StuckError):
            while not self._busy and self._receive():
                pass
        self._end()

    def _receive(self) -> bytes:
        """Return what the worker says next, nothing at its end; `StuckError` when it is stuck.

        It is stuck when as long as the deadline no call followed one that a thread is in, or the
        last one where none is.
        """
        self._since.clear()
        self._stuck()
        while True:
            for end, _ in self._poll.poll(min(self._deadline, STARTING) / LOOKS * 1000):
                if end == self._replies:
                    return os.read(end, 65536)
                if not self._keep(os.read(end, 65536)):
                    self._poll.unregister(end)
            if stuck := self._stuck():
                table = "plant" if self._robots[0] else "target"
                limit, which = self._deadline, f"{table}.deadline"
                if not self._has_called:
                    limit, which = STARTING, "to start"
                raise StuckError(f"did not return within {limit:g} s ({which})", stuck)

    @property
    def _has_called(self) -> bool:
        return any(call.calls for call in self._progress.last)

    def _stuck(self) -> list[Announced]:
        """Return the calls in which threads have been too long."""
        limit, now = self._deadline if self._has_called else STARTING, monotonic()
        last = self._progress.last
        those = [thread for thread, call in enumerate(last) if call.act] or [0]
        since = {thread: (last[thread].calls, now) for thread in those}
        for thread, known in self._since.items():
            if thread in since and known[0] == since[thread][0]:
                since[thread] = known
        self._since = since
        return [last[thread] for thread, (_, when) in since.items() if now - when >= limit]

    def _keep(self, printed: bytes) -> bytes:
        """Keep the end of what the FMU prints, for the error that it may explain; return it all."""
        self._printed = (self._printed + printed)[-PRINTED:]
        return printed

    def _end(self) -> int:
        """Kill what is left of the worker, keep its last words, and return its status."""
        status = end_group(self._process)
        os.set_blocking(self._prints, False)
        with suppress(BlockingIOError):
            while rest := os.read(self._prints, 65536):
                self._keep(rest)
        for pipe in self._pipes:
            pipe.close()
        return status

    def _failure(
        self, ended: str, calls: Sequence[Announced], seconds: float | None
    ) -> FmuError | StepError:
        several = len(self._robots) > 1  # a target is alone
        named = numbered("robot", self._robots) if several else called(self._robots[0])
        who = " or ".join(sorted({call.who for call in calls if call.who})) or named
        what = "the FMU" if self._has_called else "its worker process"
        acts = " or ".join(sorted({call.act for call in calls if call.act}))
        act = f", in {acts}" if acts else ""
        cause = f"{what} {ended}{act}{last_words(self._printed)}"
        if seconds is None:
            needs = self._needs if self._has_called else ""
            trial = before_run(_TRIAL) if any(call.act == STEP for call in calls) else ""
            return FmuError(f"{self._label}: {who}: {cause}{needs}{trial}")
        # Of the steps within what was asked for, the one that did it.
        seconds = min((call.start for call in calls if call.act == STEP), default=seconds)
        only = self._robots[0] if len(self._robots) == 1 else None
        text = f"{who} ({self._label}) at t = {seconds:g} s: {cause}"
        return StepError(text, _cause(only, seconds))


def _cause(robot: int | None, seconds: float | None) -> Cause:
    time_ns = None if seconds is None else round(seconds * 1e9)
    return Cause(StepError.kind, time_ns=time_ns, robot=robot)
