"""Which of our quantities an FMU has, as the scenario names them where that is not found."""

from collections.abc import Mapping, Sequence

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.quantities import TYPES, NumberLayout
from nrs_cosim.plant_fmu.archives.variables import NO_SIZES, find_quantity, table_of
from nrs_cosim.plant_fmu.errors import FmuError

VECTORS = ("q", "qd", "tau", "position_ref", "velocity_ref", "acceleration_ref", "tau_applied")
"""Of m numbers each, of a robot."""


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


def why_not(
    archive: Archive, names: Mapping[str, Spec], ours: str, sizes: Mapping[int, int]
) -> str:
    """Return why an FMU has not a quantity; nothing when it has."""
    try:
        find_quantity(archive, ours, names, sizes=sizes)
    except FmuError as error:
        return str(error)
    return ""


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
        if variable.causality == "input" and variable.type in TYPES
    }
    return has(archive, names, *quantities, sizes=sizes) and all(
        inputs.issuperset(
            NumberLayout.of([find_quantity(archive, ours, names, sizes=sizes)]).references
        )
        for ours in quantities
    )


def expect_apart(
    archive: Archive,
    names: Mapping[str, Spec],
    sizes: Mapping[int, int],
    quantities: Sequence[str] = VECTORS,
) -> None:
    """Raise `FmuError` when two of our quantities stand for one number of the FMU's."""
    taken: dict[tuple[int, int], str] = {}
    for ours in quantities:
        if not has(archive, names, ours, sizes=sizes):
            continue
        for part in find_quantity(archive, ours, names, sizes=sizes).parts:
            for number in range(part.first, part.first + part.size):
                other = taken.get((part.reference, number))
                if other is not None:
                    raise FmuError(
                        f"{archive.label}: {other} and {ours} stand for the same number of the "
                        f"FMU's; see the scenario's {table_of(ours)}.variables"
                    )
                taken[part.reference, number] = ours
