"""A bundled model's library is loaded for Co-Simulation without FMPy, which takes longer to load.

It offers what `library` asks of FMPy's slaves (FMI 3.0, section 4.2.1): FMI's own types, no event
mode, no early return, no intermediate update.
"""

from ctypes import CDLL, CFUNCTYPE, c_bool, c_char_p, c_int, c_size_t, c_void_p
from functools import partial
from pathlib import Path
from typing import Any

from nrs_cosim.plant_fmu.platform_names import FMI3, LIBRARY

_LOG = CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)
_ARGUMENTS = (
    *(c_char_p, c_char_p, c_char_p, c_bool, c_bool, c_bool, c_bool),
    *(c_void_p, c_size_t, c_void_p, _LOG, c_void_p),
)


class OwnSlave:
    """A loaded library; its copies are instances."""

    def __init__(self, guid: str, unzipDirectory: str, modelIdentifier: str, instanceName: str):
        """Load it from an unpacked archive; the names are FMPy's."""
        place = Path(unzipDirectory) / "binaries" / FMI3 / f"{modelIdentifier}{LIBRARY}"
        self.dll = CDLL(str(place))
        self.guid, self.instanceName = guid, instanceName
        self._resources = f"{unzipDirectory}/resources/"
        close = CDLL(None).dlclose
        close.argtypes = (c_void_p,)
        self.freeLibrary = partial(close, self.dll._handle)
        self.component: int | None = None
        self._log: Any = None
        """The FMU holds a pointer to it until it is freed."""

    def instantiate(self, *, loggingOn: bool, logMessage: Any) -> None:
        """Make an instance, whose log goes to a function; raises where the FMU refuses."""
        begin = self.dll.fmi3InstantiateCoSimulation
        begin.argtypes, begin.restype = _ARGUMENTS, c_void_p
        self._log = _LOG(logMessage)
        names = (text.encode() for text in (self.instanceName, self.guid, self._resources))
        no = (False, False, None, 0, None)
        self.component = begin(*names, False, loggingOn, *no, self._log, None)
        if not self.component:
            raise RuntimeError("refused")
