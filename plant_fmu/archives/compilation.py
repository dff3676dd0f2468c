"""An FMU with C sources and without a library for this machine: where the user wants it, compiled.

Which files make a library, FMI 2 says in the model description (SourceFiles; FMI 2.0.4, section
2.2.3) and FMI 3 in sources/buildDescription.xml (FMI 3.0.2, section 2.5.1.3); where neither does,
all C files of the folder do. To compile runs nothing of them, but what comes of it is run: so it is
asked for, never done by itself. What is built is kept by the archive's digest, and is a copy of the
archive with one more file; it is a stranger's FMU still.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from fmpy.model_description import BuildConfiguration, SourceFileSet, read_build_description

from nrs_cosim.plant_fmu import cache
from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive, unpacked
from nrs_cosim.plant_fmu.bundled.builder import archive_bytes, fmi_headers
from nrs_cosim.plant_fmu.bundled.compiler import compiler, shared_library
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.platform_names import FMI2, FMI3, LIBRARY

FLAGS = (
    "-shared",
    "-fPIC",
    "-O2",
    "-w",
    "-ffp-contract=off",
    "-fno-tree-slp-vectorize",
    # The functions of a library have FMI's own names (FMI 2.0.4, section 2.1.1; FMI 3.0.2, 2.6.1).
    "-DFMI2_OVERRIDE_FUNCTION_PREFIX",
    "-DFMI3_OVERRIDE_FUNCTION_PREFIX",
    "-I.",
    "-Ifmi",
)
HEADERS = "fmi"
"""Where FMI's own headers are, which an FMU may have left out."""


@dataclass(frozen=True, slots=True)
class _Build:
    """What makes the library of one model identifier."""

    units: tuple[str, ...]
    flags: tuple[str, ...]


def compiled(archive: Archive) -> Archive:
    """Return an archive that can run here: itself, or with its sources compiled.

    `FmuError` where it has no C sources, or they do not compile.
    """
    if not archive.obstacle:
        return archive
    if archive.description.fmiMajorVersion == 1:
        raise FmuError(f"{archive.label}: {archive.obstacle}")
    if not archive.has_sources:
        raise FmuError(f"{archive.label}: {archive.obstacle}: there is nothing to compile")
    decides = f"{' '.join(FLAGS)} {' '.join(compiler())} {FMI3}"
    key = hashlib.sha256(decides.encode()).hexdigest()[:16]
    kept = f"compiled-{archive.sha256}-{key}.fmu"
    path = cache.stored(kept) or cache.keep(kept, _with_libraries(archive))
    found = open_archive(path, archive.label)
    cache.keep_fmu(path.read_bytes(), found.sha256)  # for workers, who know it by its digest
    return found


def _with_libraries(archive: Archive) -> bytes:
    description = archive.description
    offers = (description.coSimulation, description.modelExchange)
    fmi = int(description.fmiMajorVersion)
    folder = FMI2 if fmi == 2 else FMI3
    headers = {f"{HEADERS}/{name}": text for name, text in fmi_headers(fmi).items()}
    with unpacked(archive) as root:
        configurations = _configurations(archive, root)
        files = {
            path.relative_to(root / "sources").as_posix(): path.read_bytes()
            for path in (root / "sources").rglob("*")
            if path.is_file()
        }
        whole = {
            path.relative_to(root).as_posix(): path.read_bytes()
            for path in root.rglob("*")
            if path.is_file()
        }
    for identifier in sorted({offer.modelIdentifier for offer in offers if offer is not None}):
        listed = [c for c in configurations if c.modelIdentifier == identifier]
        build = _build(archive, [each for c in listed for each in c.sourceFileSets], files)
        flags = (*FLAGS, *build.flags)
        library = shared_library(archive.label, {**headers, **files}, build.units, flags)
        whole[f"binaries/{folder}/{identifier}{LIBRARY}"] = library
    return archive_bytes(whole)


def _configurations(archive: Archive, root: Path) -> Sequence[BuildConfiguration]:
    path = root / "sources" / "buildDescription.xml"
    configurations: Sequence[BuildConfiguration]
    if not path.is_file():
        return list(archive.description.buildConfigurations)
    try:
        if b"<!DOCTYPE" in path.read_bytes():
            raise ValueError("it has a DOCTYPE")  # noqa: TRY301, as any other fault of it
        configurations = read_build_description(root, validate=False)
    except Exception as error:
        raise FmuError(
            f"{archive.label}: sources/buildDescription.xml cannot be read: {error}"
        ) from None
    return configurations


def _build(archive: Archive, listed: Sequence[SourceFileSet], files: Mapping[str, bytes]) -> _Build:
    """Return what is to be compiled; `FmuError` where it is not C, or not there."""
    units = [name for each in listed for name in each.sourceFiles]
    units = units or sorted(name for name in files if name.endswith(".c") and "/" not in name)
    for unit in units:
        if unit not in files:
            raise FmuError(f"{archive.label}: its description names sources/{unit}, which it lacks")
        if PurePosixPath(unit).suffix != ".c":
            raise FmuError(f"{archive.label}: sources/{unit}: is no C; compile it with its tool")
    defined = [d for each in listed for d in each.preprocessorDefinitions if not d.optional]
    included = [directory for each in listed for directory in each.includeDirectories]
    flags = [f"-D{d.name}" + (f"={d.value}" if d.value else "") for d in defined]
    flags += [f"-I{_inside(archive, directory)}" for directory in included]
    return _Build(tuple(f"./{unit}" for unit in units), tuple(flags))


def _inside(archive: Archive, directory: str) -> str:
    path = PurePosixPath(directory)
    if path.is_absolute() or ".." in path.parts:
        raise FmuError(f"{archive.label}: includes {directory}, which is not among its sources")
    return f"./{path}"
