"""What a study costs, by a few of its points that are run: s = s_0 + c · ticks.

The first of them takes all that is done once in a process, as modules, FMUs and theory that points
share: c is of the others, and s_0 is what the first takes more than c times its ticks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from nrs_cosim.orchestrator.engine.recording_size import BYTES


@dataclass(frozen=True, slots=True)
class TimedPoint:
    """A point that was run: processor time, s, the ticks that it has, and messages."""

    seconds: float
    ticks: int
    messages: int


def estimated_cost(timed: Sequence[TimedPoint], ticks: float) -> tuple[float, float]:
    """Return the time, s, and the size, bytes, of so many ticks by points in the order of runs.

    Of one point alone nothing is known but that it is as the others; of none, nothing is to be run.
    """
    if not timed:
        return 0.0, 0.0
    first, others = timed[0], timed[1:] or timed
    a_tick = sum(one.seconds for one in others) / sum(one.ticks for one in others)
    start = max(0.0, first.seconds - a_tick * first.ticks)
    messages = sum(one.messages for one in timed) / sum(one.ticks for one in timed)
    return start + a_tick * ticks, BYTES * messages * ticks


def time_left(
    reached: Sequence[tuple[float, int]], now: float, ticks: int, ticks_left: int
) -> float:
    """Return how long the rest takes, s, at the pace since the first point was done.

    `reached` has the time, s, and the ticks at the beginning, and then at the first point's end.
    Until a second is done, that is the only pace there is.
    """
    since, had = next(mark for mark in reversed(reached) if mark[1] < ticks)
    return (now - since) * ticks_left / (ticks - had)
