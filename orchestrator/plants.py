"""The robots' bodies become plants: each FMU is loaded once, for all robots that have it."""

from collections import defaultdict
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bus.errors import InputError
from estimator_agents.estimate import Estimate
from estimator_agents.target import Harmonic
from orchestrator.setting import Array, Body
from plant_fmu.archive import Archive, find_archive, unpacked
from plant_fmu.fleet import Fleet
from plant_fmu.library import Library
from plant_fmu.plants import Start
from plant_fmu.reference_driven import ReferenceDrivenPlants
from plant_fmu.variables import find_quantity

_WAVES = {
    "disturbance_amplitude": "amplitude",
    "disturbance_frequency": "frequency",
    "disturbance_phase": "phase",
}


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The robots that share an FMU and the names of its variables."""

    archive: Archive
    names: dict[str, str]
    rows: list[int]


def group_by_archive(bodies: list[Body], folder: Path) -> list[Group]:
    """Read each FMU once; `FmuError` names what is wrong with one. Row i is robot i + 1."""
    members: defaultdict[tuple[str, tuple[tuple[str, str], ...]], list[int]] = defaultdict(list)
    for row, body in enumerate(bodies):
        members[body.plant.fmu, tuple(sorted(body.plant.variables.items()))].append(row)
    return [
        Group(find_archive(fmu, folder), dict(names), rows)
        for (fmu, names), rows in members.items()
    ]


def open_fleet(
    stack: ExitStack, groups: list[Group], bodies: list[Body], references: Estimate
) -> Fleet:
    """Load, instantiate and initialise all plants at t_0; the stack ends them."""
    m = references.position.shape[1]
    opened = []
    for group in groups:
        folder = stack.enter_context(unpacked(group.archive))
        library = stack.enter_context(Library(group.archive, folder))
        starts = [Start(row + 1, _start(group, bodies[row], references, row)) for row in group.rows]
        opened.append(
            (np.array(group.rows), ReferenceDrivenPlants(library, m, starts, group.names))
        )
    return Fleet(opened, m)


def _start(group: Group, body: Body, references: Estimate, row: int) -> dict[str, Array]:
    """Return what one robot's FMU is told before its run, by our names of the variables."""
    return {
        **{name: np.asarray(value, float) for name, value in body.plant.parameters.items()},
        "kp": body.kp,
        "kd": body.kd,
        **(_disturbance(group, body.disturbance) if body.disturbance.moves else {}),
        "q": body.q,
        "qd": body.qd,
        "position_ref": references.position[row],
        "velocity_ref": references.velocity[row],
    }


def _disturbance(group: Group, disturbance: Harmonic) -> dict[str, Array]:
    m, p = disturbance.amplitude.shape
    terms = {
        ours: find_quantity(group.archive, group.names.get(ours, ours)).size // m for ours in _WAVES
    }
    if p > min(terms.values()):
        raise InputError(
            f"disturbance.axes: {group.archive.label} takes up to {min(terms.values())} sines and "
            f"cosines on an axis, got {p}"
        )
    waves = {
        ours: np.pad(getattr(disturbance, name), ((0, 0), (0, terms[ours] - p)))
        for ours, name in _WAVES.items()
    }
    return {
        "disturbance_offset": disturbance.offset,
        "disturbance_rate": disturbance.rate,
        **waves,
    }
