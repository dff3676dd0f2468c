"""Where a scenario asks for more than a URDF's limits of joints, which act with stops alone."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.plurals import numbered
from nrs_cosim.orchestrator.engine.plants import group_by_archive
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.plant_fmu.urdf_limits import position_limits

Array = NDArray[np.float64]

_TIMES = 2001
"""Of the run, at which the target is looked at."""
_SPANS = 8


def beyond_limits(experiment: Experiment) -> list[str]:
    """Say of which robots the target, or their start, is beyond their URDFs' limits of joints.

    Bundled models have none. Raises `FmuError` where a plant is not found.
    """
    plants = [experiment.scenario.plant, *(r.plant for r in experiment.scenario.robots if r.plant)]
    if not any(plant.fmu and plant.fmu.endswith(".fmu") for plant in plants):
        return []
    clock, found = experiment.clock, []
    target, _ = experiment.target_at(np.linspace(0, seconds(clock.t(clock.ticks)), _TIMES))
    for group in group_by_archive(experiment):
        robots = [row + 1 for row in group.rows]
        names = [joint.name for joint in group.joints()]
        try:
            limits = position_limits(group.archive.urdf, names)
        except ValueError:  # it is not of a URDF
            continue
        if len(limits) != experiment.m:  # it is no plant of this scenario, and is refused as one
            continue
        starts = np.array([body.q for body in experiment.bodies(robots)])
        outside = np.flatnonzero(((starts < limits[:, 0]) | (starts > limits[:, 1])).any(axis=1))
        begun = [robots[row] for row in outside]
        for what, who, q in (("the target", robots, target), ("a start", begun, starts[outside])):
            if who and (beyond := _beyond(names, limits, q)):
                found.append(
                    f"{what} comes beyond the limits of {numbered('robot', who, _SPANS)}'s joints: "
                    f"{', '.join(beyond)}; they act on robots with stops alone (nrs fmu from-urdf "
                    "--stops)"
                )
    return found


def _beyond(names: Sequence[str], limits: Array, q: Array) -> list[str]:
    """Say of each joint that positions q, (rows, m), leave its limits (m, 2), how far they go."""
    ends = np.stack([q.min(axis=0), q.max(axis=0)], axis=1)
    past = (limits - ends) * [1, -1] > 0
    return [
        f"{name} ({least:g} to {most:g}: {' and '.join(f'to {end:.4g}' for end in by[is_past])})"
        for name, (least, most), by, is_past in zip(names, limits, ends, past, strict=True)
        if is_past.any()
    ]
