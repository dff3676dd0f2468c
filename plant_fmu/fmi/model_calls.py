"""Model Exchange in FMI 2.0 and 3.0, spelled alike (FMI 2.0, section 3.2; FMI 3.0, section 3.2).

A call takes an instance's handle, and returns an FMI status or, where the FMU has something to say
of events, what it said.
"""

from collections.abc import Callable
from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_void_p
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

from fmpy.fmi2 import fmi2EventInfo

from nrs_cosim.plant_fmu.fmi.calls import Call, bind


class Completed(NamedTuple):
    """The FMU's answer to an integrator's step that was accepted."""

    status: int
    event: bool
    terminate: bool


class Update(NamedTuple):
    """The FMU's answer to one iteration of an event."""

    status: int
    again: bool
    terminate: bool
    next_event: float
    """s; infinite when none is planned"""


@dataclass(frozen=True, slots=True)
class ModelCalls:
    """The Model Exchange calls of one loaded library."""

    set_time: Call
    set_states: Call
    """(handle, address, number), as for the three below"""
    get_states: Call
    get_derivatives: Call
    get_nominals: Call
    get_indicators: Call
    enter_event_mode: Call
    enter_continuous_time_mode: Call
    complete_step: Callable[[int], Completed]
    update: Callable[[int], Update]


def bind_model(dll: Any, fmi: int) -> ModelCalls:
    """Bind them."""
    derivatives = "Derivatives" if fmi == 2 else "ContinuousStateDerivatives"
    numbers = (c_void_p, c_void_p, c_size_t)
    truth = c_int if fmi == 2 else c_bool
    return ModelCalls(
        set_time=bind(dll, f"fmi{fmi}SetTime", c_void_p, c_double),
        set_states=bind(dll, f"fmi{fmi}SetContinuousStates", *numbers),
        get_states=bind(dll, f"fmi{fmi}GetContinuousStates", *numbers),
        get_derivatives=bind(dll, f"fmi{fmi}Get{derivatives}", *numbers),
        get_nominals=bind(dll, f"fmi{fmi}GetNominalsOfContinuousStates", *numbers),
        get_indicators=bind(dll, f"fmi{fmi}GetEventIndicators", *numbers),
        enter_event_mode=bind(dll, f"fmi{fmi}EnterEventMode", c_void_p),
        enter_continuous_time_mode=bind(dll, f"fmi{fmi}EnterContinuousTimeMode", c_void_p),
        complete_step=_complete_step(
            bind(dll, f"fmi{fmi}CompletedIntegratorStep", c_void_p, truth, c_void_p, c_void_p),
            truth,
        ),
        update=_update_fmi2(dll) if fmi == 2 else _update_fmi3(dll),
    )


def _complete_step(call: Call, truth: Any) -> Callable[[int], Completed]:
    event, terminate = truth(), truth()
    addresses = byref(event), byref(terminate)

    def complete_step(handle: int) -> Completed:
        # noSetFMUStatePriorToCurrentPoint: what is taken back is a step that was not completed.
        status = call(handle, True, *addresses)
        return Completed(status, bool(event.value), bool(terminate.value))

    return complete_step


def _update_fmi2(dll: Any) -> Callable[[int], Update]:
    call, info = bind(dll, "fmi2NewDiscreteStates", c_void_p, c_void_p), fmi2EventInfo()
    address = byref(info)

    def update(handle: int) -> Update:
        return Update(
            call(handle, address),
            bool(info.newDiscreteStatesNeeded),
            bool(info.terminateSimulation),
            info.nextEventTime if info.nextEventTimeDefined else inf,
        )

    return update


def _update_fmi3(dll: Any) -> Callable[[int], Update]:
    call = bind(dll, "fmi3UpdateDiscreteStates", c_void_p, *[c_void_p] * 6)
    # Whether nominal values or states changed is no matter: after an event all are read anew.
    again, terminate, nominals, states, planned = (c_bool() for _ in range(5))
    at = c_double()
    addresses = [byref(value) for value in (again, terminate, nominals, states, planned, at)]

    def update(handle: int) -> Update:
        status = call(handle, *addresses)
        next_event = at.value if planned.value else inf
        return Update(status, again.value, terminate.value, next_event)

    return update
