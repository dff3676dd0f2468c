"""Robots whose joints are in unlike units run together, yet no one number measures them all.

Nor is a joint measured whose q and q̇ are in units of their own.
"""

from collections import defaultdict
from collections.abc import Iterable

from nrs_cosim.orchestrator.engine.plants import group_by_archive
from nrs_cosim.orchestrator.scenario import robot_ids
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.plant_fmu.drives.rate import NOT_THE_RATE


def mixed_units(experiment: Experiment) -> str:
    """Say which robots' joints are in which units, where they differ; else return an empty text.

    An FMU that gives no units says nothing of them. Raises `FmuError` where a plant is not found.
    """
    if not any(robot.plant for robot in experiment.scenario.robots):
        return ""
    robots: defaultdict[str, list[int]] = defaultdict(list)
    for group in group_by_archive(experiment):
        units = dict.fromkeys(j.unit for j in group.joints() if j.unit)
        if units:
            robots[" and ".join(units)] += [row + 1 for row in group.rows]
    if len(robots) < 2:
        return ""
    robots_by_unit = ", ".join(
        f"{robot_ids.named(sorted(rows))} in {unit}" for unit, rows in robots.items()
    )
    return f"joints are in unlike units: {robots_by_unit}; a number over all robots mixes them"


def other_rates(drives: Iterable[tuple[str, str]]) -> list[str]:
    """Say of which FMUs q̇ is not the rate of q, by what is told of how each is driven."""
    parts = ((fmu, *drive.partition(NOT_THE_RATE)[1:]) for fmu, drive in drives)
    return [
        f"{fmu}: {''.join(found)}; nrs fmu check looks at it" for fmu, *found in parts if found[0]
    ]
