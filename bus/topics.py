"""Which topic holds whose messages: a robot's own, or, of many robots, those of a thousand.

A recording has room for 65,535 topics. Up to `MOST_ALONE` robots have one of their own each for a
kind of messages, `/robot_7/state`; of more, each topic is of as many robots as it names,
`/robots_1_1000/state`, and which of them a message is of stands in the message. The number of
robots alone decides. What is read is asked by robots, and finds out by the topics that are there.
"""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Self

from nrs_cosim.bus.keys import topic_of

MOST_ALONE = 10_000
"""Of which each may have six kinds of messages."""
TOGETHER = 1_000
_FIRST = re.compile(r"/robots_1_([1-9][0-9]*)/sample")


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of a run of n robots."""

    n: int
    together: int = 1
    """Of how many robots each is, the last one of fewer perhaps; the target's are its own."""

    @classmethod
    def of_run(cls, n: int) -> Self:
        """Return those that a run of n robots has."""
        return cls(n, 1 if n <= MOST_ALONE else max(TOGETHER, -(-n // MOST_ALONE)))

    @classmethod
    def among(cls, topics: Collection[str], n: int) -> Self:
        """Return those that a recording of n robots has, whose topics these are."""
        first = topic_of("sample", 1)
        found = None if first in topics else next(filter(None, map(_FIRST.fullmatch, topics)), None)
        return cls(n, int(found[1])) if found else cls(n)

    @property
    def shared(self) -> int:
        """How many topics all robots' messages of a kind are on."""
        return -(-self.n // self.together)

    def of(self, kind: str, node: int) -> str:
        """Return the topic of a kind of a node's messages; see `bus.keys.topic_of`."""
        if not node or self.together == 1:
            return topic_of(kind, node)
        robots = self.robots(node)
        return f"/robots_{robots[0]}_{robots[-1]}/{kind}"

    def robots(self, node: int) -> range:
        """Return the nodes whose messages a node's are among."""
        if not node:
            return range(1)
        first = node - (node - 1) % self.together
        return range(first, min(first + self.together, self.n + 1))

    def each(self, kind: str, nodes: Sequence[int]) -> Iterator[tuple[str, range]]:
        """Yield the topics of a kind of some nodes' messages, ascending, each with all it is of."""
        last = range(0)
        for node in nodes:
            if node not in last:
                last = self.robots(node)
                yield self.of(kind, node), last

    def all_of(self, kind: str, nodes: Sequence[int]) -> list[str]:
        """Return the topics of a kind of some nodes' messages, ascending."""
        return [topic for topic, _ in self.each(kind, nodes)]
