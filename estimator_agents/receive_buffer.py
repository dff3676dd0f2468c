"""What agents hear over links that have faults: at t_k, the newest of what arrives there.

The sample of t_s, on its way for d periods, arrives at t_{s+d}. Of those that arrive at t_k a link
delivers the one with the largest s, if that is newer than all that the link delivered before.
Where none is delivered, an agent that holds goes by the last one that was, and one that drops goes
without that in-neighbour; so does one that holds, until the first. A link's memory is a few rows of
1 + 2 m numbers, s and the sample's (s = 0: none): what was delivered last, and one row for each of
the longest delay + 1 sampling times at which something under way can arrive.
"""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.links.events import link_events
from nrs_cosim.bus.links.links import Links

Missing = Literal["hold", "drop"]
"""What an agent does without a sample of an in-neighbour."""

POLICIES: tuple[Missing, ...] = get_args(Missing)


class Hearing:
    """The memory of the agents of some robots; F is the number of their links with faults.

    `robots` are all of them, ascending, also those whose in-links have no faults.
    """

    def __init__(self, links: Links, robots: NDArray[np.integer], m: int, missing: Missing) -> None:
        self.links = links
        self.there = np.zeros(len(links.sink), bool)
        """(F,) whether there is a sample to go by, where an edge asks for one."""
        self.link_events = links.codec.blank(np.array([], np.intp))
        """Of the last tick: records of link events, by robot and source."""
        self._robots, self._m, self._drops = robots, m, missing == "drop"
        self._slots = links.longest + 1
        ends = np.cumsum(self._slots + 1)
        self._last = ends - self._slots - 1
        self._cells = np.zeros((int(ends[-1]) if len(ends) else 0, 1 + 2 * m))
        self._starts = np.append(self._last, len(self._cells))

    @property
    def values(self) -> NDArray[np.float64]:
        """(F, 2, m) position and velocity last delivered on each link; zeros where none was."""
        return self._cells[self._last, 1:].reshape(-1, 2, self._m)

    def take(self, k: int, sent: NDArray[np.float64]) -> None:
        """Send the samples of t_k, (F, 2, m), on their way, and deliver what arrives at t_k.

        What is sent by a robot in an outage may be anything.
        """
        outcome = self.links.outcome(k)
        fields = {"position": sent[:, 0], "velocity": sent[:, 1]}
        arriving = self.links.received(k, fields)
        received = np.stack([arriving["position"], arriving["velocity"]], axis=1)
        leaving = np.flatnonzero(~outcome.gone)
        due = self._slot(k + outcome.delay)[leaving]
        self._cells[due, 0] = k
        self._cells[due, 1:] = received[leaving].reshape(len(leaving), 2 * self._m)
        now = self._slot(k)
        newer = self._cells[now, 0] > self._cells[self._last, 0]
        self._cells[self._last[newer]] = self._cells[now[newer]]
        self._cells[now] = 0
        self.there = newer if self._drops else self._cells[self._last, 0] > 0
        self.link_events = link_events(self.links, self._robots, k, outcome, fields, arriving)

    def memory(self, robot: int) -> bytes:
        """Return what one robot remembers, little-endian doubles; nothing without faults."""
        return self._cells[self._span(robot)].astype("<f8").tobytes()

    def recall(self, robot: int, memory: bytes) -> None:
        """Remember what a robot did elsewhere; `InputError` when that is not of its links."""
        cells = self._cells[self._span(robot)]
        if len(memory) != cells.nbytes:
            raise InputError(
                f"the memory of robot {robot} has {len(memory)} bytes, and {cells.nbytes} were "
                f"expected; give one that was kept under the same faults"
            )
        cells[:] = np.frombuffer(memory, "<f8").reshape(cells.shape)

    def _slot(self, arrival: NDArray[np.int64] | int) -> NDArray[np.intp]:
        """Return each link's row for what arrives at a tick, (F,)."""
        slot: NDArray[np.intp] = self._last + 1 + arrival % self._slots
        return slot

    def _span(self, robot: int) -> slice:
        first, end = np.searchsorted(self.links.sink, [robot, robot + 1])
        return slice(self._starts[first], self._starts[end])
