"""Where robots start: at t_0, or at the last checkpoint of all of them that a recording has.

A checkpoint at t_c was taken before the samples of c were received. From there the worker runs on
by the samples that the recording has, to the last tick that it has, and says nothing; its next tick
is new. That is how a worker that died comes back, and how a run is resumed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

AT_ONCE = 64
"""How many ticks of samples a worker that catches up is given at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """Where some robots start."""

    start: int = 0
    recorded: int = -1
    """The last tick that is recorded; −1 for none."""
    checkpoints: Sequence[bytes] = ()
    """At `start`, one a robot; none at t_0."""


def point_of(
    robots: Sequence[int], checkpoints: Mapping[int, tuple[int, bytes]], recorded: int
) -> Point:
    """Return where robots start, from each one's last checkpoint: its tick and its message."""
    ticks = {checkpoints[robot][0] if robot in checkpoints else 0 for robot in robots}
    # Robots go on from one tick: where their last checkpoints are of several, from t_0.
    if ticks == {0} or len(ticks) > 1:
        return Point(0, recorded)
    return Point(ticks.pop(), recorded, [checkpoints[robot][1] for robot in robots])
