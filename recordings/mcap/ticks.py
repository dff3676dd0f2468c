"""The ticks of a recording that follow one another from 0 on: without one there is no going on."""

from collections.abc import Iterator

import numpy as np

from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.reader import Reader


def consecutive(reader: Reader) -> Iterator[Columns]:
    """Yield the messages of the ticks from 0 to the first that is missing, some whole ones each."""
    last = -1
    for messages in reader.columns():
        steps = np.diff(messages.sequence.astype(np.int64), prepend=last)
        wrong = (steps < 0) | (steps > 1)
        wrong[0] |= steps[0] == 0
        here = messages.only(np.cumsum(wrong) == 0)
        if len(here.time):
            yield here
        if wrong.any():
            return
        last = int(messages.sequence[-1])


def ticks(reader: Reader) -> Iterator[Columns]:
    """Yield the same messages a tick at a time."""
    for messages in consecutive(reader):
        edges = np.flatnonzero(np.diff(messages.sequence)) + 1
        for rows in np.split(np.arange(len(messages.time)), edges):
            yield messages.at(rows)
