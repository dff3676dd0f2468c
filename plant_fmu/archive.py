"""An FMU is a zip archive: its model description says what it offers, its digest who it is."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import BadZipFile

import fmpy
from fmpy.model_description import ModelDescription

from plant_fmu.building import build, built_here
from plant_fmu.errors import FmuError


@dataclass(frozen=True, slots=True, eq=False)
class Archive:
    """An FMU on disk, read but not loaded."""

    label: str
    """What the user calls it: a bundled model's name, or a path."""
    path: Path
    sha256: str
    description: ModelDescription

    @property
    def name(self) -> str:
        """The model's name."""
        return str(self.description.modelName)

    @property
    def fmi_version(self) -> str:
        """2.0 or 3.0."""
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
        return built_here(self.name, self.sha256)

    @property
    def once_per_process(self) -> bool:
        """Whether a process may have one instance of it at most."""
        interfaces = (self.description.coSimulation, self.description.modelExchange)
        return any(i.canBeInstantiatedOnlyOncePerProcess for i in interfaces if i is not None)

    def told(self) -> dict[str, Any]:
        """Return what the FMU says of itself, for JSON."""
        return {
            "name": self.name,
            "description": self.description.description or "",
            "fmi_version": self.fmi_version,
            "kinds": list(self.kinds),
            "sha256": self.sha256,
            "variables": [
                {
                    "name": variable.name,
                    "causality": variable.causality,
                    "shape": list(variable.shape or ()),
                    "unit": variable.unit or "",
                    "start": variable.start if variable.start is not None else "",
                    "description": variable.description or "",
                }
                for variable in self.description.modelVariables
            ],
        }


def open_archive(path: Path, label: str | None = None) -> Archive:
    """Read an FMU; `FmuError` when it is missing, damaged, or of an FMI version we do not run."""
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        description = fmpy.read_model_description(path)
    except FileNotFoundError:
        raise FmuError(f"{path}: no such FMU") from None
    except BadZipFile:
        raise FmuError(f"{path}: is no FMU, for it is no zip archive or a damaged one") from None
    except Exception as error:  # FMPy raises bare Exceptions and lxml's
        raise FmuError(f"{path}: its model description cannot be read: {error}") from None
    if description.fmiMajorVersion not in (2, 3):
        raise FmuError(f"{path}: is FMI {description.fmiVersion}; FMI 2.0 and 3.0 can be run")
    return Archive(label or str(path), path, digest, description)


def find_archive(fmu: str, folder: Path) -> Archive:
    """Return the FMU that a scenario names: an `.fmu` file relative to a folder, or a bundled one.

    A bundled model is built on first use. `FmuError` when there is no such file or model.
    """
    if fmu.endswith(".fmu") or "/" in fmu or "\\" in fmu:
        return open_archive(folder / fmu)
    return open_archive(build(fmu), fmu)


@contextmanager
def unpacked(archive: Archive) -> Iterator[Path]:
    """Unpack an archive into a temporary folder that ends with the context."""
    with TemporaryDirectory(prefix="nrs-") as folder:
        try:
            fmpy.extract(archive.path, unzipdir=folder)
        except (BadZipFile, OSError) as error:
            raise FmuError(f"{archive.label}: cannot be unpacked: {error}") from None
        yield Path(folder)
