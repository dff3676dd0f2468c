"""An FMU and the robots that have it become plants: loaded once, instantiated for each robot."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from plant_fmu.archive import Archive, unpacked
from plant_fmu.library import Library
from plant_fmu.plants import Body, Plants
from plant_fmu.reference_driven import ReferenceDrivenPlants


def open_plants(
    stack: ExitStack,
    archive: Archive,
    bodies: Sequence[Body],
    names: Mapping[str, str],
    load: Callable[[Archive, Path], Library] = Library,
) -> Plants:
    """Return the bodies' plants at t_0, in the bodies' order; the stack ends them.

    `names` gives the FMU's name for a quantity of ours where it has another. `FmuError` says what
    is wrong with the FMU or with what it was told.
    """
    folder = stack.enter_context(unpacked(archive))
    library = stack.enter_context(load(archive, folder))
    return ReferenceDrivenPlants(library, bodies, names)
