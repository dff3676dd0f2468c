"""FMI 2.0 and 3.0 spelled alike: a call takes an instance's handle, and returns an FMI status.

The functions are bound once from the loaded library, with fixed argument types, because FMPy's own
methods cost more than the calls themselves. Values are passed by the address of an array.
"""

from collections.abc import Callable
from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_uint, c_void_p
from dataclasses import dataclass
from typing import Any

from fmpy import calloc, free
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.fmi3 import FMU3Slave
from fmpy.logging import addLoggerProxy

Call = Callable[..., int]
Log = Callable[[str], None]

WARNING = 1
STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")


@dataclass(frozen=True, slots=True)
class Calls:
    """The Co-Simulation calls of one loaded library."""

    set: Call
    """(handle, references, address …): the values at the address go to the FMU."""
    get: Call
    """(handle, references, address …): the FMU's values go to the address."""
    counts_values: bool
    """Whether `set` and `get` end with the number of values, as in FMI 3.0."""
    step: Call
    """(handle, communication point in s, step in s, *step_tail)"""
    step_tail: tuple[Any, ...]
    enter_initialization: Call
    exit_initialization: Call
    free: Call
    instantiate: Callable[[Any, Log], None]
    """Instantiates a copy of FMPy's slave, whose log goes where the second argument says."""


def bind_fmi3(slave: FMU3Slave) -> Calls:
    """Bind the calls of an FMI 3.0 library (FMI 3.0, sections 2.2 and 4.2)."""
    values = (c_void_p, c_void_p, c_size_t, c_void_p, c_size_t)
    enter = _bind(
        slave,
        "fmi3EnterInitializationMode",
        *(c_void_p, c_bool, c_double, c_double, c_bool, c_double),
    )
    told = (c_bool(), c_bool(), c_bool(), c_double())

    def instantiate(instance: Any, log: Log) -> None:
        instance.instantiate(
            loggingOn=True, logMessage=lambda _env, _status, _category, text: log(_text(text))
        )

    return Calls(
        set=_bind(slave, "fmi3SetFloat64", *values),
        get=_bind(slave, "fmi3GetFloat64", *values),
        counts_values=True,
        step=_bind(slave, "fmi3DoStep", c_void_p, c_double, c_double, c_bool, *[c_void_p] * 4),
        step_tail=(True, *(byref(value) for value in told)),
        enter_initialization=lambda handle: enter(handle, False, 0.0, 0.0, False, 0.0),
        exit_initialization=_bind(slave, "fmi3ExitInitializationMode", c_void_p),
        free=_bind(slave, "fmi3FreeInstance", c_void_p, result=None),
        instantiate=instantiate,
    )


def bind_fmi2(slave: FMU2Slave) -> Calls:
    """Bind the calls of an FMI 2.0 library (FMI 2.0, sections 2.1 and 4.2)."""
    values = (c_void_p, c_void_p, c_size_t, c_void_p)
    setup = _bind(
        slave, "fmi2SetupExperiment", c_void_p, c_int, c_double, c_double, c_int, c_double
    )
    enter = _bind(slave, "fmi2EnterInitializationMode", c_void_p)

    def instantiate(instance: Any, log: Log) -> None:
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(
            lambda _env, _name, _status, _category, text: log(_text(text))
        )
        callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        addLoggerProxy(byref(callbacks))
        instance.instantiate(loggingOn=True, callbacks=callbacks)

    return Calls(
        set=_bind(slave, "fmi2SetReal", *values),
        get=_bind(slave, "fmi2GetReal", *values),
        counts_values=False,
        step=_bind(slave, "fmi2DoStep", c_void_p, c_double, c_double, c_int),
        step_tail=(1,),
        enter_initialization=lambda handle: setup(handle, 0, 0.0, 0.0, 0, 0.0) or enter(handle),
        exit_initialization=_bind(slave, "fmi2ExitInitializationMode", c_void_p),
        free=_bind(slave, "fmi2FreeInstance", c_void_p, result=None),
        instantiate=instantiate,
    )


def c_references(references: tuple[int, ...]) -> Any:
    """Return value references as a C array."""
    return (c_uint * len(references))(*references)


def _bind(slave: Any, name: str, *arguments: Any, result: Any = c_int) -> Call:
    function = slave.dll[name]
    function.argtypes, function.restype = arguments, result
    call: Call = function
    return call


def _text(message: bytes | None) -> str:
    return (message or b"").decode("utf-8", "replace").strip()
