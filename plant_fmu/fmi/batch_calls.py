"""A round asks every instance of an FMU the same, in the order of their rows.

The first call that answers worse than a warning ends it: after fmi3Fatal no instance may be called
(FMI 3.0, section 2.3). There are two ways to go through a round, to the same bits: one call after
another from Python, which is here, and all of them by one call of native code.
"""

from collections.abc import Callable, Iterable, Sequence
from ctypes import byref, c_void_p, sizeof
from typing import Any, NamedTuple, Protocol

from nrs_cosim.plant_fmu.archives.quantities import View
from nrs_cosim.plant_fmu.fmi.calls import Calls, bind_states, bind_step, c_references, is_fine
from nrs_cosim.plant_fmu.fmi.library import Library


class EarlyEnd(NamedTuple):
    """The call that ended a round before its time."""

    row: int
    status: int
    stepping: bool = False
    """Whether it was a step."""


Round = Callable[[], EarlyEnd | None]
Step = Callable[[float, float], EarlyEnd | None]
"""From a time by a step, in s."""


class Rounds(Protocol):
    """What can be asked of all instances; see `NativeRounds` too."""

    def exchange(self, view: View, *, setting: bool) -> Round:
        """Return the round in which they set, or get, their rows of a view's numbers."""

    def advance(self, view: View) -> Step:
        """Return the round in which each steps, and gets its row of a view's numbers."""

    def recall(self, states: Any, *, keeping: bool) -> Round:
        """Return the round in which they keep, or go back to, states: a C array of a `void *`."""

    def use_threads(self, count: int) -> None:
        """Step with so many threads from now on, where that can be, to the same bits."""


class CalledRounds:
    """Rounds of calls from Python."""

    def __init__(self, library: Library, handles: Sequence[int]) -> None:
        self._library, self._handles = library, handles

    def use_threads(self, count: int) -> None:
        """Step with this thread: no two can make calls from Python at a time."""

    def exchange(self, view: View, *, setting: bool) -> Round:
        """Return a round of setting or getting; see `Rounds`."""
        calls = self._library.calls
        call, rows = calls.set if setting else calls.get, self._rows(view)
        return lambda: _ended(call(*row) for row in rows)

    def advance(self, view: View) -> Step:
        """Return a round of steps; see `Rounds`."""
        get, rows = self._library.calls.get, self._rows(view)
        do_step = self._library.bind(bind_step).step

        def advance(start: float, step: float) -> EarlyEnd | None:
            for row, arguments in enumerate(rows):
                status = do_step(arguments[0], start, step)
                if not is_fine(status):
                    return EarlyEnd(row, status, stepping=True)
                status = get(*arguments)
                if not is_fine(status):
                    return EarlyEnd(row, status)
            return None

        return advance

    def recall(self, states: Any, *, keeping: bool) -> Round:
        """Return a round of keeping or going back; see `Rounds`."""
        calls, handles = self._library.bind(bind_states), self._handles
        if not keeping:
            return lambda: _ended(map(calls.set, handles, states))
        places = [place(states, row) for row in range(len(handles))]
        return lambda: _ended(map(calls.get, handles, places))

    def _rows(self, view: View) -> list[tuple[Any, ...]]:
        calls, which = self._library.calls, c_references(view.references)
        return [
            arguments(calls, handle, which, view, row) for row, handle in enumerate(self._handles)
        ]


def arguments(calls: Calls, handle: int, which: Any, view: View, at: int) -> tuple[Any, ...]:
    """Return what `get` and `set` are told of an instance, and of a row of a view's numbers."""
    # The address does not keep the array: whoever calls with it keeps the view.
    address = view.theirs.ctypes.data + at * view.theirs.strides[0]
    count = (view.theirs.shape[1],) if calls.counts_values else ()
    return handle, which, len(which), c_void_p(address), *count


def place(states: Any, row: int) -> Any:
    """Return the address of one of the states that `recall` has."""
    return byref(states, row * sizeof(c_void_p))


def _ended(statuses: Iterable[int]) -> EarlyEnd | None:
    for row, status in enumerate(statuses):
        if not is_fine(status):
            return EarlyEnd(row, status)
    return None
