"""An FMU's library is loaded once; each robot is an instance of it, cloned from the first."""

import copy
import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Any, Literal, Self, TypeVar

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.calls import Calls, bind_common
from nrs_cosim.plant_fmu.fmi.own_library import OwnSlave

Kind = Literal["CoSimulation", "ModelExchange"]
Bound = TypeVar("Bound")

_ROLES = {"CoSimulation": "Slave", "ModelExchange": "Model"}
"""What FMPy calls them."""
_WHERE = Lock()
"""FMPy loads from within the library's folder; all threads of a process are in the same one."""
_LEFT: list[list[Any]] = []
"""The instances of dead libraries, which are never freed or unloaded, and might call us still."""


class Library:
    """An FMU loaded for one FMI interface; a context that frees it with all its instances.

    `ending` frees what the instances hold, just before they are freed themselves. What the FMU may
    call while it is freed, and until it is unloaded, is kept as long.
    """

    def __init__(self, archive: Archive, folder: Path, kind: Kind) -> None:
        description = archive.description
        self.archive, self.ending = archive, ExitStack()
        self.interface: Any = {
            "CoSimulation": description.coSimulation,
            "ModelExchange": description.modelExchange,
        }[kind]
        """FMPy's record of the interface, with its capability flags."""
        self.saves_states = bool(
            self.interface.canGetAndSetFMUstate and self.interface.canSerializeFMUstate
        )
        """Whether the FMU claims that its states can leave the process."""
        self._fmi, self._folder = int(description.fmiMajorVersion), folder
        self.progress: Sequence[int] = ()
        """Where native code announces its calls, by thread; see `isolation.progress.Progress`."""
        with _WHERE:
            here = Path.cwd()
            try:
                self._prototype = _loader(archive, self._fmi, kind)(
                    guid=description.instantiationToken,
                    unzipDirectory=str(folder),
                    modelIdentifier=self.interface.modelIdentifier,
                    instanceName="",
                )
            except Exception as error:  # FMPy's are bare, and AttributeError for a symbol
                raise FmuError(
                    f"{archive.label}: its library cannot be loaded: "
                    f"{self._cause(error)}{_advice(folder)}"
                ) from None
            finally:
                os.chdir(here)
        self.calls: Calls = self.bind(bind_common)
        self.is_dead = False
        """Whether a call ended with Fatal: none of any instance may follow (FMI 3.0, 2.3)."""
        self._instances: list[Any] = []
        self._last_words: dict[str, str] = {}

    def bind(self, binder: Callable[[Any, int], Bound]) -> Bound:
        """Return the calls that a binder makes of the library; `FmuError` where one is missing."""
        try:
            return binder(self._prototype.dll, self._fmi)
        except AttributeError as error:
            raise FmuError(
                f"{self.archive.label}: its library is incomplete: {self._cause(error)}"
            ) from None

    def bind_native(self, binder: Callable[[Any, int], Bound]) -> Bound:
        """Return what a binder makes of the library for native code, which announces itself."""
        return Library.bind(self, binder)

    def instantiate(self, name: str) -> int:
        """Return the handle of a new instance; `FmuError` with the FMU's words if it refuses."""
        # A copy shares the loaded library with FMPy's object, which would load it anew.
        instance = copy.copy(self._prototype)
        instance.instanceName, instance.component = name, None
        self._instances.append(instance)
        try:
            self.calls.instantiate(instance, partial(self._last_words.__setitem__, name))
        except Exception:  # FMPy raises a bare Exception
            raise FmuError(
                f"{self.archive.label}: cannot be instantiated{self.last_words(name)}"
                f"{self.archive.needs}"
            ) from None
        handle: int = instance.component
        return handle

    def _cause(self, error: Exception) -> str:
        """Return what FMPy or the loader said, without the folder that soon is gone."""
        return str(error).replace(f"{self._folder}{os.sep}", "") + self.archive.needs

    def last_words(self, name: str) -> str:
        """Return what an instance logged last, as the end of a sentence."""
        said = self._last_words.get(name)
        return f": {said}" if said else ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.ending.close()
        if self.is_dead:
            _LEFT.append(self._instances)
            return
        for instance in reversed(self._instances):
            if instance.component is not None:
                self.calls.free(instance.component)
        self._prototype.freeLibrary()
        self._instances.clear()


def _loader(archive: Archive, fmi: int, kind: Kind) -> Callable[..., Any]:
    """Return what loads a library and makes instances of it, as FMPy's classes do."""
    if archive.bundled and kind == "CoSimulation":
        return OwnSlave
    module = import_module(f"fmpy.fmi{fmi}")
    loader: Callable[..., Any] = getattr(module, f"FMU{fmi}{_ROLES[kind]}")
    return loader


def _advice(folder: Path) -> str:
    """Return what to do where no code may be run from a folder."""
    if os.statvfs(folder).f_flag & os.ST_NOEXEC:
        return f"; {folder.parent} is mounted noexec: set TMPDIR to a folder on another disk"
    return ""
