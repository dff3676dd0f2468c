"""An FMU has a shared library for each platform that it runs on: one is for this machine, or none.

It is the file `binaries/<platform>/<modelIdentifier>` with the platform's suffix (FMI 2.0, section
2.3; FMI 3.0, section 2.5.1.4). Nothing else in that folder is one that FMI knows.
"""

from collections.abc import Sequence
from pathlib import PurePosixPath

import fmpy
from fmpy.model_description import ModelDescription

SUFFIXES = {".so", ".dll", ".dylib"}
_DEPTH = len(("binaries", "platform", "file"))


def obstacle(description: ModelDescription, names: Sequence[str]) -> str:
    """Return why an FMU with files of these names cannot run on this machine; nothing if it can."""
    interfaces = (description.coSimulation, description.modelExchange)
    offers = [interface for interface in interfaces if interface is not None]
    if not offers:
        alone = ", but ScheduledExecution alone" if description.scheduledExecution else ""
        return f"offers neither CoSimulation nor ModelExchange{alone}"
    here = fmpy.platform if description.fmiMajorVersion == 2 else fmpy.platform_tuple
    wanted = sorted(
        {f"binaries/{here}/{o.modelIdentifier}{fmpy.sharedLibraryExtension}" for o in offers}
    )
    if not set(wanted).isdisjoint(names):
        return ""
    paths = [PurePosixPath(name) for name in names]
    libraries = [p for p in paths if p.parts[:1] == ("binaries",) and p.suffix in SUFFIXES]
    libraries = [p for p in libraries if len(p.parts) == _DEPTH]
    lacking = f"has no library {' or '.join(wanted)} for this platform"
    if others := [str(p) for p in libraries if p.parts[1] == here]:
        return f"{lacking}; it has {', '.join(others)}, which is not named as its modelIdentifier"
    there = ", ".join(sorted({p.parts[1] for p in libraries}))
    has = f"libraries for {there}" if there else "no library at all"
    return f"{lacking}; it has {has}{_sources(paths)}"


def _sources(paths: Sequence[PurePosixPath]) -> str:
    """Return what can be done where an FMU has its sources, as the end of a sentence."""
    if any(p.parts[0] == "sources" and p.suffix in {".c", ".cpp"} for p in paths):
        return ", but sources: `fmpy compile` may build one from them (it needs CMake)"
    return ""
