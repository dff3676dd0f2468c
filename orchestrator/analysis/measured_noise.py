"""What noise on links came to in a run: means of squares beside what estimates settle to (N3)."""

from dataclasses import replace

import numpy as np

from nrs_cosim.estimator_agents.algorithm import nominal_of
from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.theory.aperiodic import Periods
from nrs_cosim.estimator_agents.theory.delays import LateStep
from nrs_cosim.estimator_agents.theory.estimates import SteadyMotion, steady_motion
from nrs_cosim.estimator_agents.theory.linear_step import linear_step
from nrs_cosim.orchestrator.analysis.convergence import lasting, recursions_of
from nrs_cosim.orchestrator.analysis.noise import NoiseAnalysis, delays_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import errors_by_tick

NORMAL_95 = 1.959964
"""Standard errors to each side that 95 of 100 normal numbers are within."""


def measured_noise(
    noise: NoiseAnalysis, reader: Reader, experiment: Experiment, periods: Periods
) -> NoiseAnalysis:
    """Return what noise comes to, with what it came to in the last fifth of a recording."""
    motion = _motion(experiment, periods)
    if noise.floor is None or motion is None:
        return noise
    clock, end = experiment.clock, reader.end_ns or 0
    fifth, squares, count, m = (
        clock.since(end - end // 5),
        np.zeros_like(noise.floor.variance),
        0,
        1,
    )
    for k, x in errors_by_tick(reader, experiment.target_at, clock.t(fifth)):
        beside = x - motion.at(k)[:, :2]
        squares, count = squares + (beside**2).mean(axis=-1).sum(axis=0), count + len(k)
        m = x.shape[-1]
    if not count:
        return noise
    around = NORMAL_95 * noise.floor.standard_error(count, m)
    variance = noise.floor.variance
    ends = np.stack([np.maximum(variance - around, 0), variance + around], axis=-1)
    return replace(noise, expected=np.sqrt(ends), measured=np.sqrt(squares / count))


def _motion(experiment: Experiment, periods: Periods) -> SteadyMotion | None:
    """Return what the errors settle to beside noise; None where it is not known."""
    topologies, target, h = experiment.topologies, experiment.target, periods.constant_period
    if not isinstance(target, Harmonic) or h is None:
        return None
    algorithm = nominal_of(experiment.algorithm)
    if len(topologies.digraphs) == 1:
        step = linear_step(algorithm, h)
        late = step and LateStep(step, topologies.links, delays_of(experiment))
        return late.steady_motion(target) if late else None
    recursion = lasting(recursions_of(algorithm, topologies, h), topologies)
    return steady_motion(recursion, target, 0.0) if recursion else None
