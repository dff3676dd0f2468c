"""Workers of a running run are killed and stopped, at ticks drawn from a seed, and their memory
read.

A blow falls when its tick has closed, from the orchestrator's own thread: SIGKILL, or SIGSTOP and
some seconds later SIGCONT. The workers are the processes that this one has started, known by their
command lines; their peak memory is `VmHWM` of /proc, read as the run goes on. So this is for Linux.
"""

import os
import signal
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import monotonic

import numpy as np

from benchmarks.memory import peak, workers

_LOOK = 0.2
"""s: between two looks at the memory."""


@dataclass(frozen=True, slots=True)
class Blow:
    """What befalls a worker once a tick has closed."""

    tick: int
    worker: str
    stop: float
    """s: how long it is stopped; 0 when it is killed."""


def blows(ticks: int, workers: Sequence[str], kills: int, stop: float, seed: int) -> list[Blow]:
    """Return some kills and one stop in the middle nine tenths of a run, in the order of time."""
    rng = np.random.default_rng([seed, ticks])
    at = rng.choice(np.arange(ticks // 20, ticks - ticks // 20), kills + 1, replace=False)
    whom = rng.choice(len(workers), kills + 1)
    long = [stop] + [0.0] * kills
    dealt = zip(at.tolist(), whom.tolist(), long, strict=True)
    return [Blow(k, workers[worker], seconds) for k, worker, seconds in sorted(dealt)]


class Mischief:
    """Deals blows, and reads memory, as a run's `watch`."""

    def __init__(
        self, dealt: Sequence[Blow], t: Callable[[int], int], again: Callable[[str], None]
    ) -> None:
        """Deal blows in a run with t_k, ns; `again` is told the name of each killed worker."""
        self.done: Counter[str] = Counter()
        """How often each thing was done."""
        self.peaks: Counter[str] = Counter()
        """The most memory, bytes, that any process of a worker had."""
        self._left, self._t, self._again = list(dealt), t, again
        self._looked = 0.0
        self._stopped: dict[int, float] = {}
        """Until when each process is stopped."""

    def watch(self, time_ns: int) -> None:
        """Do what is due."""
        now = monotonic()
        if now - self._looked >= _LOOK:
            self._looked = now
            for name, pid in workers():
                self.peaks[name] = max(self.peaks[name], peak(pid))
        for pid in [pid for pid, until in self._stopped.items() if until <= now]:
            os.kill(pid, signal.SIGCONT)
            del self._stopped[pid]
        while self._left and self._t(self._left[0].tick) <= time_ns:
            if not self._fell(self._left[0]):
                break
            del self._left[0]

    def _fell(self, blow: Blow) -> bool:
        """Deal a blow; return whether its worker was there."""
        for name, pid in workers():
            if name != blow.worker:
                continue
            if blow.stop:
                os.kill(pid, signal.SIGSTOP)
                self._stopped[pid] = monotonic() + blow.stop
                self.done["stopped"] += 1
            else:
                os.kill(pid, signal.SIGKILL)
                self.done["killed"] += 1
                self._again(name)
            return True
        return False
