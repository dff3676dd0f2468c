"""Which of our quantities an FMU has, by the names that the scenario gives where they differ."""

from collections.abc import Mapping

from plant_fmu.archive import Archive
from plant_fmu.errors import FmuError
from plant_fmu.variables import Quantity, find_quantity


def has(archive: Archive, names: Mapping[str, str], *quantities: str) -> bool:
    """Whether an FMU has all of these; `FmuError` where it lacks one that the scenario names."""
    for ours in quantities:
        try:
            find_quantity(archive, names.get(ours, ours))
        except FmuError:
            if ours in names:
                raise
            return False
    return True


def takes(archive: Archive, names: Mapping[str, str], *quantities: str) -> bool:
    """Whether an FMU has all of these as inputs."""
    inputs = {
        variable.valueReference
        for variable in archive.description.modelVariables
        if variable.causality == "input" and variable.type in {"Real", "Float64"}
    }
    return has(archive, names, *quantities) and all(
        inputs.issuperset(find_quantity(archive, names.get(ours, ours)).references)
        for ours in quantities
    )


def vector(archive: Archive, names: Mapping[str, str], ours: str, m: int) -> Quantity:
    """Return a quantity that must hold m numbers."""
    name = names.get(ours, ours)
    quantity = find_quantity(archive, name)
    if quantity.size != m:
        raise FmuError(
            f"{archive.label}: {name} holds {quantity.size} numbers, expected {m}, one "
            f"for each of the target's axes"
        )
    return quantity
