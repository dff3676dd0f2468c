"""FMI 2.0 and 3.0 spelled alike: a call takes an instance's handle, and returns an FMI status.

The functions are bound once from the loaded library, with fixed argument types, because FMPy's own
methods cost more than the calls themselves. Values are passed by the address of an array.
"""

from collections.abc import Callable
from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_uint, c_void_p
from dataclasses import dataclass
from typing import Any

from nrs_cosim.plant_fmu.fmi.log_text import Log, text_of

Call = Callable[..., int]

WARNING, DISCARD, FATAL = 1, 2, 4
_INTEGER = {2: {"Enumeration": "Integer"}, 3: {"Enumeration": "Int64"}}
ENDED, EARLY = 6, 7
"""What we answer for a step of FMI 3.0 whose status is fine, but which cannot be gone on from."""
_ANSWERS = (
    *("OK", "Warning", "Discard", "Error", "Fatal", "Pending"),
    *("the wish to end the simulation", "an early return, which was not allowed"),
)


def is_fine(status: int) -> bool:
    """Whether a call answered neither worse than a warning, nor what no FMI status is."""
    return 0 <= status <= WARNING


def unless_fine(status: int) -> int:
    """Return 0 for a status that is fine, else it: `a or b` calls b only where a was fine."""
    return 0 if 0 <= status <= WARNING else status


def answer(status: int) -> str:
    """Return what a call ended with."""
    return _ANSWERS[status] if 0 <= status < len(_ANSWERS) else f"status {status}, unknown to FMI"


@dataclass(frozen=True, slots=True)
class Calls:
    """The calls of one loaded library that Co-Simulation and Model Exchange share."""

    set: Call
    """(handle, references, address …): the values at the address go to the FMU."""
    get: Call
    """(handle, references, address …): the FMU's values go to the address."""
    counts_values: bool
    """Whether `set` and `get` end with the number of values, as in FMI 3.0."""
    set_typed: Callable[[str], Call]
    """Like `set`, for the type of its argument, by FMI's name of it: Boolean, Int32 …"""
    enter_configuration: Call
    exit_configuration: Call
    enter_initialization: Call
    """(handle, start time in s)"""
    exit_initialization: Call
    reset: Call
    free: Call
    instantiate: Callable[[Any, Log], None]
    """Instantiates a copy of FMPy's instance, whose log goes where the second argument says.

    The copy holds what the FMU may call: it is kept until the library is unloaded.
    """


@dataclass(frozen=True, slots=True)
class StepCall:
    """The call that advances an instance for Co-Simulation."""

    step: Call
    """(handle, communication point in s, step in s)"""


def bind_common(dll: Any, fmi: int) -> Calls:
    """Bind what both interfaces share (FMI 2.0, section 2.1; FMI 3.0, section 2.2)."""
    return _common_fmi2(dll) if fmi == 2 else _common_fmi3(dll)


def bind_step(dll: Any, fmi: int) -> StepCall:
    """Bind `doStep` (FMI 2.0, section 4.2.1; FMI 3.0, section 4.2.1)."""
    arguments = (c_void_p, c_double, c_double)
    if fmi == 2:
        # noSetFMUStatePriorToCurrentPoint: a run goes back to the start of a step, never before it.
        do_step = bind(dll, "fmi2DoStep", *arguments, c_int)
        return StepCall(lambda handle, start, step: do_step(handle, start, step, 1))
    event, ended, early, reached = c_bool(), c_bool(), c_bool(), c_double()
    out = tuple(byref(value) for value in (event, ended, early, reached))
    do_step = bind(dll, "fmi3DoStep", *arguments, c_bool, *[c_void_p] * 4)

    def step(handle: int, start: float, step: float) -> int:
        status = do_step(handle, start, step, True, *out)
        if status <= WARNING and (ended or early):
            return ENDED if ended else EARLY
        return status

    return StepCall(step)


def _common_fmi3(dll: Any) -> Calls:
    values = (c_void_p, c_void_p, c_size_t, c_void_p, c_size_t)
    enter = bind(
        dll,
        "fmi3EnterInitializationMode",
        *(c_void_p, c_bool, c_double, c_double, c_bool, c_double),
    )

    def instantiate(instance: Any, log: Log) -> None:
        instance.instantiate(
            loggingOn=True, logMessage=lambda _env, _status, _category, text: log(text_of(text))
        )

    return Calls(
        set=bind(dll, "fmi3SetFloat64", *values),
        get=bind(dll, "fmi3GetFloat64", *values),
        counts_values=True,
        set_typed=lambda kind: bind(dll, f"fmi3Set{_INTEGER[3].get(kind, kind)}", *values),
        enter_configuration=bind(dll, "fmi3EnterConfigurationMode", c_void_p),
        exit_configuration=bind(dll, "fmi3ExitConfigurationMode", c_void_p),
        # No tolerance but the FMU's own, and no stop time: a run may be continued beyond its end.
        enter_initialization=lambda handle, start: enter(handle, False, 0.0, start, False, 0.0),
        exit_initialization=bind(dll, "fmi3ExitInitializationMode", c_void_p),
        reset=bind(dll, "fmi3Reset", c_void_p),
        free=bind(dll, "fmi3FreeInstance", c_void_p, result=None),
        instantiate=instantiate,
    )


def _common_fmi2(dll: Any) -> Calls:
    values = (c_void_p, c_void_p, c_size_t, c_void_p)
    setup = bind(dll, "fmi2SetupExperiment", c_void_p, c_int, c_double, c_double, c_int, c_double)
    enter = bind(dll, "fmi2EnterInitializationMode", c_void_p)

    from nrs_cosim.plant_fmu.fmi.callbacks import Callbacks  # noqa: PLC0415, it loads FMPy

    def instantiate(instance: Any, log: Log) -> None:
        callbacks = Callbacks(instance.instanceName, log)
        instance.instantiate(loggingOn=True, callbacks=callbacks)

    def initialize(handle: int, start: float) -> int:
        return unless_fine(setup(handle, 0, 0.0, start, 0, 0.0)) or enter(handle)

    return Calls(
        set=bind(dll, "fmi2SetReal", *values),
        get=bind(dll, "fmi2GetReal", *values),
        counts_values=False,
        set_typed=lambda kind: bind(dll, f"fmi2Set{_INTEGER[2].get(kind, kind)}", *values),
        enter_configuration=_nothing,
        exit_configuration=_nothing,
        enter_initialization=initialize,
        exit_initialization=bind(dll, "fmi2ExitInitializationMode", c_void_p),
        reset=bind(dll, "fmi2Reset", c_void_p),
        free=bind(dll, "fmi2FreeInstance", c_void_p, result=None),
        instantiate=instantiate,
    )


def c_references(references: tuple[int, ...]) -> Any:
    """Return value references as a C array."""
    return (c_uint * len(references))(*references)


def bind(dll: Any, name: str, *arguments: Any, result: Any = c_int) -> Call:
    """Return a library's function with fixed types; `AttributeError` where it has none."""
    function = dll[name]
    function.argtypes, function.restype = arguments, result
    call: Call = function
    return call


def _nothing(_handle: int) -> int:
    """Stand for the calls that FMI 2.0 does not have."""
    return 0


@dataclass(frozen=True, slots=True)
class StateCalls:
    """The calls of a library that deal with the states of its instances."""

    get: Call
    """(handle, address of a state)"""
    set: Call
    """(handle, state)"""
    free: Call
    """(handle, address of a state)"""
    size: Call
    """(handle, state, address of a number)"""
    serialize: Call
    """(handle, state, bytes, their number)"""
    deserialize: Call
    """(handle, bytes, their number, address of a state)"""


def bind_states(dll: Any, fmi: int) -> StateCalls:
    """Bind them (FMI 2.0, section 2.1.8; FMI 3.0, section 2.2.11).

    Only an FMU whose flags say so need have them.
    """
    state, read = ("FMUstate", "fmi2DeSerialize") if fmi == 2 else ("FMUState", "fmi3Deserialize")
    pair, bytes_of = (c_void_p, c_void_p), (c_void_p, c_void_p, c_void_p, c_size_t)
    return StateCalls(
        get=bind(dll, f"fmi{fmi}Get{state}", *pair),
        set=bind(dll, f"fmi{fmi}Set{state}", *pair),
        free=bind(dll, f"fmi{fmi}Free{state}", *pair),
        size=bind(dll, f"fmi{fmi}Serialized{state}Size", c_void_p, c_void_p, c_void_p),
        serialize=bind(dll, f"fmi{fmi}Serialize{state}", *bytes_of),
        deserialize=bind(dll, f"{read}{state}", c_void_p, c_void_p, c_size_t, c_void_p),
    )
