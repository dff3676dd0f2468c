"""What a link did to a sample, in words, for whoever reads logs."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.plurals import count_of

_FIELDS = ("robot", "source", "lost", "outage", "delay", "duplicates")


def described(
    events: NDArray[np.void],
) -> tuple[list[tuple[int, bool, str]], NDArray[np.intp]]:
    """Return what is said of link events (rows,), each once, and which is said of each row.

    It is of a robot, whether a sample did not come, and the words.
    """
    there = events.dtype.names or ()
    said = np.stack(
        [events[name] if name in there else np.zeros(len(events), "u4") for name in _FIELDS],
        axis=1,
    )
    kinds, which = np.unique(said, axis=0, return_inverse=True)
    return [*_words(kinds)], which.reshape(-1)


def _words(kinds: NDArray[np.integer]) -> Iterator[tuple[int, bool, str]]:
    for robot, source, lost, outage, delay, duplicates in kinds.tolist():
        met = [
            *(["lost"] if lost else []),
            *(["in an outage"] if outage else []),
            *([f"late by {count_of(delay, 'sampling period')}"] if delay else []),
            *([f"{count_of(duplicates, 'duplicate')}"] if duplicates else []),
        ]
        whose = f"robot {source}" if source else "the target"
        words = f"sample of {whose}: {', '.join(met) or 'altered'}"
        yield robot, bool(lost or outage), "in an outage" if robot == source else words
