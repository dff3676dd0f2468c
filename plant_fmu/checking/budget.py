"""A check's own work has a limit: what it did not come to is unknown, and no fault of the FMU's.

The limit is processor time of one stage, so that it does not depend on what else the machine does.
Whoever waits is told each stage as it begins, and from time to time that it goes on.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from time import monotonic, process_time

from nrs_cosim.plant_fmu.errors import FmuError

LIMIT = 20.0
"""s of processor time, of a stage."""
BEAT = 0.5
"""s of real time between two signs of life."""

STARTING, VALIDATING = "starting", "validating its model description"

Tell = Callable[[str], None]
"""Takes what is being checked now."""


def unobserved(stage: str) -> None:
    """Tell nobody of a stage."""


class OverBudgetError(FmuError):
    """A stage was given up, for it took too long."""


class Budget:
    """What a stage may still cost."""

    def __init__(
        self,
        tell: Tell = unobserved,
        beat: Tell = unobserved,
        limit: float = LIMIT,
        clock: Callable[[], float] = process_time,
    ) -> None:
        """Take whom to tell, of signs of life too, a stage's limit in s, and what counts it."""
        self.limit = limit
        self._tell, self._beat, self._clock = tell, beat, clock
        self.begin(STARTING)

    def begin(self, stage: str) -> None:
        """Begin a stage, which may cost as much as any."""
        self._tell(stage)
        self._stage, self._since, self._last_report = stage, self._clock(), monotonic()

    def spend(self) -> None:
        """Note that the FMU came back; `OverBudgetError` where the stage has taken too long."""
        if monotonic() - self._last_report > BEAT:
            self._last_report = monotonic()
            self._beat(self._stage)
        if self._clock() - self._since > self.limit:
            raise OverBudgetError(f"given up after {self.limit:g} s of processor time")


class OutOfTime(BaseException):
    """Python code was stopped, wherever it was; no `except Exception` of its takes that."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise `OutOfTime` after some processor time; in the main thread alone, as signals ask."""
    if current_thread() is not main_thread():
        yield
        return

    def stop(*_: object) -> None:
        raise OutOfTime

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
