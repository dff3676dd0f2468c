"""What agents receive over links with impairments: at t_k, the newest of what arrives there.

The sample of t_s, on its way for d periods, arrives at t_{s+d}. Of those that arrive at t_k a link
delivers the one with the largest s, if that is newer than all that the link delivered before.
Where none is delivered, an agent that holds goes by the last one that was, and one that drops goes
without that in-neighbour; so does one that holds, until the first. A link's memory is a few rows of
numbers, s and then the sample's (s = 0: none): what was delivered last, and one row for each of the
longest delay + 1 sampling times at which something under way can arrive.
"""

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import Fields, Sizes
from nrs_cosim.bus.links.events import link_events
from nrs_cosim.bus.links.links import Links
from nrs_cosim.estimator_agents.algorithm import Missing
from nrs_cosim.estimator_agents.values import Values, flattened, unflattened

Mask = NDArray[np.bool_]


class ReceiveBuffer:
    """The memory of some robots' agents, of F links into them.

    `robots` are all of them, ascending, also those of whose in-links none is here.
    """

    def __init__(
        self,
        links: Links,
        robots: NDArray[np.integer],
        fields: Fields,
        sizes: Sizes,
        missing: Missing,
    ) -> None:
        self.links = links
        self.present = np.zeros(len(links.sink), bool)
        """(F,) whether there is a sample to go by, where an edge asks for one."""
        self.is_new = np.zeros(len(links.sink), bool)
        """(F,) whether one was delivered at the last tick."""
        self.link_events = links.codec.blank(np.array([], np.intp))
        """Of the last tick: records, by robot and source."""
        self._robots, self._fields, self._sizes = robots, fields, sizes
        self._drops = missing == "drop"
        self._slots = links.longest + 1
        ends = np.cumsum(self._slots + 1)
        self._last = ends - self._slots - 1
        width = sum(int(np.prod(field.size(sizes), dtype=int)) for field in fields.values())
        self._cells = np.zeros((int(ends[-1]) if len(ends) else 0, 1 + width))
        self._starts = np.append(self._last, len(self._cells))

    @property
    def samples(self) -> Values:
        """What was delivered last on each link, (F, *shape) by field; zeros where nothing was."""
        return unflattened(self._cells[self._last, 1:], self._fields, self._sizes)

    def age(self, k: int) -> NDArray[np.int64]:
        """Return how many ticks before t_k each of the samples was sent, (F,)."""
        sent: NDArray[np.int64] = self._cells[self._last, 0].astype(np.int64)
        return k - sent

    def take(self, k: int, sent: Values, sends: Mask | None = None, of: Mask | None = None) -> None:
        """Send samples of t_k, (F, *shape), on their way, and deliver what arrives at t_k.

        It is done where the source `sends`, (F,) or None for all, and is in no outage: elsewhere
        `sent` may be anything. Of links that are not `of` these, (F,), nothing is done now.
        """
        outcome = self.links.outcome(k)
        received = self.links.received(k, sent)
        those = np.arange(len(self.present)) if of is None else np.flatnonzero(of)
        leaves = ~outcome.gone if sends is None else ~outcome.gone & sends
        leaving = those[leaves[those]]
        due = self._slot(k + outcome.delay)[leaving]
        self._cells[due, 0] = k
        self._cells[due, 1:] = flattened(Values(received).at(leaving), len(leaving))
        now, last = self._slot(k)[those], self._last[those]
        newer = self._cells[now, 0] > self._cells[last, 0]
        self._cells[last[newer]] = self._cells[now[newer]]
        self._cells[now] = 0
        self.is_new[those] = newer
        self.present[those] = newer if self._drops else self._cells[last, 0] > 0
        self.link_events = link_events(self.links, self._robots, k, outcome, sent, received, sends)

    def memory(self, robot: int) -> bytes:
        """Return what one robot remembers, little-endian doubles; nothing without links."""
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
