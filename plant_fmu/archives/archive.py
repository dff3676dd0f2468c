"""An FMU is a zip archive: its model description says what it offers, its digest who it is."""

import hashlib
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path, PurePosixPath
from typing import Any
from zipfile import ZipFile

from nrs_cosim.plant_fmu.archives.entries import GIB, MOST_BYTES, opened_archive, unpack
from nrs_cosim.plant_fmu.archives.own_description import read_own_description
from nrs_cosim.plant_fmu.archives.records import ModelDescription
from nrs_cosim.plant_fmu.archives.units import unit_of
from nrs_cosim.plant_fmu.bundled.builder import build, built_here
from nrs_cosim.plant_fmu.bundled.declaration import bundled_models
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.folders import own_folder
from nrs_cosim.plant_fmu.joints import Joint, read_joints, read_urdf_text
from nrs_cosim.plant_fmu.platform_names import FMI2, FMI3, LIBRARY
from nrs_cosim.plant_fmu.urdf_limits import joint_rows


@dataclass(frozen=True, slots=True, eq=False)
class Archive:
    """An FMU on disk, read but not loaded."""

    label: str
    """What the user calls it: a bundled model's name, or a path."""
    path: Path
    sha256: str
    description: ModelDescription
    obstacle: str = ""
    """Why it cannot run on this machine, as the rest of a sentence; empty where it can."""
    platforms: tuple[str, ...] = ()
    """For which it has libraries, as FMI calls them."""
    misnamed: tuple[str, ...] = ()
    """Its libraries for this machine that are not named as FMI has it."""
    has_sources: bool = False
    """Whether it has C files, of which a library may be compiled."""
    joints: tuple[Joint, ...] = ()
    """What it calls its joints; none where it does not say."""
    bundled: bool = False
    """Whether it was read and is loaded as a bundled model: without FMPy, where that can be."""
    urdf: str = field(default="", repr=False)
    """The URDF that it was built from, as far as that is kept."""

    @property
    def name(self) -> str:
        """The model's name."""
        return str(self.description.modelName)

    @property
    def fmi_version(self) -> str:
        """1.0, which is read and not run, 2.0 or 3.0."""
        return str(self.description.fmiVersion)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The FMI interfaces that it has: CoSimulation, ModelExchange."""
        offers = {
            "CoSimulation": self.description.coSimulation,
            "ModelExchange": self.description.modelExchange,
        }
        return tuple(kind for kind, offered in offers.items() if offered)

    @property
    def ours(self) -> bool:
        """Whether its bytes are those of an FMU that was built on this machine."""
        return self.bundled or built_here(self.name, self.sha256) is not None

    @property
    def tool(self) -> str:
        """The tool that must be there for the FMU to run; empty where it needs none."""
        interfaces = (self.description.coSimulation, self.description.modelExchange)
        if not any(i.needsExecutionTool for i in interfaces if i is not None):
            return ""
        return str(self.description.generationTool or "the tool that exported it")

    @property
    def clocks(self) -> tuple[str, ...]:
        """The clocks that tick only when they are ticked from outside, which nothing here does."""
        return tuple(
            variable.name
            for variable in self.description.modelVariables
            if variable.type == "Clock"
            and variable.causality == "input"
            and variable.intervalVariability != "triggered"
        )

    @property
    def needs(self) -> str:
        """What it may lack where it refuses, as the end of a sentence, or nothing."""
        tool = f"; it needs {self.tool} on this machine (needsExecutionTool)"
        clocks = f"; its clocks {', '.join(self.clocks)} would have to be ticked from outside"
        return (tool if self.tool else "") + (clocks if self.clocks else "")

    @property
    def once_per_process(self) -> bool:
        """Whether a process may have one instance of it at most."""
        interfaces = (self.description.coSimulation, self.description.modelExchange)
        return any(i.canBeInstantiatedOnlyOncePerProcess for i in interfaces if i is not None)

    @property
    def takes_uneven_steps(self) -> bool:
        """Whether the steps of its Co-Simulation, if it has any, may be of many lengths."""
        steps = self.description.coSimulation
        return steps is None or bool(steps.canHandleVariableCommunicationStepSize)

    def describe(self) -> dict[str, Any]:
        """Return what the FMU says of itself, for JSON."""
        return {
            "name": self.name,
            "description": self.description.description or "",
            "fmi_version": self.fmi_version,
            "kinds": list(self.kinds),
            "platforms": list(self.platforms),
            "cannot_run_here": self.obstacle,
            "needs_execution_tool": self.tool,
            "sha256": self.sha256,
            "variables": [
                {
                    "name": variable.name,
                    "type": variable.type,
                    "causality": variable.causality,
                    "shape": list(variable.shape or ()),
                    "unit": unit_of(variable) or "",
                    "start": variable.start if variable.start is not None else "",
                    "description": variable.description or "",
                }
                for variable in self.description.modelVariables
            ],
            "joints": joint_rows(self.urdf, [joint.name for joint in self.joints]),
        }


def read_archive(path: Path, label: str | None = None, *, bundled: bool = False) -> Archive:
    """Read an FMU, for whatever platform it is; `FmuError` when it is missing, damaged or unfit.

    A `bundled` one was just built, or found in the cache to be what was built.
    """
    label = label or str(path)
    with _file(path, label) as file, opened_archive(file, label) as archive:
        description = (read_own_description if bundled else _read_by_fmpy)(archive, label)
        names = archive.namelist()
        return Archive(
            label,
            path,
            _digest(file),
            description,
            obstacle(description, names),
            tuple(sorted({path.parts[1] for path in shipped_libraries(names)})),
            tuple(misnamed_libraries(description, names).values()),
            has_c(names),
            read_joints(archive, label),
            bundled,
            read_urdf_text(archive, label),
        )


def _read_by_fmpy(archive: ZipFile, label: str) -> ModelDescription:
    from nrs_cosim.plant_fmu.archives.model_description import (  # noqa: PLC0415, it loads FMPy
        read_description,
    )

    return read_description(archive, label)


def open_archive(path: Path, label: str | None = None) -> Archive:
    """Read an FMU that can run on this machine; `FmuError` is as for `read_archive`."""
    return _able(read_archive(path, label))


def look_up(fmu: str, folder: Path) -> Archive:
    """Return the FMU that a scenario names: an `.fmu` file relative to a folder, or a bundled one.

    A bundled model is built on first use. `FmuError` when there is no such file or model.
    """
    if fmu.endswith(".fmu") or "/" in fmu or "\\" in fmu:
        return read_archive(folder / fmu)
    if fmu not in bundled_models() and (folder / fmu).is_file():
        raise FmuError(f"{fmu}: is not an FMU: its name does not end with .fmu")
    return read_archive(build(fmu), fmu, bundled=True)


def find_archive(fmu: str, folder: Path) -> Archive:
    """Return the FMU that a scenario names, which can run on this machine; see `look_up`."""
    return _able(look_up(fmu, folder))


@contextmanager
def unpacked(archive: Archive) -> Iterator[Path]:
    """Unpack an archive into a temporary folder that ends with the context."""
    with own_folder() as folder:
        with _file(archive.path, archive.label) as file:
            # What was looked at is what is loaded, whoever wrote the file meanwhile.
            if _digest(file) != archive.sha256:
                raise FmuError(f"{archive.label}: has changed since it was read")
            unpack(file, folder, archive.label)
        names = [path.relative_to(folder).as_posix() for path in folder.glob("binaries/*/*")]
        for expected, found in misnamed_libraries(archive.description, names).items():
            if not (folder / expected).exists():  # as it does where letters' case does not count
                shutil.copyfile(folder / found, folder / expected)
        yield folder


@contextmanager
def _file(path: Path, label: str) -> Iterator[BufferedReader]:
    """Open a file of bearable size."""
    try:
        file = path.open("rb")
    except FileNotFoundError:
        raise FmuError(f"{label}: no such FMU in {path.parent.absolute()}") from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error  # a path with a null byte is a ValueError
        raise FmuError(f"{label}: cannot be read: {why}") from None
    with file:
        size = file.seek(0, 2)
        if size > MOST_BYTES:
            raise FmuError(f"{label}: is {size / GIB:.1f} GiB, more than {MOST_BYTES / GIB:g} GiB")
        yield file


def _digest(file: BufferedReader) -> str:
    file.seek(0)
    return hashlib.file_digest(file, "sha256").hexdigest()


def _able(archive: Archive) -> Archive:
    if archive.obstacle:
        raise FmuError(f"{archive.label}: {archive.obstacle}")
    return archive


SUFFIXES = {".so", ".dll", ".dylib"}
_DEPTH = len(("binaries", "platform", "file"))


def obstacle(description: ModelDescription, names: Sequence[str]) -> str:
    """Return why an FMU with files of these names cannot run on this machine; nothing if it can.

    Its library is `binaries/<platform>/<modelIdentifier>` with the platform's suffix (FMI 2.0,
    section 2.3; FMI 3.0, section 2.5.1.4). Nothing else in that folder is one that FMI knows.
    """
    interfaces = (description.coSimulation, description.modelExchange)
    offers = [interface for interface in interfaces if interface is not None]
    if description.fmiMajorVersion == 1:
        return "is of FMI 1.0, which is read but not run; have its tool export it as FMI 2.0 or 3.0"
    if not offers:
        alone = ", but ScheduledExecution alone" if description.scheduledExecution else ""
        return f"offers neither CoSimulation nor ModelExchange{alone}"
    here, wanted = _here(description), _libraries(description)
    if not set(wanted).isdisjoint(names) or misnamed_libraries(description, names):
        return ""
    found = shipped_libraries(names)
    lacking = f"has no library {' or '.join(wanted)} for this platform"
    if others := [str(p) for p in found if p.parts[1] == here]:
        return f"{lacking}; it has {', '.join(others)}, none named as its modelIdentifier"
    there = ", ".join(sorted({p.parts[1] for p in found}))
    has = f"libraries for {there}" if there else "no library at all"
    advice = ", but C sources: --compile, or `nrs fmu compile`, makes one of them" * has_c(names)
    return f"{lacking}; it has {has}{advice}"


def shipped_libraries(names: Sequence[str]) -> list[PurePosixPath]:
    """Return which of an archive's files are libraries for some platform."""
    paths = [PurePosixPath(name) for name in names]
    found = [p for p in paths if p.parts[:1] == ("binaries",) and p.suffix in SUFFIXES]
    return [p for p in found if len(p.parts) == _DEPTH]


def misnamed_libraries(description: ModelDescription, names: Sequence[str]) -> dict[str, str]:
    """Return what stands for each library of this machine that an FMU has by another name.

    It has that name in other letters, as tools of Windows may write it, or is the only one there.
    """
    here = [
        name
        for name in names
        if PurePosixPath(name).parent.as_posix() == f"binaries/{_here(description)}"
        and name.endswith(LIBRARY)
    ]
    wanted = _libraries(description)
    # A name that leads elsewhere is no other name of what is here.
    if not set(wanted).isdisjoint(here) or any(
        len(PurePosixPath(n).parts) != _DEPTH for n in wanted
    ):
        return {}
    meant = {name: [one for one in here if one.lower() == name.lower()] or here for name in wanted}
    return {name: found[0] for name, found in meant.items() if len(found) == 1}


def _here(description: ModelDescription) -> str:
    return FMI3 if description.fmiMajorVersion == 3 else FMI2


def _libraries(description: ModelDescription) -> list[str]:
    """Return where the libraries of the interfaces are, if FMI's names are kept."""
    offers = (description.coSimulation, description.modelExchange)
    folder = f"binaries/{_here(description)}"
    names = {f"{o.modelIdentifier}{LIBRARY}" for o in offers if o is not None}
    return sorted(f"{folder}/{name}" for name in names)


def has_c(names: Sequence[str]) -> bool:
    """Whether C files are among an archive's."""
    return any(name.startswith("sources/") and name.endswith(".c") for name in names)
