"""How fast simulated time may pass: as fast as the machine allows, or X times as fast as wall time.

The pace decides when a tick is closed and nothing else, so a run is the same bits at any pace.
"""

from collections.abc import Callable
from time import monotonic, sleep
from typing import Protocol

from nrs_cosim.bus.clock import seconds

_PATIENCE = 0.1
"""s: how long nobody asks whether the run is to end."""


class Pace(Protocol):
    """What a tick waits for before it is closed."""

    @property
    def asked(self) -> float:
        """Simulated over wall time that is asked for; 0 for as fast as the machine allows."""

    def start(self, time_ns: int) -> None:
        """Let simulated time begin to pass at a time, ns."""

    def wait(self, time_ns: int, ask: Callable[[], object]) -> None:
        """Return when a time, ns, may be reached; `ask` is called until then, and may raise."""


class AtOnce:
    """Never waits."""

    asked = 0.0

    def start(self, time_ns: int) -> None:
        """Begin."""

    def wait(self, time_ns: int, ask: Callable[[], object]) -> None:
        """Return at once."""


NO_PACE: Pace = AtOnce()


class RealTime:
    """Simulated time passes at most `factor` times as fast as wall time."""

    def __init__(
        self,
        factor: float,
        now: Callable[[], float] = monotonic,
        pause: Callable[[float], None] = sleep,
    ) -> None:
        self.asked, self._now, self._pause = factor, now, pause
        self._origin = 0.0

    def start(self, time_ns: int) -> None:
        """Let t / X of wall time be over now."""
        self._origin = self._now() - seconds(time_ns) / self.asked

    def wait(self, time_ns: int, ask: Callable[[], object]) -> None:
        """Return when t / X of wall time is over."""
        due = self._origin + seconds(time_ns) / self.asked
        while (left := due - self._now()) > 0:
            self._pause(min(left, _PATIENCE))
            ask()
