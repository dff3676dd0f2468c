"""How large errors are in the mean square over links that lose samples: expected, and in a run.

Expected are the second moments of statement L6, over all that may be lost; measured is one run's
last fifth, of which they are the mean in steady state.
"""

from dataclasses import dataclass

import numpy as np

from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.theory.loss import mean_square_radius
from nrs_cosim.estimator_agents.theory.second_moments import second_moments
from nrs_cosim.orchestrator.analysis.convergence import periods_of
from nrs_cosim.orchestrator.analysis.link_faults import link_faults_of
from nrs_cosim.orchestrator.analysis.link_recursions import lossy_recursion
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import errors_by_tick

FORGOTTEN = 1e-3
"""What may be left of the beginning, in the mean square, where the last fifth begins."""


@dataclass(frozen=True, slots=True)
class RootMeanSquare:
    """Of the errors of one quantity: of all robots, and of each."""

    name: str
    expected: float
    measured: float
    robots_expected: tuple[float, ...]
    robots_measured: tuple[float, ...]


def root_mean_squares(reader: Reader, experiment: Experiment) -> tuple[RootMeanSquare, ...]:
    """Return those of positions and velocities; none where nothing is expected of a run."""
    if not experiment.impaired:
        return ()
    target, clock, end = experiment.target, experiment.clock, reader.ticks
    faults, periods = link_faults_of(experiment), periods_of(experiment)
    known = lossy_recursion(experiment, faults, periods)
    rounded = any(fault.quantisation for fault in experiment.link_faults.values())
    if known is None or not isinstance(target, Harmonic) or faults.noisy or rounded:
        return ()
    step, lossy = known
    first = clock.since(clock.t(end) - clock.t(end) // 5)
    radius = mean_square_radius([lossy]).upper
    if not radius < 1 or radius ** (first - faults.since) > FORGOTTEN:
        return ()
    expected = second_moments(lossy, step, experiment.n, target)
    if expected is None:
        return ()
    total, ticks = np.zeros_like(expected.mean[:2]), 0
    for _, errors in errors_by_tick(reader, experiment.target_at, clock.t(first)):
        total, ticks = total + (errors**2).sum(axis=0), ticks + len(errors)
    if not ticks:
        return ()
    names, measured = ("eps - eps_0", "ups - ups_0"), total / ticks
    return tuple(
        RootMeanSquare(
            name,
            float(np.sqrt(mean.mean())),
            float(np.sqrt(seen.mean())),
            tuple(np.sqrt(mean.mean(axis=1)).tolist()),
            tuple(np.sqrt(seen.mean(axis=1)).tolist()),
        )
        for name, mean, seen in zip(names, expected.mean + expected.spread, measured, strict=False)
    )
