"""What agents receive over links with impairments: at t_k, the newest of what arrives there.

The sample of t_s, on its way for d periods, arrives at t_{s+d}. Of those that arrive at t_k a link
delivers the one with the largest s, if that is newer than all that the link delivered before.
Where none is delivered, an agent that holds goes by the last one that was, and one that drops goes
without that in-neighbour; so does one that holds, until the first. A link's memory is a few rows of
numbers, s and then the sample's (s = 0: none): what was delivered last, and one row for each of the
longest delay + 1 sampling times at which something under way can arrive.

An algorithm that wants every sample has another memory: `EveryBuffer` delivers all that arrives at
t_k, oldest first, a duplicate beside its first, and keeps nothing of it. A link's memory is then a
row for each of as many t_s: s, the tick of the arrival, how many arrive, and the sample.
"""

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import Fields, Sizes
from nrs_cosim.bus.lies import NOTHING_PRETENDED, Pretended
from nrs_cosim.bus.links.links import LinkOutcome, Links, link_events
from nrs_cosim.estimator_agents.algorithm import Missing
from nrs_cosim.estimator_agents.values import Array, Values, flattened, unflattened

Mask = NDArray[np.bool_]


class LinkMemory:
    """Rows of numbers for each of F links into some robots, and their events of the last tick.

    `robots` are all of them, ascending, also those of whose in-links none is here.
    """

    def __init__(
        self,
        links: Links,
        robots: NDArray[np.integer],
        fields: Fields,
        sizes: Sizes,
        rows: NDArray[np.int64],
        head: int,
    ) -> None:
        """Keep `rows`, (F,), of `head` numbers and a sample's fields for each link."""
        self.links = links
        self.is_new = np.zeros(len(links.sink), bool)
        """(F,) whether a sample was delivered at the last tick."""
        self.link_events = links.codec.blank(np.array([], np.intp))
        """Of the last tick: records, by robot and source."""
        self._robots, self._fields, self._sizes, self._head = robots, fields, sizes, head
        self._starts = np.concatenate([[0], np.cumsum(rows)])
        width = sum(int(np.prod(field.size(sizes), dtype=int)) for field in fields.values())
        self._cells = np.zeros((int(self._starts[-1]), head + width))
        self._first = self._starts[:-1]
        """(F,) the first row of each link."""
        self._rows = self._first
        """(A,) those of the samples that an agent has."""

    @property
    def samples(self) -> Values:
        """What was delivered, (A, *shape) by field; zeros where nothing was."""
        return unflattened(self._cells[self._rows, self._head :], self._fields, self._sizes)

    def age(self, k: int) -> NDArray[np.int64]:
        """Return how many ticks before t_k each of the samples was sent, (A,)."""
        sent: NDArray[np.int64] = self._cells[self._rows, 0].astype(np.int64)
        return k - sent

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

    def _leaving(
        self, k: int, sent: Values, sends: Mask | None, of: Mask | None, pretended: Pretended
    ) -> tuple[LinkOutcome, NDArray[np.intp], NDArray[np.intp], Array]:
        """Return what becomes of samples of t_k, whose turn it is, who of these send, and what."""
        outcome = self.links.outcome(k)
        received = self.links.received(k, sent, pretended)
        those = np.arange(len(self.is_new)) if of is None else np.flatnonzero(of)
        leaves = ~outcome.gone if sends is None else ~outcome.gone & sends
        leaving = those[leaves[those]]
        self.link_events = link_events(self.links, self._robots, k, outcome, sent, received, sends)
        return outcome, those, leaving, flattened(Values(received).at(leaving), len(leaving))

    def _span(self, robot: int) -> slice:
        first, end = np.searchsorted(self.links.sink, [robot, robot + 1])
        return slice(self._starts[first], self._starts[end])


class ReceiveBuffer(LinkMemory):
    """The newest of each link: A is F, in the order of links."""

    def __init__(
        self,
        links: Links,
        robots: NDArray[np.integer],
        fields: Fields,
        sizes: Sizes,
        missing: Missing,
    ) -> None:
        self._slots = links.longest + 1
        super().__init__(links, robots, fields, sizes, self._slots + 1, 1)
        self.present = np.zeros(len(links.sink), bool)
        """(F,) whether there is a sample to go by, where an edge asks for one."""
        self._drops = missing == "drop"

    def take(
        self,
        k: int,
        sent: Values,
        sends: Mask | None = None,
        of: Mask | None = None,
        pretended: Pretended = NOTHING_PRETENDED,
    ) -> None:
        """Send samples of t_k, (F, *shape), on their way, and deliver what arrives at t_k.

        It is done where the source `sends`, (F,) or None for all, and is in no outage: elsewhere
        `sent` may be anything. Of links that are not `of` these, (F,), nothing is done now. `told`
        is what algorithms say at t_k by which robots lie.
        """
        outcome, those, leaving, values = self._leaving(k, sent, sends, of, pretended)
        due = self._slot(k + outcome.delay)[leaving]
        self._cells[due, 0] = k
        self._cells[due, 1:] = values
        now, last = self._slot(k)[those], self._first[those]
        newer = self._cells[now, 0] > self._cells[last, 0]
        self._cells[last[newer]] = self._cells[now[newer]]
        self._cells[now] = 0
        self.is_new[those] = newer
        self.present[those] = newer if self._drops else self._cells[last, 0] > 0

    def _slot(self, arrival: NDArray[np.int64] | int) -> NDArray[np.intp]:
        """Return each link's row for what arrives at a tick, (F,)."""
        slot: NDArray[np.intp] = self._first + 1 + arrival % self._slots
        return slot


class EveryBuffer(LinkMemory):
    """Every sample of each link: A of them arrive at a tick, by link, and the oldest first."""

    def __init__(
        self, links: Links, robots: NDArray[np.integer], fields: Fields, sizes: Sizes
    ) -> None:
        self._slots = links.longest + 1
        super().__init__(links, robots, fields, sizes, self._slots, 3)
        self._link = np.repeat(np.arange(len(self._slots)), self._slots)
        """(C,) the link of each row."""
        self.link = np.zeros(0, np.intp)
        """(A,) the link of each sample that arrived at the last tick."""
        self._rows = np.zeros(0, np.intp)

    def take(
        self,
        k: int,
        sent: Values,
        sends: Mask | None = None,
        of: Mask | None = None,
        pretended: Pretended = NOTHING_PRETENDED,
    ) -> None:
        """Send samples of t_k, (F, *shape), on their way, and deliver all that arrive at t_k.

        The arguments are as those of `ReceiveBuffer`.
        """
        outcome, _, leaving, values = self._leaving(k, sent, sends, of, pretended)
        row = (self._first + k % self._slots)[leaving]
        self._cells[row, 0], self._cells[row, 1] = k, k + outcome.delay[leaving]
        self._cells[row, 2] = 1 + outcome.duplicates[leaving]
        self._cells[row, 3:] = values
        due = np.flatnonzero(self._cells[:, 1] == k)
        due = due[np.lexsort((self._cells[due, 0], self._link[due]))]
        self._rows = np.repeat(due, self._cells[due, 2].astype(np.intp))
        self.link = self._link[self._rows]
        self.is_new = np.bincount(self.link, minlength=len(self._slots)) > 0
