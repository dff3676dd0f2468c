"""An FMU's own state: taken, put back, and turned into bytes (FMI 2.0, 2.1.8; FMI 3.0, 2.2.11)."""

from ctypes import c_size_t, c_void_p
from dataclasses import dataclass
from typing import Any

from nrs_cosim.plant_fmu.fmi.calls import Call, bind


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
    """Bind them; only an FMU whose flags say so need have them."""
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
