"""The process in which an FMU that we did not build runs: told what to do, and ended by anyone.

It does as the frames on its standard input say, until they end. It ends with its parent, in
whatever call the FMU is then; and after an error it makes no further call, not even to free the
FMU (FMI 3.0, section 2.3: nothing may be called after fmi3Fatal).
"""

import json
import logging
import os
import pickle
import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from nrs_cosim.bus.errors import CosimError, RunError
from nrs_cosim.bus.framing import joined, parted
from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.drives.stepped import step_by_threads
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.library import Bound, Kind, Library
from nrs_cosim.plant_fmu.isolation.progress import Progress
from nrs_cosim.plant_fmu.isolation.sharing import (
    ADVANCE,
    ADVANCED_BY,
    BAD_FMU,
    BAD_STEP,
    DONE,
    HEAD,
    RESTORE,
    ROBOT,
    SAVE,
    Memory,
    ShareTask,
    envelope,
    send,
)
from nrs_cosim.plant_fmu.processes import follow_parent


class AnnouncedLibrary(Library):
    """A library whose every call is announced before it is made."""

    def __init__(self, progress: Progress, archive: Archive, folder: Path, kind: Kind) -> None:
        self._progress, self._names = progress, dict[int, str]()
        progress.enter("", "loading")
        super().__init__(archive, folder, kind)
        self.progress = progress.addresses

    def bind(self, binder: Callable[[Any, int], Bound]) -> Bound:
        """Return the calls that a binder makes of the library; see `Library`."""
        return self._progress.announcing(super().bind(binder), self._names)

    def instantiate(self, name: str) -> int:
        """Return the handle of a new instance; see `Library`."""
        self._progress.enter(name, "instantiation")
        handle = super().instantiate(name)
        self._names[handle] = name
        return handle


class Share:
    """One worker's rows of the shared memory, and the plants that they mirror."""

    def __init__(self, stack: ExitStack, task: ShareTask) -> None:
        """Open the task's plants; the stack ends them."""
        first, n, workers = task.place
        memory = Memory(task.memory, workers, task.threads, n, len(task.bodies[0].q))
        rows = slice(first, first + len(task.bodies))
        self._reference = memory.reference[:, rows]
        self._state = memory.q[rows], memory.qd[rows], memory.tau[rows]
        self._progress = memory.progress[task.worker]
        library = partial(AnnouncedLibrary, self._progress)
        self._plants = open_plants(
            stack,
            task.archive,
            task.bodies,
            task.names,
            task.driving,
            library,
            task.representatives,
        )
        step_by_threads(self._plants, task.threads)
        self._mirror()

    def description(self) -> bytes:
        """Return what the user is told of the plants, as JSON."""
        plants = self._plants
        names = ("kind", "drive", "why", "checkpointable")
        return json.dumps({name: getattr(plants, name) for name in names}).encode()

    def advance(self, request: bytes) -> bytes:
        """Take the references if they are new, and advance; the answer is in the memory."""
        new, start, step = ADVANCED_BY.unpack(request)
        if new:
            self._plants.hold(*self._reference[:new])
        self._plants.advance(start, step)
        self._mirror()
        return b""

    def save(self, _request: bytes) -> bytes:
        """Return the robots' checkpoints."""
        saved = self._plants.save()
        self._progress.rest()
        return joined(saved)

    def restore(self, request: bytes) -> bytes:
        """Put the robots back to checkpoints."""
        self._plants.restore(parted(request) or [])
        self._mirror()
        return b""

    def _mirror(self) -> None:
        plants = self._plants
        for rows, values in zip(self._state, (plants.q, plants.qd, plants.tau), strict=True):
            rows[:] = values
        self._progress.rest()


def serve(task: ShareTask, requests: BinaryIO, replies: BinaryIO) -> None:
    """Open the plants, then do what each request says; every one of both is answered."""
    with ExitStack() as stack:
        try:
            share = Share(stack, task)
            acts = {ADVANCE: share.advance, SAVE: share.save, RESTORE: share.restore}
            send(replies, envelope(DONE, share.description()))
            while head := requests.read(HEAD.size):
                kind, length = HEAD.unpack(head)
                answer = acts[kind](requests.read(length))
                send(replies, envelope(DONE, answer))
        except CosimError as error:
            kind = BAD_FMU if isinstance(error, FmuError) else BAD_STEP
            robot = (error.cause.robot if isinstance(error, RunError) else None) or 0
            send(replies, envelope(kind, ROBOT.pack(robot) + str(error).encode()))
            os._exit(1)  # without the stack, whose end would call the FMU


def _private_pipes() -> tuple[BinaryIO, BinaryIO]:
    """Keep standard input and output for the frames; what the FMU prints goes to the error's."""
    requests, replies = os.dup(0), os.dup(1)
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)
    return os.fdopen(requests, "rb"), os.fdopen(replies, "wb", buffering=0)


def main() -> None:
    """Run the task that the command line names."""
    (task,) = sys.argv[1:]
    pipes = _private_pipes()
    follow_parent()
    logging.getLogger("nrs").addHandler(logging.NullHandler())  # its parent says it
    serve(pickle.loads(Path(task).read_bytes()), *pipes)
