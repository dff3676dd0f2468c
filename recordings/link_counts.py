"""How many samples met what on links, counted over link events as they come, in any order.

A sample is counted once for each link that it leaves on, as the first of `KINDS` that is true of
it: one that is lost, or in an outage, is not late as well. That a robot was silent is no sample's
event: it is kept apart, by robot, as its first and last tick and how many there were.
"""

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.recordings.export.tables import LINK_EVENTS, robots, rows
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import LinkRecord

KINDS = ("lost", "outage", "late", "duplicated", "altered")
"""What a link may do to a sample: the first that is true; an altered one is noisy, rounded or
a lie."""


def kinds(events: NDArray[np.void]) -> NDArray[np.int64]:
    """Return which of `KINDS` each link event is (rows,)."""
    counts = ("lost", "outage", "delay", "duplicates")
    there = [events[name] > 0 for name in counts if name in (events.dtype.names or ())]
    return np.select(there, range(len(there)), KINDS.index("altered"))


class LinkCounter:
    """Counts the link events of n robots."""

    def __init__(self, n: int) -> None:
        self._met, self._latest = np.zeros(len(KINDS), np.int64), 0
        self._first, self._last = np.full(n + 1, np.iinfo(np.int64).max), np.zeros(n + 1, np.int64)
        self._silent = np.zeros(n + 1, np.int64)

    def take(self, events: NDArray[np.void]) -> None:
        """Take some more link events (rows,)."""
        alone = events["robot"] == events["source"]
        met, silent = events[~alone], events[alone]
        kind = kinds(met)
        self._met += np.bincount(kind, minlength=len(KINDS))
        late = met["delay"][kind == KINDS.index("late")]
        self._latest = max(self._latest, int(late.max(initial=0)))
        np.minimum.at(self._first, silent["robot"], silent["k"].astype(np.int64))
        np.maximum.at(self._last, silent["robot"], silent["k"].astype(np.int64))
        np.add.at(self._silent, silent["robot"], 1)

    def found(self) -> LinkRecord:
        """Return what was counted so far."""
        who = np.flatnonzero(self._silent)
        spans = np.stack([self._first, self._last, self._silent], axis=1)[who].tolist()
        return LinkRecord(
            **dict(zip(KINDS, self._met.tolist(), strict=True)),
            latest=self._latest,
            silent=dict(zip(who.tolist(), map(tuple, spans), strict=True)),
        )


def link_counts(reader: Reader) -> LinkRecord:
    """Count the link events of a recording, in one pass over their topics."""
    counter = LinkCounter(robots(reader))
    for _, events in rows(reader, [LINK_EVENTS]):
        counter.take(events)
    return counter.found()
