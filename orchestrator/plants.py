"""The robots' bodies become plants: each FMU is loaded once, for all robots that have it."""

from collections import defaultdict
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orchestrator.scenario import Plant
from plant_fmu.archive import Archive, find_archive
from plant_fmu.errors import FmuError
from plant_fmu.fleet import Fleet
from plant_fmu.isolated import IsolatedPlants
from plant_fmu.opening import open_plants
from plant_fmu.plants import Body, Plants

_Shared = tuple[str, tuple[tuple[str, str], ...], bool, float]
"""What robots of one group have in common: FMU, names, isolate, deadline."""


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The robots that share an FMU, the names of its variables, and how it is run."""

    archive: Archive
    names: dict[str, str]
    rows: list[int]
    isolate: bool
    deadline: float


def group_by_archive(plants: Sequence[Plant], folder: Path) -> list[Group]:
    """Read each FMU once; `FmuError` names what is wrong with one. Row i is robot i + 1."""
    members: defaultdict[_Shared, list[int]] = defaultdict(list)
    for row, plant in enumerate(plants):
        names = tuple(sorted(plant.variables.items()))
        members[plant.fmu, names, plant.isolate, plant.deadline].append(row)
    return [
        Group(find_archive(fmu, folder), dict(names), rows, isolate, deadline)
        for (fmu, names, isolate, deadline), rows in members.items()
    ]


def open_fleet(stack: ExitStack, groups: Sequence[Group], bodies: Sequence[Body]) -> Fleet:
    """Load, instantiate and initialise all plants at t_0; the stack ends them."""
    opened = [
        (np.array(group.rows), _open(stack, group, [bodies[row] for row in group.rows]))
        for group in groups
    ]
    return Fleet(opened, len(bodies[0].q))


def _open(stack: ExitStack, group: Group, bodies: Sequence[Body]) -> Plants:
    """Open a group's plants: an FMU of ours in this process, one of others isolated if it may."""
    archive = group.archive
    if group.isolate and not archive.ours:
        return IsolatedPlants(stack, archive, bodies, group.names, group.deadline)
    if archive.once_per_process and len(bodies) > 1:
        raise FmuError(
            f"{archive.label}: can be instantiated only once per process, but {len(bodies)} robots "
            f"have it and plant.isolate is false"
        )
    return open_plants(stack, archive, bodies, group.names)
