"""How far apart what two recordings have of the same robot at the same time is, in little memory.

|a − b| is over all numbers of a field: its maximum, when that was first, and its root mean square.
What is added up is added in the order of time, so that it is the same however the files are cut
into chunks.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.validation import Records
from nrs_cosim.recordings.export.tables import flat

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Distance:
    """How far apart one quantity of one robot is in two recordings, in its unit."""

    robot: int
    quantity: str
    largest: float
    at: float
    """s: when it was largest."""
    rms: float


class Distances:
    """The distances of some fields of n robots, fed with rows in the order of time."""

    def __init__(self, n: int, fields: Sequence[str], prefix: str, curves: int) -> None:
        """Begin without any; of the first `curves` robots all distances are kept.

        `prefix` stands before the names of the fields.
        """
        self.later = False
        """Whether there are any after t = 0."""
        self._fields, self._prefix, self._curves = fields, prefix, curves
        self._count = np.zeros(n + 1, np.int64)
        self._largest = np.full((len(fields), n + 1), -1.0)
        self._at, self._squares = np.zeros((2, len(fields), n + 1))
        self._kept: defaultdict[int, list[Array]] = defaultdict(list)

    def add(self, a: Records, b: Records) -> None:
        """Add those between rows of two tables, each sorted by time, then robot."""
        ours, theirs = _shared(a, b)
        if not len(ours):
            return
        a, b = a[ours], b[theirs]
        robot, t = a["robot"], a["t"]
        self.later |= bool(t[-1] > 0)
        np.add.at(self._count, robot, 1)
        apart = [np.linalg.norm(flat(a[name] - b[name]), axis=1) for name in self._fields]
        for row, of_field in enumerate(apart):
            largest, before = self._largest[row], self._largest[row][robot]
            np.maximum.at(largest, robot, of_field)
            first = np.flatnonzero((of_field == largest[robot]) & (of_field > before))[::-1]
            self._at[row][robot[first]] = t[first]
            np.add.at(self._squares[row], robot, of_field**2)
        for number in np.unique(robot[robot <= self._curves]).tolist():
            self._kept[number].append(np.stack([t, *apart])[:, robot == number])

    def found(self) -> Iterator[Distance]:
        """Yield what they come to, by robot and field."""
        for robot in np.flatnonzero(self._count).tolist():
            rms = np.sqrt(self._squares[:, robot] / self._count[robot])
            for row, name in enumerate(self._fields):
                values = (self._largest[row][robot], self._at[row][robot], rms[row])
                yield Distance(robot, self._prefix + name, *map(float, values))

    def curves(self) -> Iterator[tuple[tuple[int, str], tuple[Array, Array]]]:
        """Yield what was kept: by robot and quantity, times in s and distances."""
        for robot, parts in sorted(self._kept.items()):
            times, *distances = np.concatenate(parts, axis=1)
            for name, apart in zip(self._fields, distances, strict=True):
                yield (robot, self._prefix + name), (times, apart)


def _shared(a: Records, b: Records) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows of two tables that are of the same robot at the same time."""
    times = np.unique(np.concatenate([a["time_ns"], b["time_ns"]]))
    robots = 1 + max(int(table["robot"].max(initial=0)) for table in (a, b))
    one, other = (
        np.searchsorted(times, table["time_ns"]) * robots + table["robot"] for table in (a, b)
    )
    if np.array_equal(one, other):
        every = np.arange(len(one))
        return every, every
    _, ours, theirs = np.intersect1d(one, other, return_indices=True)
    return ours, theirs
