"""A scenario whose target does the worst that `check` bounds: on the first axis to the positions of
the estimates, on the second to their velocities, both at one sampling time near the run's end.
Estimates begin at the target.
"""

from typing import Any

import numpy as np

from nrs_cosim.bus.errors import InputError
from nrs_cosim.estimator_agents.target import Sampled
from nrs_cosim.estimator_agents.theory.worst_target import worst_targets
from nrs_cosim.orchestrator.analysis.bounds import UltimateBounds
from nrs_cosim.orchestrator.analysis.convergence import lasting
from nrs_cosim.orchestrator.scenario.experiment import Experiment


def worst_target_changes(experiment: Experiment, ultimate: UltimateBounds) -> dict[str, Any]:
    """Return the keys of a scenario that give it its worst target, with their values.

    `InputError` where the worst case is not computed, or no target is known that attains it.
    """
    recursions = ultimate.recursions
    recursion = lasting(recursions, experiment.topologies) if recursions else None
    none = f"{experiment.name}: no target is known that attains the worst case"
    if ultimate.why_not:
        raise InputError(f"{none}: {ultimate.why_not}")
    if recursion is None or ultimate.aperiodic or ultimate.added:
        why = ultimate.why_loose or (
            "sampling periods are not constant"
            if ultimate.aperiodic
            else "what robots receive is not what was sent, or not at each sampling time"
        )
        raise InputError(f"{none}: {why}")
    gammas = ultimate.gamma_1, ultimate.gamma_2
    found = worst_targets(recursion, *gammas, ultimate.radius)
    motions = [one for one in found if one is not None]
    if not motions:
        raise InputError(f"{none}: it is not computed for so many robots or so long a memory")
    first, second = motions[0], motions[-1]
    times = np.union1d(first.times, second.times)
    motions = [first, second, *[first] * experiment.m][: experiment.m]
    each = [Sampled.of(one.times, one.positions[:, None]).at(times) for one in motions]
    positions = np.concatenate([one.position for one in each], axis=1)
    return {
        "target.kind": "sampled",
        "target.times": times.tolist(),
        "target.positions": positions.tolist(),
        "initial.position": positions[0].tolist(),
        "initial.velocity": [float(one.velocity[0, 0]) for one in each],
        "run.duration": round((max(first.tick, second.tick) + 1) * recursion.h, 9),
    }
