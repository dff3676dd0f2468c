"""The first message that is not the same in two runs, field by field, by the schemas of each."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.keys import kind_of
from nrs_cosim.bus.messages import HEADER, Codec
from nrs_cosim.bus.text import quoted
from nrs_cosim.recordings.mcap.columns import MANY, Columns, rows_at
from nrs_cosim.recordings.mcap.container import Message as Recorded

ABSENT, PRESENT = "absent", "present"


@dataclass(frozen=True, slots=True)
class Difference:
    """The first message that is not what it was."""

    k: int
    t: float
    """s"""
    topic: str
    robot: int
    field: str
    recorded: Any
    replayed: Any

    def between(self, one: str, other: str) -> str:
        """Return it as a sentence on two recordings."""
        values = self.recorded, self.replayed
        if values == (PRESENT, ABSENT):
            seen = f"in {one} and not in {other}"
        elif values == (ABSENT, PRESENT):
            seen = f"in {other} and not in {one}"
        else:
            seen = f"{quoted(self.recorded)} in {one}, {quoted(self.replayed)} in {other}"
        return (
            f"tick {self.k}, t = {self.t:g} s: {self.topic}, {self.field} of robot {self.robot} "
            f"is {seen}"
        )


class Pairs:
    """Finds the first messages that are not the same, both in total order."""

    def __init__(self, a: Mapping[int, str], b: Mapping[int, str]) -> None:
        """Know the topics of both by the numbers of their channels."""
        self._topics = a, b
        names = sorted({*a.values(), *b.values()})
        place = {topic: number for number, topic in enumerate(names)}
        self._place = np.zeros((2, MANY), np.intp)
        for places, topics in zip(self._place, self._topics, strict=True):
            places[[*topics]] = [place[topic] for topic in topics.values()]

    def first(self, a: Columns, b: Columns) -> int | None:
        """Return the first row that is not the same, or one alone has; None where there is none."""
        both = min(len(a.time), len(b.time))
        rows = np.arange(both)
        one, other = a.at(rows), b.at(rows)
        sizes = one.stop - one.start
        same = (one.time == other.time) & (one.sequence == other.sequence)
        same &= self._place[0][one.channel] == self._place[1][other.channel]
        same &= sizes == other.stop - other.start
        for size in np.unique(sizes[same]).tolist():
            here = np.flatnonzero(same & (sizes == size))
            if size:
                mine, theirs = (rows_at(of.data, of.start[here], size) for of in (one, other))
                same[here] = mine == theirs
        differ = np.flatnonzero(~same)
        if len(differ):
            return int(differ[0])
        return both if len(a.time) != len(b.time) else None

    def at(self, a: Columns, b: Columns, row: int) -> list[Recorded | None]:
        """Return the messages of a row, None of one that has ended before."""
        return [
            part.at(np.array([row])).messages(topics)[0] if row < len(part.time) else None
            for part, topics in zip((a, b), self._topics, strict=True)
        ]


def difference_in(
    codecs_was: Mapping[str, Codec],
    codecs_now: Mapping[str, Codec],
    was: Recorded | None,
    now: Recorded | None,
) -> Difference:
    """Return what is not the same of a message, which one of the two may lack.

    The two are coded by the codecs of their kinds.
    """
    if was is None or now is None or _place(was) != _place(now):
        missing = was is None or (now is not None and now < was)
        there = now if missing else was
        assert there is not None
        sides = (ABSENT, PRESENT) if missing else (PRESENT, ABSENT)
        return Difference(*_about(there), "message", *sides)
    old, new = _contents(codecs_was, was), _contents(codecs_now, now)
    for name in {**old, **new}:
        before, after = old.get(name), new.get(name)
        if before is None or after is None or before.tobytes() != after.tobytes():
            values = [ABSENT if value is None else value.tolist() for value in (before, after)]
            return Difference(*_about(was), name, values[0], values[1])
    return Difference(*_about(was), "k", was[2], now[2])


def _contents(codecs: Mapping[str, Codec], message: Recorded) -> dict[str, Any]:
    codec = codecs[kind_of(message[1])]
    record = codec.decode([message[3]])[0]
    return {name: record[name] for _, name, _ in codec.kind.numbered}


def node_of(message: Recorded) -> int:
    """Return whose a message of a run is: the number of a robot, or 0, the target."""
    node: int = HEADER.unpack_from(message[3])[0]
    return node


def _place(message: Recorded) -> tuple[int, str, int]:
    """Return when a message is, on what topic, and whose."""
    return *message[:2], node_of(message)


def _about(message: Recorded) -> tuple[int, float, str, int]:
    time_ns, topic, k, _ = message
    return k, seconds(time_ns), topic, node_of(message)
