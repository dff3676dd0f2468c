"""Which call an FMU is in, kept in memory that outlives it: how many there were, whose, which.

The law: a call is announced before it is made, so when the process is gone or stuck, what stands
here is the call that did it. The one who makes the calls writes, the one who waits reads. Of
several threads each writes where it alone does, and the one in which the process ends says so, if
it still can: where none did, it was one of those that are in a call.
"""

from collections.abc import Mapping
from ctypes import addressof, c_char
from dataclasses import fields, replace
from sys import byteorder
from typing import Any, NamedTuple, cast

from nrs_cosim.plant_fmu.fmi.calls import Call
from nrs_cosim.plant_fmu.fmi.library import Bound

MAKERS = frozenset({"instantiate", "set_typed"})
"""Calls that take no handle: the one makes handles, the other calls."""
SIZE = 80
_COUNT, _WHO, _ACT = slice(0, 8), slice(8, 40), slice(40, 64)
_START, _ENDED = slice(64, 72), slice(72, SIZE)
STEP = "step"
"""What a call that steps an FMU is announced as."""


class Announced(NamedTuple):
    """The last call that a thread announced."""

    calls: int
    """How many it has announced."""
    who: str
    """The name of the instance that is called; empty between calls, or when none is there."""
    act: str
    """What it is asked to do; empty between calls."""
    ended: bool
    """Whether the process ended in it."""
    start: float = 0.0
    """s: of the last step that the thread announced, where it begins."""


class Progress:
    """What threads announce in `SIZE` bytes each of shared memory, at first nothing.

    Calls from Python are announced as the first one's.
    """

    def __init__(self, memory: memoryview) -> None:
        self._threads = [memory[at : at + SIZE] for at in range(0, len(memory), SIZE)]
        self._memory = self._threads[0]
        self._count, self._start = self._memory[_COUNT].cast("Q"), self._memory[_START].cast("d")

    @property
    def addresses(self) -> list[int]:
        """Where each thread announces."""
        return [addressof(c_char.from_buffer(memory)) for memory in self._threads]

    @property
    def last(self) -> list[Announced]:
        """The last call of each thread."""
        return [
            Announced(
                int.from_bytes(memory[_COUNT], byteorder),
                _text(memory[_WHO]),
                _text(memory[_ACT]),
                any(memory[_ENDED]),
                memory[_START].cast("d")[0],
            )
            for memory in self._threads
        ]

    def culprits(self) -> list[Announced]:
        """Return the call in which the process ended, or all that may be it."""
        last = self.last
        return [one for one in last if one.ended] or [one for one in last if one.act]

    def enter(self, who: str, act: str) -> None:
        """Announce one call."""
        self._memory[_WHO], self._memory[_ACT] = _field(who, _WHO), _field(act, _ACT)
        self._count[0] += 1

    def rest(self) -> None:
        """Announce that no call is made for now."""
        self._memory[_WHO], self._memory[_ACT] = _field("", _WHO), _field("", _ACT)

    def announcing(self, calls: Bound, names: Mapping[int, str]) -> Bound:
        """Return a dataclass of calls of a handle so that each announces itself.

        `names` is who has which handle.
        """
        whos, of = _Fields(names), cast(Any, calls)
        typed = getattr(of, "set_typed", None)
        announced: dict[str, Any] = {
            field.name: self._announcing(getattr(calls, field.name), field.name, whos)
            for field in fields(of)
            if callable(getattr(calls, field.name)) and field.name not in MAKERS
        }
        if typed:
            announced["set_typed"] = lambda kind: self._announcing(typed(kind), f"set {kind}", whos)
        return cast(Bound, replace(of, **announced))

    def _announcing(self, call: Call, act: str, whos: Mapping[int, bytes]) -> Call:
        memory, number, start = self._memory, self._count, self._start
        what, steps = _field(act.replace("_", " "), _ACT), act == STEP

        def announced(handle: int, *arguments: Any) -> int:
            if steps:
                start[0] = arguments[0]
            memory[_WHO], memory[_ACT] = whos[handle], what
            number[0] += 1
            return call(handle, *arguments)

        return announced


class _Fields(dict[int, bytes]):
    """Names by handle as they stand in the memory, each made when it is first asked for."""

    def __init__(self, names: Mapping[int, str]) -> None:
        super().__init__()
        self._names = names

    def __missing__(self, handle: int) -> bytes:
        self[handle] = _field(self._names[handle], _WHO)
        return self[handle]


def _field(text: str, where: slice) -> bytes:
    size: int = where.stop - where.start
    return text.encode()[:size].ljust(size, b"\0")


def _text(field: memoryview) -> str:
    return field.tobytes().rstrip(b"\0").decode(errors="replace")
