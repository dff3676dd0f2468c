"""Which call an FMU is in, kept in memory that outlives it: how many there were, whose, which.

The law: a call is announced before it is made, so when the process is gone or stuck, what stands
here is the call that did it. The one who makes the calls writes, the one who waits reads.
"""

from collections.abc import Mapping
from ctypes import addressof, c_char
from dataclasses import fields, replace
from typing import Any, cast

from nrs_cosim.plant_fmu.fmi.calls import Call
from nrs_cosim.plant_fmu.fmi.library import Bound

MAKERS = frozenset({"instantiate", "set_typed"})
"""Calls that take no handle: the one makes handles, the other calls."""
SIZE = 64
_COUNT, _WHO, _ACT = slice(0, 8), slice(8, 40), slice(40, SIZE)


class Progress:
    """An announcement in `SIZE` bytes of shared memory, at first of nothing."""

    def __init__(self, memory: memoryview) -> None:
        self._memory = memory
        self._count = memory[_COUNT].cast("Q")

    @property
    def address(self) -> int:
        """Where it stands."""
        return addressof(c_char.from_buffer(self._memory))

    @property
    def calls(self) -> int:
        """How many calls have been announced."""
        return self._count[0]

    @property
    def who(self) -> str:
        """The name of the instance that is called; empty between calls, or when none is there."""
        return _text(self._memory[_WHO])

    @property
    def act(self) -> str:
        """What it is asked to do; empty between calls."""
        return _text(self._memory[_ACT])

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
        memory, number = self._memory, self._count
        what = _field(act.replace("_", " "), _ACT)

        def announced(handle: int, *arguments: Any) -> int:
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
