"""A joint is stiff where its gain is large for its inertia: q̇ settles at the rate (M⁻¹)_ii Kd_ii.

Explicit methods take steps of a few times 1/rate, however smooth the motion is: over a period h
some 2 h rate right-hand sides. What settles within a 50th of a period costs no more than others.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.bus.plurals import numbered
from nrs_cosim.bus.text import shortened
from nrs_cosim.orchestrator.analysis.convergence import periods_of
from nrs_cosim.orchestrator.analysis.plant_bounds import Find, alike
from nrs_cosim.orchestrator.scenario.conversion import gains, names_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.fmus import Plant
from nrs_cosim.plant_fmu.bundled.bounds import bounds_of

STIFF, ENOUGH = 500.0, 50.0
"""Of rate times sampling period: what is told, and what is proposed."""

Mobility = Callable[[Plant, int], Sequence[float]]
"""Returns the largest known (M⁻¹)_ii of each joint of a plant that is not bundled, or none."""


@dataclass(frozen=True, slots=True)
class Stiffness:
    """Robots with the same plant and gains, of which a joint is stiff."""

    robots: tuple[int, ...]
    joint: str
    """The stiffest."""
    rate: float
    """1/s"""
    per_period: float
    """How often it settles within a sampling period."""
    kp: tuple[float, ...]
    """What is proposed for each joint, N m/rad."""
    kd: tuple[float, ...]
    """N m s/rad"""

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return asdict(self)

    def sentence(self) -> str:
        """Say what is stiff, and what would not be."""
        kp, kd = (", ".join(f"{value:g}" for value in gain) for gain in (self.kp, self.kd))
        return (
            f"{numbered('robot', self.robots, 8)}: {self.joint} is stiff: kd over its inertia is "
            f"{self.rate:.2g} per s, {self.per_period:.2g} times in a sampling period; "
            f"kp = [{kp}] and kd = [{kd}] would settle within a {ENOUGH:g}th of it, at less cost"
        )


def stiffness(experiment: Experiment, mobility: Mobility) -> list[Stiffness]:
    """Return an experiment's robots that are stiff, those together that are alike."""
    period, found = periods_of(experiment).longest, []
    for robots in alike(experiment):
        own, m = experiment.of_robot(robots[0]), experiment.m
        if own.controller.frequency is not None:  # it is the rate that was asked for
            continue
        p3 = bounds_of(own.plant.fmu, own.plant.parameters, m)
        sizes = np.array(p3.mobility if p3 else mobility(own.plant, robots[0]))
        if len(sizes) != m:
            continue
        kp, kd = (value.diagonal() for value in gains(own.controller, m))
        rates = sizes * kd
        worst = int(np.argmax(rates))
        if rates[worst] * period <= STIFF:
            continue
        parts = np.minimum(1.0, ENOUGH / (period * rates))
        softer = (tuple(float(f"{x:.2g}") for x in values * parts) for values in (kp, kd))
        joint = _joint(experiment, own.plant, worst)
        rate = float(rates[worst])
        found.append(Stiffness(tuple(robots), joint, rate, rate * period, *softer))
    return found


def sampled_mobility(find: Find | None) -> Mobility:
    """Return what tells it of plants whose P3 is sampled."""

    def mobility(plant: Plant, robot: int) -> Sequence[float]:
        p3 = find(plant, robot) if find else ""
        return () if isinstance(p3, str) else p3.mobility

    return mobility


def mobility_at_start(experiment: Experiment) -> Mobility:
    """Return what tells it of FMUs that were built here, by small pushes where a robot starts."""

    def mobility(plant: Plant, robot: int) -> Sequence[float]:
        from nrs_cosim.orchestrator.engine.plants import find_in  # noqa: PLC0415, it opens FMUs
        from nrs_cosim.plant_fmu.checking.findings import CheckTask  # noqa: PLC0415, as above
        from nrs_cosim.plant_fmu.checking.sampling import start_mobility  # noqa: PLC0415, as above

        try:
            archive = find_in(experiment)(plant.fmu)
            (body,) = experiment.bodies([robot])
            task = CheckTask(archive, body, names_of(plant.variables))
            return start_mobility(task) if archive.ours else ()
        except CosimError:  # what is wrong of it is told where it is opened
            return ()

    return mobility


def _joint(experiment: Experiment, plant: Plant, number: int) -> str:
    from nrs_cosim.orchestrator.engine.plants import find_in  # noqa: PLC0415, it opens FMUs

    joints = find_in(experiment)(plant.fmu).joints
    return f"joint {number + 1}" + (f" ({shortened(joints[number].name)})" if joints else "")
