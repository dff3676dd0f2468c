"""An outage [from, to) covers the sampling times with from <= t_k < to."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Spans = tuple[tuple[int, int], ...]
"""Outages: from and to, ns."""

_NEVER = 2**62
"""A tick that no run comes to, and int64 has room for; the end of an outage may be beyond that."""


@dataclass(frozen=True, slots=True, eq=False)
class Outages:
    """When some of many are out, by their numbers."""

    who: NDArray[np.intp]
    """(s,) whom each outage concerns."""
    first: NDArray[np.int64]
    """(s,) the tick from which it lasts."""
    end: NDArray[np.int64]
    """(s,) the tick at which it is over."""

    @classmethod
    def of(cls, spans: Mapping[int, Spans], since: Callable[[int], int]) -> "Outages":
        """Return the outages of those that have any; `since` tells the first tick from a ns on."""
        rows = [
            (who, *(min(since(t), _NEVER) for t in span))
            for who, theirs in spans.items()
            for span in theirs
        ]
        who, first, end = np.array(rows, np.int64).reshape(-1, 3).T
        return cls(who.astype(np.intp), first, end)

    def at(self, k: int) -> NDArray[np.intp]:
        """Return who is out at t_k, each once, ascending: (o,)."""
        if not self.who.size:
            return self.who
        return np.unique(self.who[(self.first <= k) & (k < self.end)])

    def ends_of_run(self, ticks: int) -> NDArray[np.int64]:
        """Return the ends of those that a run of so many ticks meets, (s,) ticks."""
        return self.end[(self.first <= ticks) & (self.first < self.end)]

    def mask(self, k: int, size: int) -> NDArray[np.bool_]:
        """Return whether each of the numbers 0 … size − 1 is out at t_k, (size,)."""
        out = np.zeros(size, bool)
        out[self.at(k)] = True
        return out
