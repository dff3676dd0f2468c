"""A target's samples are there for the whole run: their times increase, and cover 0 to its end."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.text import nearest
from nrs_cosim.estimator_agents.target import Sampled
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.targets import FmuMotion, FmuTarget, SampledTarget
from nrs_cosim.orchestrator.scenario.times import wrong_times
from nrs_cosim.plant_fmu.archives.quantities import MOTION


def wrong_target(experiment: Experiment) -> Iterator[str]:
    """Yield what is wrong with a target's samples; before, its axes are not counted."""
    target = experiment.scenario.target
    if not isinstance(target, SampledTarget | FmuMotion):
        return
    wrong = _wrong_samples(target)
    yield from wrong
    if wrong:
        return
    times, end = target.times, _end(experiment)
    if isinstance(target, SampledTarget) and (times[0] > 0 or times[-1] < end):
        yield (
            f"target.times: expected times that cover 0 to {end!r} s, the end of the run, got "
            f"{times[0]!r} to {times[-1]!r} s; give samples of the rest, or a shorter run"
        )
    if not _is_finite(experiment):
        yield "target.positions: expected a motion of finite velocity and acceleration, got none"


def _end(experiment: Experiment) -> float:
    """Return the last sampling time, s; 0 where there is none, which is told elsewhere."""
    if any(wrong_times(experiment)):
        return 0.0
    clock = experiment.clock
    return seconds(clock.t(clock.ticks))


def wrong_variables(target: FmuTarget) -> Iterator[str]:
    """Yield which names of quantities are none of a target's."""
    for name in target.variables:
        if name not in MOTION:
            yield f"target.variables.{name}: no quantity of a target's{nearest(name, MOTION)}"


def unsampled_times(experiment: Experiment) -> Iterator[str]:
    """Yield the first sampling time at which an FMU that is the target was not looked at."""
    target, clock = experiment.scenario.target, experiment.clock
    if not isinstance(target, FmuMotion):
        return
    known = set(target.times)
    for k in range(clock.ticks + 1):
        t = seconds(clock.t(k))
        if t not in known:
            yield (
                f"target.fmu: its samples lack the sampling time {t!r} s; run the scenario from "
                f"its file, where the FMU is"
            )
            return


def _wrong_samples(target: SampledTarget | FmuMotion) -> list[str]:
    """Return the first thing that is wrong with samples."""
    times, tables = target.times, {"positions": target.positions}
    if len(times) < 2:
        return [
            f"target.times: expected two times at least, got {len(times)}; give times and "
            f"positions, or file"
        ]
    if isinstance(target, FmuMotion):
        tables["velocities"] = target.velocities
    for name, rows in tables.items():
        if len(rows) != len(times):
            return [
                f"target.{name}: expected {len(times)} rows, one for each of target.times, "
                f"got {len(rows)}"
            ]
    m = target.m
    wrong = [
        f"target.{name}[{i}]: expected {m} numbers, as in the first row, got {len(row)}"
        for name, rows in tables.items()
        for i, row in enumerate(rows)
        if len(row) != m
    ]
    wrong += [
        f"target.times[{i}]: expected times that increase, got {after!r} after {before!r}"
        for i, (before, after) in enumerate(pairwise(times), 1)
        if not before < after
    ]
    return wrong[:1]


def _is_finite(experiment: Experiment) -> bool:
    with np.errstate(all="ignore"):
        try:
            motion = experiment.target
        except ValueError:  # times so near to one another that there is no solution
            return False
        assert isinstance(motion, Sampled)
        return bool(
            np.all(np.isfinite(motion.cubics.coefficients)) and np.all(np.isfinite(motion.bounds()))
        )
