"""Where a replay is: simulated time passes in proportion to the wall's, as long as it plays.

                 play              pause
    PAUSED    →  PLAYING           PAUSED
    PLAYING   →  PLAYING           PAUSED
    ENDED     →  ENDED             ENDED        as long as no time is sought

Seeking goes first, to any time that there is, and pauses what had ended. A request for a speed that
is none changes no speed.
"""

from dataclasses import dataclass, replace
from enum import Enum
from math import isfinite
from typing import Literal

from nrs_cosim.bus.clock import NS_PER_S

SLOWEST, FASTEST = 1e-3, 1e6
Command = Literal["play", "pause"]


class Status(Enum):
    """What a replay does."""

    PAUSED = "paused"
    PLAYING = "playing"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class Playback:
    """A replay of start_ns <= time <= end_ns, which was at `at_ns` when the wall had `since`.

    Times of the wall are in s, of any one clock that never goes back.
    """

    start_ns: int
    end_ns: int
    speed: float
    """Simulated over wall time."""
    at_ns: int
    since: float = 0.0
    status: Status = Status.PAUSED

    @classmethod
    def over(cls, start_ns: int, end_ns: int, speed: float) -> "Playback":
        """Return a replay that has not begun."""
        return cls(start_ns, end_ns, speed, start_ns)

    def position(self, wall: float) -> int:
        """Return the time that is shown, ns."""
        if self.status is not Status.PLAYING:
            return self.at_ns
        passed = (wall - self.since) * self.speed * NS_PER_S
        return min(self.at_ns + round(passed), self.end_ns)

    def requested(
        self, command: Command, speed: float, seek_ns: int | None, wall: float
    ) -> "Playback":
        """Return what becomes of it by a request."""
        at, status = self.position(wall), self.status
        if seek_ns is not None:
            at = max(self.start_ns, min(seek_ns, self.end_ns))
            status = Status.PAUSED if status is Status.ENDED else status
        if status is not Status.ENDED:
            status = Status.PLAYING if command == "play" else Status.PAUSED
        is_one = isfinite(speed) and speed > 0
        speed = max(SLOWEST, min(speed, FASTEST)) if is_one else self.speed
        return replace(self, at_ns=at, since=wall, speed=speed, status=status)

    def ended(self) -> "Playback":
        """Return what it is when all is shown."""
        return replace(self, at_ns=self.end_ns, status=Status.ENDED)

    def seconds_until(self, time_ns: int, wall: float) -> float:
        """Return how long, by the wall's time, until a time is due as it plays; 0 once it is."""
        passed = (wall - self.since) * self.speed
        return max(0.0, ((time_ns - self.at_ns) / NS_PER_S - passed) / self.speed)
