"""The robots' bodies become plants: each FMU is loaded once, for all robots that have it."""

from collections import defaultdict
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orchestrator.scenario import Plant
from plant_fmu.archive import Archive, find_archive
from plant_fmu.fleet import Fleet
from plant_fmu.opening import open_plants
from plant_fmu.plants import Body


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The robots that share an FMU and the names of its variables."""

    archive: Archive
    names: dict[str, str]
    rows: list[int]


def group_by_archive(plants: Sequence[Plant], folder: Path) -> list[Group]:
    """Read each FMU once; `FmuError` names what is wrong with one. Row i is robot i + 1."""
    members: defaultdict[tuple[str, tuple[tuple[str, str], ...]], list[int]] = defaultdict(list)
    for row, plant in enumerate(plants):
        members[plant.fmu, tuple(sorted(plant.variables.items()))].append(row)
    return [
        Group(find_archive(fmu, folder), dict(names), rows)
        for (fmu, names), rows in members.items()
    ]


def open_fleet(stack: ExitStack, groups: Sequence[Group], bodies: Sequence[Body]) -> Fleet:
    """Load, instantiate and initialise all plants at t_0; the stack ends them."""
    opened = [
        (
            np.array(group.rows),
            open_plants(stack, group.archive, [bodies[row] for row in group.rows], group.names),
        )
        for group in groups
    ]
    return Fleet(opened, len(bodies[0].q))
