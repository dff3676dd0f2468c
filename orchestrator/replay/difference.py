"""The first message that is not the same in two runs, field by field, by the schemas of each."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.keys import kind_of
from nrs_cosim.bus.messages import HEADER, Codec
from nrs_cosim.bus.text import quoted
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
