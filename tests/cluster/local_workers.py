"""Runs on workers of this machine, into which a test looks and reaches at a chosen tick."""

import os
import select
import signal
from collections import defaultdict
from pathlib import Path

from nrs_cosim.orchestrator.cluster.launcher import local_workers
from nrs_cosim.orchestrator.cluster.supervision import WorkerPolicy
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.mcap.reader import Reader
from tests.guard import GUARD
from tests.scenarios import SCENARIOS, example, paper, tables

CHECKPOINTS = {"run.checkpoint_every": 20}


def lossy(*changes, folder=SCENARIOS):
    """Return thirty seconds in which agents' memories matter, with checkpoints."""
    return example("paper_lossy_links", CHECKPOINTS, *changes, folder=folder)


def switching(duration=30.0):
    """Return switching networks, with the same faults and checkpoints, for some seconds."""
    faults = {"faults": tables(base="paper_lossy_links")["faults"]}
    return example("switching", CHECKPOINTS, faults, {"run.duration": duration})


def mixed(duration=2.0):
    """Return robots whose plants are driven in five ways, told five times a sampling period."""
    own = {
        2: {"solver": "rk4", "step": 0.002},
        5: {"control": "hold", "control_step": 0.002},
        6: {"control": "heun"},
    }
    return paper(
        {
            "run.duration": duration,
            "run.checkpoint_every": 5,
            "plant.solver": "cvode",
            "plant.rtol": 1e-10,
            "robots": [
                {"id": robot, "plant": {"fmu": "two_link_arm", **plant}}
                for robot, plant in own.items()
            ],
        }
    )


WORKER = "nrs_cosim.orchestrator.cluster.worker_main"


def workers_of(parent=None):
    """Return the processes of the workers that a process has, by name, as the kernel tells it."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat = (folder / "stat").read_text()
            words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")
        except OSError:
            continue
        state, ppid = stat.rpartition(")")[2].split()[:2]
        if int(ppid) == (parent or os.getpid()) and state != "Z" and WORKER in words:
            found[words[words.index("--name") + 1]] = int(folder.name)
    return found


def expect_ended(pids):
    """Wait for the end of processes, which may be nobody's children any more."""
    for pid in pids:
        try:
            handle = os.pidfd_open(pid)
        except ProcessLookupError:
            continue
        assert select.select([handle], [], [], GUARD)[0], f"process {pid} is still there"
        os.close(handle)


class LocalRun:
    """A run on workers of this machine, in which something is done when a tick closes.

    `said` is what the user was told of workers, `coordinator` the workers as the run sees them;
    `look` is called whenever the run looks around, with the time that it has reached.
    """

    def __init__(self, file, workers, *, restart=True, wait=GUARD):
        self.said, self.coordinator = [], None
        self.look = lambda _time: None
        self._file, self._clock = file, file.clock
        self._todo = defaultdict(list)
        self._signalled = set()
        self._launch = local_workers(file, workers, WorkerPolicy(restart, wait, self.said.append))

    def at(self, k, act):
        """Do something as soon as tick k is closed; 0 is before the first."""
        self._todo[k].append(act)
        return self

    def kill(self, k, *numbers, by=signal.SIGKILL):
        """Send workers a signal once tick k is closed and they are there, each process once."""

        def act():
            alive = {name: pid for name, pid in workers_of().items() if pid not in self._signalled}
            if {f"local-{number}" for number in numbers} <= alive.keys():
                for number in numbers:
                    self._signalled.add(alive[f"local-{number}"])
                    os.kill(alive[f"local-{number}"], by)
            else:
                self.at(k, act)

        return self.at(k, act)

    def run(self, path, **options):
        """Run it all, and return the outcome."""
        return run(self._file, path, self._launched, watch=self._watch, **options)

    def _launched(self, *arguments):
        bus, self.coordinator = self._launch(*arguments)
        return bus, self.coordinator

    def _watch(self, time_ns):
        self.look(time_ns)
        for k in sorted(k for k in self._todo if self._clock.t(k) <= time_ns):
            for act in self._todo.pop(k):
                act()


def digest(path):
    """Return the digest of what a recording holds; it must be undamaged."""
    with Reader(path, verify=True) as reader:
        assert reader.damage == []
        return reader.digest


def story(path):
    """Return all messages of a recording but the checkpoints, in order."""
    with Reader(path) as reader:
        return [m for m in reader.messages() if not m[1].endswith("/checkpoint")]
