"""The robots' bodies become plants: each FMU is loaded once, for all robots that have it."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from nrs_cosim.orchestrator.scenario.assets import FMU
from nrs_cosim.orchestrator.scenario.conversion import names_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.fmus import Plant
from nrs_cosim.plant_fmu.archives.archive import Archive, find_archive, look_up
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.variables import find_quantity, joints_of
from nrs_cosim.plant_fmu.bundled.builder import built_here
from nrs_cosim.plant_fmu.bundled.declaration import bundled_models
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.drives.probe import ROBOTS
from nrs_cosim.plant_fmu.drives.stepped import step_by_threads
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fleet import Fleet
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of
from nrs_cosim.plant_fmu.joints import Joint
from nrs_cosim.plant_fmu.plants import Body, DrivenPlants

Find = Callable[[str], Archive]
"""Returns the FMU that a scenario names; `FmuError` where there is none."""
_NO_PARAMETERS: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The robots whose plants differ in their parameters at most."""

    field: str
    """Where the scenario gives the plant."""
    plant: Plant
    archive: Archive
    rows: list[int]
    """The robots' positions, ascending, among those that are opened."""
    representatives: Sequence[int] = ()
    """The first robots of the group, whether they are opened or not."""
    uneven: bool = False
    """Whether the steps of the plants are of many lengths."""

    @property
    def is_apart(self) -> bool:
        """Whether the plants run in processes of their own: an FMU of others, if it may."""
        return self.plant.isolate and not self.archive.ours

    def threads(self, most: int) -> int:
        """Return how many of so many threads step the plants; all if they are said to bear it.

        What is in a library beside its instances, all threads have in common, and nobody sees it.
        """
        return most if self.archive.ours or self.plant.threads else 1

    @property
    def names(self) -> dict[str, Spec]:
        """What the scenario gives for quantities of ours."""
        return names_of(self.plant.variables)

    def joints(self, parameters: Mapping[str, Any] = _NO_PARAMETERS) -> tuple[Joint, ...]:
        """Return the joints of a robot whose FMU has these parameters; `FmuError` names a plant."""
        sizes = sizes_of(assignments(self.archive, parameters))
        with naming_field(self.field):
            q = find_quantity(self.archive, "q", self.names, sizes=sizes)
        return joints_of(self.archive, q)

    @property
    def driving(self) -> Driving:
        """How the scenario wants the plant to be driven."""
        return Driving.of(self.plant, uneven=self.uneven)


def group_by_archive(
    experiment: Experiment,
    robots: Sequence[int] | None = None,
    find: Find | None = None,
) -> list[Group]:
    """Read each FMU once; `FmuError` names the field and what is wrong.

    Rows are positions within the robots that are asked for, ascending; without them, of all. An
    FMU is looked for as `find` does, by default as `find_in`.
    """
    find = find or find_in(experiment)
    shared, uneven = experiment.scenario.plant, experiment.clock.period is None
    common, every = _group_key(shared), range(1, experiment.n + 1)
    row_of = {robot: row for row, robot in enumerate(every if robots is None else robots)}
    members: defaultdict[str, list[int]] = defaultdict(list)
    first: defaultdict[str, list[int]] = defaultdict(list)
    given: dict[str, tuple[str, Plant]] = {}
    # All robots, also where some are asked for: every worker has the same representatives.
    for robot in every:
        own = experiment.of_robot(robot)
        key = common if own.plant is shared else _group_key(own.plant)
        if len(first[key]) < ROBOTS:
            first[key].append(robot)
        if robot in row_of:
            given.setdefault(key, (own.field, own.plant))
            members[key].append(row_of[robot])
    groups = []
    for key, (field, plant) in given.items():
        with naming_field(field):
            archive = find(plant.fmu)
        groups.append(Group(field, plant, archive, members[key], first[key], uneven))
    return groups


def find_in(experiment: Experiment) -> Find:
    """Return what finds the FMUs of an experiment: relative to its folder, or where it has them."""

    def find(fmu: str) -> Archive:
        if fmu in experiment.fmus:
            return replace(find_archive(str(experiment.fmus[fmu]), Path()), label=fmu)
        return find_archive(fmu, experiment.folder)

    return find


def with_compiled_fmus(experiment: Experiment) -> Experiment:
    """Return an experiment whose FMUs with C sources alone are compiled: the user wants it."""
    from nrs_cosim.plant_fmu.archives.compilation import compiled  # noqa: PLC0415, of these alone

    fmus: dict[str, Path] = {}
    for fmu in dict.fromkeys(plant.fmu for plant in experiment.plants):
        if fmu not in experiment.fmus and fmu not in bundled_models():
            archive = look_up(fmu, experiment.folder)
            if archive.obstacle:
                fmus[fmu] = compiled(archive).path
    return experiment.but(fmus={**experiment.fmus, **fmus})


def find_recorded(
    plants: Sequence[Mapping[str, Any]], experiment: Experiment, *, others: bool = False
) -> Find:
    """Return what finds a recording's FMUs as it was made with them, given what it tells of them.

    An FMU of another SHA-256 is an `FmuError`: a recording is no reason to load what happens to be
    at a path. A bundled model that an earlier version built here is in the cache. `others` lets
    FMUs be found that it does not tell of.
    """
    recorded = {plant["fmu"]: plant["sha256"] for plant in plants}
    attached = {asset.name for asset in experiment.assets.values() if asset.media_type == FMU}
    look_for = find_in(experiment)

    def find(fmu: str) -> Archive:
        is_held = fmu in attached and fmu not in experiment.fmus
        advice = "; the recording has it, and --allow-fmus lets it run: native code" * is_held
        try:
            archive = look_for(fmu)
        except FmuError as error:
            raise FmuError(f"{error}{advice}") from None
        sha256 = recorded.get(fmu, archive.sha256 if others else None)
        if sha256 != archive.sha256 and fmu in bundled_models():
            other = built_here(fmu, sha256 or "")
            archive = replace(find_archive(str(other), Path()), label=fmu) if other else archive
        if sha256 != archive.sha256:
            if fmu in bundled_models():
                advice = (
                    ", which another version built, and the cache has not; without it, replay "
                    "--verify --agents-only verifies all but the plants"
                )
            raise FmuError(
                f"{archive.label} is not the FMU that the recording was made with: its SHA-256 is "
                f"{archive.sha256}, not {sha256}{advice}"
            )
        return archive

    return find


def open_fleet(
    stack: ExitStack,
    groups: Sequence[Group],
    bodies: Sequence[Body],
    representatives: Sequence[Sequence[Body]] | None = None,
    threads: int = 1,
) -> Fleet:
    """Load, instantiate and initialise all plants at t_0; the stack ends them.

    `representatives` are, for each group, bodies as `open_plants` has them. So many threads step
    those of which several may.
    """
    _expect_once(groups)
    opened = []
    for group, others in zip(groups, representatives or [()] * len(groups), strict=True):
        with naming_field(group.field):
            own = [bodies[row] for row in group.rows]
            opened.append(_open(stack, group, own, others, group.threads(threads)))
    rows = [np.array(group.rows) for group in groups]
    return Fleet(list(zip(rows, opened, strict=True)), len(bodies[0].q))


def _group_key(plant: Plant) -> str:
    """Return what plants of one group have in common."""
    # Not as JSON: pydantic would build the table's schema once more for it.
    return repr([(key, value) for key, value in plant if key != "parameters"])


def _open(
    stack: ExitStack,
    group: Group,
    bodies: Sequence[Body],
    representatives: Sequence[Body],
    threads: int,
) -> DrivenPlants:
    archive, names, driving = group.archive, group.names, group.driving
    if group.is_apart:
        from nrs_cosim.plant_fmu.isolation.isolated import (  # noqa: PLC0415, of these alone
            IsolatedPlants,
        )

        deadline = group.plant.deadline
        return IsolatedPlants(
            stack, archive, bodies, names, driving, deadline, representatives, threads
        )
    plants = open_plants(stack, archive, bodies, names, driving, representatives=representatives)
    step_by_threads(plants, threads)
    return plants


def _expect_once(groups: Sequence[Group]) -> None:
    """Raise `FmuError` for more instances in this process than an FMU allows."""
    here = Counter[str]()
    for group in groups:
        if group.is_apart or not group.archive.once_per_process:
            continue
        here[group.archive.sha256] += len(group.rows)
        if here[group.archive.sha256] > 1:
            raise FmuError(
                f"{group.field}: {group.archive.label}: can be instantiated only once per process, "
                f"but {here[group.archive.sha256]} robots have it and plant.isolate is false"
            )


@contextmanager
def naming_field(origin: str) -> Iterator[None]:
    """Put the field or the file that gives a plant before what is wrong with it."""
    try:
        yield
    except FmuError as error:
        raise FmuError(f"{origin}: {error}") from None
