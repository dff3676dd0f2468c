"""A message says whose it is, of which tick and time; its topic, sequence and log time say it too.

Checksums tell that a file is as its writer left it, not that the writer was a run. So what both
say must be the same, and a node has one message of a kind at a time; a link alone may have done
something to several samples at once.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.messages import HEADER
from nrs_cosim.bus.topics import Topics
from nrs_cosim.recordings.mcap.columns import Columns, rows_at
from nrs_cosim.recordings.mcap.container import DamageError

_HEADER = np.dtype(
    {
        "names": ["robot", "k", "time_ns"],
        "formats": ["<u4", "<u4", "<u8"],
        "offsets": [1, 6, 11],
        "itemsize": HEADER.size,
    }
)
"""`HEADER` as columns."""
_SOURCE = HEADER.size + 1
"""Where a link event has its source, behind the field's tag."""


_KINDS = ("sample", "state", "agent_state", "measurement", "link_event", "checkpoint")


class Contents:
    """What the messages of a run of n robots must say of themselves."""

    def __init__(self, topics: Mapping[int, str], n: int) -> None:
        """Know the topics by the numbers of their channels; those of no run are let pass."""
        self._topics, self._n = topics, n
        numbers = {topic: number for number, topic in topics.items()}
        many = max(topics, default=0) + 1
        self._first, self._last = np.full((2, many), -1, np.int64)
        """Of each channel the nodes whose messages are on it."""
        self._is_event = np.zeros(many, bool)
        names = Topics.among(numbers, n)
        for kind in _KINDS:
            for topic, nodes in names.each(kind, range(n + 1)):
                if (number := numbers.get(topic)) is not None:
                    self._first[number], self._last[number] = nodes[0], nodes[-1]
                    self._is_event[number] = kind == "link_event"

    def expect(self, messages: Columns) -> None:
        """Raise DamageError where messages, in total order, are not what their channels are for."""
        ours = messages.only(self._first[messages.channel] >= 0)
        event = self._is_event[ours.channel]
        least = np.where(event, _SOURCE + 4, HEADER.size)
        self._expect(ours, ours.stop - ours.start >= least, "it is cut")
        said = rows_at(ours.data, ours.start, HEADER.size).view(_HEADER)
        robot = said["robot"]
        of = np.clip(robot, self._first[ours.channel], self._last[ours.channel])
        for name, expected in (("robot", of), ("k", ours.sequence), ("time_ns", ours.time)):
            self._expect(ours, said[name] == expected, name, said[name], expected)
        keys = ours.channel, ours.time, robot
        again = np.logical_and.reduce([key[1:] == key[:-1] for key in keys])
        self._expect(ours, np.append(True, ~again)[: len(event)] | event, "it is there twice")
        events = ours.only(event)
        source = rows_at(events.data, events.start + _SOURCE, 4).view("<u4")
        self._expect(events, source <= self._n, "source", source, np.full(len(source), self._n))

    def _expect(
        self,
        messages: Columns,
        holds: NDArray[np.bool_],
        what: str,
        said: NDArray[Any] | None = None,
        expected: NDArray[Any] | None = None,
    ) -> None:
        """Raise DamageError that names the first message of which something does not hold."""
        if holds.all():
            return
        row = int(np.flatnonzero(~holds)[0])
        if said is not None and expected is not None:
            most = "at most " * (what == "source")
            what = f"its {what} is {said[row]}, expected {most}{expected[row]}"
        topic = self._topics[int(messages.channel[row])]
        at = int(messages.time[row]) / 1e9
        raise DamageError(
            f"a message of {topic} at tick {messages.sequence[row]}, t = {at:g} s: {what}"
        )
