"""An FMU's library is loaded once; each robot is an instance of it, cloned from the first."""

import copy
import os
from collections import deque
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from plant_fmu.archive import Archive
from plant_fmu.calls import Calls, bind_fmi2, bind_fmi3
from plant_fmu.errors import FmuError


class Library:
    """A loaded FMU, for Co-Simulation; a context that frees it with all its instances."""

    def __init__(self, archive: Archive, folder: Path) -> None:
        self.archive = archive
        if archive.description.coSimulation is None:
            raise FmuError(
                f"{archive.label}: offers {', '.join(archive.kinds)}, expected CoSimulation"
            )
        slave, bind = (
            (FMU2Slave, bind_fmi2)
            if archive.description.fmiMajorVersion == 2
            else (FMU3Slave, bind_fmi3)
        )
        here = Path.cwd()
        try:
            self._prototype = slave(
                guid=archive.description.instantiationToken,
                unzipDirectory=str(folder),
                modelIdentifier=archive.description.coSimulation.modelIdentifier,
            )
        except Exception as error:  # FMPy raises bare Exceptions, and AttributeError for a symbol
            raise FmuError(f"{archive.label}: its library cannot be loaded: {error}") from None
        finally:
            os.chdir(here)
        self.calls: Calls = bind(self._prototype)
        self._instances: list[Any] = []
        self._said: deque[tuple[str, str]] = deque(maxlen=100)

    def instantiate(self, name: str) -> int:
        """Return the handle of a new instance; `FmuError` with the FMU's words if it refuses."""
        instance = copy.copy(self._prototype)
        instance.instanceName = name
        try:
            self.calls.instantiate(instance, lambda text: self._said.append((name, text)))
        except Exception:  # FMPy raises a bare Exception
            raise FmuError(
                f"{self.archive.label}: cannot be instantiated{self.last_words(name)}"
            ) from None
        self._instances.append(instance)
        handle: int = instance.component
        return handle

    def last_words(self, name: str) -> str:
        """Return what an instance logged last, as the end of a sentence."""
        said = [text for instance, text in self._said if instance == name]
        return f": {said[-1]}" if said else ""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        while self._instances:
            self.calls.free(self._instances.pop().component)
        self._prototype.freeLibrary()
