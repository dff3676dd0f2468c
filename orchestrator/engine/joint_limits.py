"""Where a scenario asks for more than a URDF's limits of joints, which act with stops alone."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.plurals import numbered
from nrs_cosim.orchestrator.engine.plants import group_by_archive
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.plant_fmu.urdf_limits import has_stops, position_limits

Array = NDArray[np.float64]

_TIMES = 2001
"""Of the run, at which the target is looked at."""
_SPANS = 8
_WITHOUT = "they act on robots with stops alone (nrs fmu from-urdf --stops)"
_ACTING = "the robots' soft stops act there"


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
        stops = has_stops(group.archive.description.description)
        of = numbered("robot", robots, _SPANS)
        for what, beyond in (
            (f"the target comes beyond the limits of {of}'s joints", _ends(names, limits, target)),
            ("starts are beyond the limits of joints", _starts(names, limits, starts, robots)),
        ):
            if beyond:
                found.append(f"{what}: {', '.join(beyond)}; {_ACTING if stops else _WITHOUT}")
    return found


def _ends(names: Sequence[str], limits: Array, q: Array) -> list[str]:
    """Say of each joint that positions q, (rows, m), leave its limits (m, 2), how far they go."""
    ends = np.stack([q.min(axis=0), q.max(axis=0)], axis=1)
    past = (limits - ends) * [1, -1] > 0
    return [
        f"{name} ({least:g} to {most:g}: {' and '.join(f'to {end:.4g}' for end in by[is_past])})"
        for name, (least, most), by, is_past in zip(names, limits, ends, past, strict=True)
        if is_past.any()
    ]


def _starts(names: Sequence[str], limits: Array, q: Array, robots: Sequence[int]) -> list[str]:
    """Say of each joint which robots start beyond its limits (m, 2), and at which of q, (n, m)."""
    found = []
    for name, (least, most), starts in zip(names, limits, q.T, strict=True):
        at: defaultdict[str, list[int]] = defaultdict(list)
        for row in np.flatnonzero((starts < least) | (starts > most)).tolist():
            at[f"{starts[row]:.4g}"].append(robots[row])
        shown = [f"{numbered('robot', of, _SPANS)} at {q}" for q, of in [*at.items()][:_SPANS]]
        if shown:
            more = ", …" * (len(at) > _SPANS)
            found.append(f"{name} ({least:g} to {most:g}): {', '.join(shown)}{more}")
    return found
