"""Which of our quantities an FMU has, as the scenario names them where that is not found."""

from collections.abc import Mapping

from plant_fmu.archives.archive import Archive
from plant_fmu.archives.naming import Spec
from plant_fmu.archives.quantities import Layout
from plant_fmu.archives.variables import NO_SIZES, find_quantity
from plant_fmu.errors import FmuError


def has(
    archive: Archive,
    names: Mapping[str, Spec],
    *quantities: str,
    sizes: Mapping[int, int] = NO_SIZES,
) -> bool:
    """Whether an FMU has all of these; `FmuError` where it lacks one that the scenario names."""
    for ours in quantities:
        try:
            find_quantity(archive, ours, names, sizes=sizes)
        except FmuError:
            if ours in names:
                raise
            return False
    return True


def takes(
    archive: Archive,
    names: Mapping[str, Spec],
    *quantities: str,
    sizes: Mapping[int, int] = NO_SIZES,
) -> bool:
    """Whether an FMU has all of these as inputs."""
    inputs = {
        variable.valueReference
        for variable in archive.description.modelVariables
        if variable.causality == "input" and variable.type in {"Real", "Float64"}
    }
    return has(archive, names, *quantities, sizes=sizes) and all(
        inputs.issuperset(Layout.of([find_quantity(archive, ours, names, sizes=sizes)]).references)
        for ours in quantities
    )
