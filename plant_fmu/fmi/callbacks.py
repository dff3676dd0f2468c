"""What an FMU of FMI 2.0 may call of ours: all of it outlives the FMU, which may keep the pointers.

An FMU may log and free memory in any call, `fmi2FreeInstance` included, and may do so through the
pointer that it was instantiated with (FMI 2.0, section 2.1.5). So memory is C's own, there is one
logger as long as the process lives, and the rest is one instance's as long as its library is
loaded. Whose words it receives, the logger knows by the environment that the FMU hands back.

A message has arguments as printf has, which Python cannot take; a proxy of FMPy's puts them in. It
calls the one function that it was given last, whoever gave it, so that a copy of it is loaded for
us alone: in this process others may use FMPy too.
"""

import shutil
from ctypes import CDLL, byref, c_void_p, cast
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import fmpy
from fmpy.fmi2 import (
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)

from nrs_cosim.plant_fmu.fmi.log_text import Log, text_of
from nrs_cosim.plant_fmu.folders import own_folder

_ENVIRONMENTS = count(1)


class Callbacks(fmi2CallbackFunctions):  # type: ignore[misc]
    """What one instance is given: to be kept until its library is unloaded."""

    def __init__(self, name: str, log: Log) -> None:
        """Send what the instance of a name logs to a function."""
        super().__init__(
            _logger(),
            cast(fmpy.calloc, fmi2CallbackAllocateMemoryTYPE),
            cast(fmpy.free, fmi2CallbackFreeMemoryTYPE),
            componentEnvironment=next(_ENVIRONMENTS),
        )
        self.name, self.log = name.encode(), log
        _KEPT[self.componentEnvironment] = self


_KEPT: WeakValueDictionary[int, Callbacks] = WeakValueDictionary()
"""By their environments."""


@cache
def _logger() -> Any:
    """Return the C function that all instances log by."""
    extension = fmpy.sharedLibraryExtension
    vendor = Path(fmpy.__file__).parent / "logging" / fmpy.platform / f"logging{extension}"
    with own_folder() as folder:
        proxy = CDLL(str(shutil.copy(vendor, folder)))
    shared = fmi2CallbackFunctions(_LOG)
    add = proxy.addLoggerProxy
    add.argtypes, add.restype = (c_void_p,), None
    add(byref(shared))
    return shared.logger


def _log(
    environment: int | None, name: bytes | None, _status: int, _category: Any, message: bytes | None
) -> None:
    """Log for the instance of an environment; where an FMU gives another, for those of its name.

    One that gives neither must be the only one to be known.
    """
    text = text_of(message)
    if own := _KEPT.get(environment or 0):
        own.log(text)
        return
    kept = [callbacks for reference in _KEPT.valuerefs() if (callbacks := reference())]
    namesakes = [callbacks for callbacks in kept if callbacks.name == name]
    for callbacks in namesakes or (kept if len(kept) == 1 else []):
        callbacks.log(text)


_LOG = fmi2CallbackLoggerTYPE(_log)
