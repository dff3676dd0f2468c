"""Rounds by `batch_calls.c`, compiled on first use: the same bits, without Python in between.

It is called without Python's lock, so that other threads of ours go on meanwhile.
"""

import logging
from collections.abc import Mapping, Sequence
from ctypes import (
    CDLL,
    Structure,
    addressof,
    byref,
    c_bool,
    c_double,
    c_int,
    c_size_t,
    c_void_p,
    cast,
    create_string_buffer,
)
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from threading import Thread
from typing import Any
from weakref import finalize

from nrs_cosim.plant_fmu.archives.quantities import View
from nrs_cosim.plant_fmu.bundled.builder import build_library
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.batch_calls import EarlyEnd, Round, Step
from nrs_cosim.plant_fmu.fmi.calls import Call, bind, c_references
from nrs_cosim.plant_fmu.fmi.library import Library

_LOG = logging.getLogger("nrs.plant_fmu")
SOURCES = Path(__file__).with_suffix(".c"), Path(__file__).with_name("crew.h")
WHO = 32
"""Bytes of a name, as batch_calls.c has it."""
_NUMBERS = {"set": ("SetReal", "SetFloat64"), "get": ("GetReal", "GetFloat64")}
_STEPPING = {**_NUMBERS, "step": ("DoStep", "DoStep")}
_STATES = {
    "get_state": ("GetFMUstate", "GetFMUState"),
    "set_state": ("SetFMUstate", "SetFMUState"),
}


class _Instances(Structure):
    _fields_ = (
        ("n", c_size_t),
        ("instances", c_void_p),
        ("progress", c_void_p),
        ("names", c_void_p),
        ("crew", c_void_p),
        ("n_members", c_size_t),
        ("members", c_void_p),
    )


class _Calls(Structure):
    _fields_ = (
        ("fmi", c_int),
        *((name, c_void_p) for name in ("set", "get", "step", "get_state", "set_state")),
    )


class _Rows(Structure):
    kept: Any
    """What the addresses are of."""
    _fields_ = (
        ("references", c_void_p),
        ("n_references", c_size_t),
        ("values", c_void_p),
        ("n_values", c_size_t),
        ("stride", c_size_t),
    )


class _Answer(Structure):
    _fields_ = (("status", c_int), ("stepping", c_bool))


class _Member(Structure):
    _fields_ = (("all", c_void_p), ("reached", c_size_t), ("answer", _Answer))


class StepAddresses(Structure):
    """What other native code steps all instances by: `exchange`, `advance`, and their arguments."""

    kept: Any
    """What the addresses are of."""
    _fields_ = tuple(
        (name, c_void_p)
        for name in ("exchange", "advance", "setting", "stepping", "all", "given", "read", "answer")
    )


@dataclass(frozen=True, slots=True)
class Native:
    """The functions of batch_calls.c."""

    exchange: Call
    advance: Call
    recall: Call
    watch_endings: Call
    begin_crew: Call
    help_crew: Call
    dismiss_crew: Call
    end_crew: Call


class NativeRounds:
    """Rounds of native calls; see `plant_fmu.fmi.batch_calls.Rounds`."""

    def __init__(
        self, native: Native, library: Library, handles: Sequence[int], names: Sequence[str]
    ) -> None:
        """Take the instances, whose names are for the library's `progress`, if it has one."""
        self._native, self._library = native, library
        self._instances = (c_void_p * len(handles))(*handles)
        fields = b"".join(name.encode()[:WHO].ljust(WHO, b"\0") for name in names)
        self._names = create_string_buffer(fields) if library.progress else None
        self._all, self._answer = self._announcing(0), _Answer()
        self._end_crew: finalize[..., NativeRounds] | None = None

    def use_threads(self, count: int) -> None:
        """Step from now on with several threads; where calls are announced, as many as can be."""
        if announced := len(self._library.progress):
            count = min(count, announced)
        if self._end_crew:
            self._end_crew()
        crew = self._native.begin_crew() if count > 1 else None
        if crew is None:
            self._all.crew, self._all.n_members = None, 0
            return
        alls = [self._all, *map(self._announcing, range(1, count))]
        members = (_Member * count)(*(_Member(addressof(one)) for one in alls))
        self._all.crew, self._all.n_members, self._all.members = crew, count, addressof(members)
        helpers = [
            Thread(target=self._native.help_crew, args=(crew, member), name="fmu", daemon=True)
            for member in range(1, count)
        ]
        self._end_crew = finalize(self, _end_crew, self._native, crew, helpers, (members, alls))
        for helper in helpers:
            helper.start()
        if announced:
            self._native.watch_endings()

    @property
    def threads(self) -> int:
        """How many step."""
        return max(int(self._all.n_members), 1)

    def _announcing(self, thread: int) -> _Instances:
        """Return the instances for a thread that announces where it alone does."""
        at = self._library.progress[thread] if self._names else 0
        names = addressof(self._names) if self._names else 0
        return _Instances(len(self._instances), addressof(self._instances), at, names)

    def exchange(self, view: View, *, setting: bool) -> Round:
        """Return a round of setting or getting; see `Rounds`."""
        return self._round(self._native.exchange, self._bound(_NUMBERS), _rows(view), setting)

    def advance(self, view: View) -> Step:
        """Return a round of steps; see `Rounds`."""
        calls, rows = self._bound(_STEPPING), _rows(view)
        whom, last = (byref(calls), byref(self._all), byref(rows)), byref(self._answer)

        def step(start: float, step: float) -> EarlyEnd | None:
            row = self._native.advance(*whom, start, step, last)
            return None if row == self._all.n else self.early_end(row)

        return step

    def addresses(self, given: View, read: View) -> StepAddresses:
        """Return what sets the numbers of a view, and steps and gets those of another."""
        setting, stepping = self._bound(_NUMBERS), self._bound(_STEPPING)
        kept = setting, stepping, self._all, _rows(given), _rows(read), self._answer
        native: tuple[Any, Any] = self._native.exchange, self._native.advance
        functions = (cast(function, c_void_p) for function in native)
        found = StepAddresses(*functions, *map(addressof, kept))
        found.kept = kept
        return found

    def early_end(self, row: int) -> EarlyEnd:
        """Return how the call ended that ended a round of steps at a row."""
        return EarlyEnd(row, self._answer.status, self._answer.stepping)

    def recall(self, states: Any, *, keeping: bool) -> Round:
        """Return a round of keeping or going back; see `Rounds`."""
        return self._round(self._native.recall, self._bound(_STATES), states, keeping)

    def _round(self, function: Call, calls: _Calls, what: Any, way: bool) -> Round:
        n, answer = self._all.n, _Answer()
        arguments = byref(calls), byref(self._all), byref(what), way, byref(answer)

        def go() -> EarlyEnd | None:
            row = function(*arguments)
            return None if row == n else EarlyEnd(row, answer.status)

        return go

    def _bound(self, names: Mapping[str, tuple[str, str]]) -> _Calls:
        """Return the addresses of functions, given by what FMI 2.0 and FMI 3.0 call them."""

        def binder(dll: Any, fmi: int) -> _Calls:
            functions = {ours: dll[f"fmi{fmi}{its[fmi - 2]}"] for ours, its in names.items()}
            return _Calls(fmi, **{ours: cast(f, c_void_p) for ours, f in functions.items()})

        return self._library.bind_native(binder)


def _end_crew(native: Native, crew: int, helpers: Sequence[Thread], kept: Any) -> None:  # noqa: ARG001
    """Let helpers go, to whom what they use is `kept` until then."""
    native.dismiss_crew(crew)
    for helper in helpers:
        helper.join()
    native.end_crew(crew)


def native_rounds(
    library: Library, handles: Sequence[int], names: Sequence[str]
) -> NativeRounds | None:
    """Return rounds of instances with their names; None where no native code can be had."""
    native = load_native()
    return NativeRounds(native, library, handles, names) if native else None


@cache
def load_native() -> Native | None:
    """Return the functions of batch_calls.c, compiled if need be; None where that cannot be done.

    Then it is logged once why: calls from Python are to the same bits, but slower.
    """
    try:
        library = build_library("rounds", {file.name: file.read_bytes() for file in SOURCES})
        dll = CDLL(str(library))
    except FmuError as error:
        _LOG.warning("robots are stepped by calls from Python, which is slower: %s", error)
        return None
    except OSError as error:
        _LOG.warning(
            "robots are stepped by calls from Python, which is slower: %s; if the disk of %s is "
            "mounted noexec, set NRS_CACHE to another folder",
            error,
            library.parent,
        )
        return None
    three, flag = (c_void_p,) * 3, (c_bool, c_void_p)
    step = *three, c_double, c_double
    return Native(
        bind(dll, "exchange", *three, *flag, result=c_size_t),
        bind(dll, "advance", *step, c_void_p, result=c_size_t),
        bind(dll, "recall", *three, *flag, result=c_size_t),
        bind(dll, "watch_endings", result=None),
        bind(dll, "begin_crew", result=c_void_p),
        bind(dll, "help_crew", c_void_p, c_size_t, result=None),
        bind(dll, "dismiss_crew", c_void_p, result=None),
        bind(dll, "end_crew", c_void_p, result=None),
    )


def _rows(view: View) -> _Rows:
    which, theirs = c_references(view.references), view.theirs
    stride = theirs.strides[0] // theirs.itemsize
    rows = _Rows(addressof(which), len(which), theirs.ctypes.data, theirs.shape[1], stride)
    rows.kept = which, theirs
    return rows
