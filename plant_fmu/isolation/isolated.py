"""Plants whose FMU runs in processes of its own: its crash is an error that names the robot.

All robots of an FMU share one worker, or have one each where the FMU's tool allows only one
instance a process; these advance at the same time. What a worker does is what this process would
do, to the bit.
"""

import json
import pickle
from collections.abc import Mapping, Sequence
from contextlib import ExitStack

from nrs_cosim.bus.framing import joined, parted
from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.drives.checkpoint import time_of
from nrs_cosim.plant_fmu.drives.choice import Driving, Undriven
from nrs_cosim.plant_fmu.fmi.native.batch_calls import load_native
from nrs_cosim.plant_fmu.folders import own_folder
from nrs_cosim.plant_fmu.isolation.sharing import (
    ADVANCE,
    ADVANCED_BY,
    RESTORE,
    SAVE,
    Memory,
    ShareTask,
    envelope,
)
from nrs_cosim.plant_fmu.isolation.worker_process import FmuProcess
from nrs_cosim.plant_fmu.plants import Array, Body


class IsolatedPlants:
    """Plants in worker processes; see `plant_fmu.plants.DrivenPlants`."""

    def __init__(
        self,
        stack: ExitStack,
        archive: Archive,
        bodies: Sequence[Body],
        names: Mapping[str, Spec],
        driving: Driving | Undriven,
        deadline: float,
        representatives: Sequence[Body] = (),
        threads: int = 1,
    ) -> None:
        """Start the workers, and open one plant for each body; the stack ends them.

        `names` gives the FMU's name for a quantity of ours where it has another. No call of the
        FMU may take longer than the deadline, in s. A worker steps its robots with so many threads.
        `FmuError` says what is wrong, as in `open_plants`, or how the FMU ended its process.
        """
        load_native()  # compiled here, no worker needs its deadline for that
        folder = stack.enter_context(own_folder())
        n, m = len(bodies), len(bodies[0].q)
        size = 1 if archive.once_per_process else n
        firsts = range(0, n, size)
        self._shares = [slice(first, first + size) for first in firsts]
        path = folder / "memory"
        path.touch()
        self._memory = Memory(path, len(firsts), threads, n, m)
        self.q, self.qd, self.tau = self._memory.q, self._memory.qd, self._memory.tau
        self._new, self._time = 0, 0.0
        self._workers = []
        for number, first in enumerate(firsts):
            own = bodies[self._shares[number]]
            task = folder / f"task-{number}"
            place = first, n, len(firsts)
            share_task = ShareTask(
                archive, own, names, driving, path, place, number, threads, representatives
            )
            task.write_bytes(pickle.dumps(share_task))
            worker = FmuProcess(
                task,
                self._memory.progress[number],
                deadline,
                archive,
                [body.robot for body in own],
            )
            self._workers.append(stack.enter_context(worker))
        (opened, *_) = [json.loads(worker.answer()) for worker in self._workers]
        self.kind, self.drive, self.why = opened["kind"], opened["drive"], opened["why"]
        self.checkpointable: bool = opened["checkpointable"]

    def hold(self, *reference: Array) -> None:
        """Take new references (rows, m) from now on."""
        self._new = len(reference)
        self._memory.reference[: self._new] = reference

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s."""
        request = envelope(ADVANCE, ADVANCED_BY.pack(self._new, start, step))
        for worker in self._workers:
            worker.ask(request)
        for worker in self._workers:
            worker.answer(start)
        self._new, self._time = 0, start + step

    def save(self) -> list[bytes]:
        """Return each robot's checkpoint."""
        answers = self._all([envelope(SAVE)] * len(self._workers), self._time)
        return parted(b"".join(answers)) or []

    def restore(self, data: Sequence[bytes]) -> None:
        """Put each robot back to a checkpoint."""
        time = time_of(data, len(self.q))
        self._all([envelope(RESTORE, joined(data[share])) for share in self._shares])
        self._new, self._time = 0, time

    def _all(self, requests: Sequence[bytes], seconds: float | None = None) -> list[bytes]:
        """Ask each its own, all at once; return their answers, as `FmuProcess.answer` has it."""
        for worker, request in zip(self._workers, requests, strict=True):
            worker.ask(request)
        return [worker.answer(seconds) for worker in self._workers]
