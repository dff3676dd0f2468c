"""ρ over both gains of a scenario, around its own: how far from divergence they are."""

from dataclasses import replace
from math import isfinite

import numpy as np

from nrs_cosim.orchestrator.analysis.conditions import Check
from nrs_cosim.orchestrator.analysis.convergence import spectra_of
from nrs_cosim.orchestrator.analysis.designs import free_gains
from nrs_cosim.orchestrator.analysis.link_designs import factor_at
from nrs_cosim.orchestrator.analysis.link_faults import lasting_digraph, link_faults_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.report.subject import GainMap

POINTS, LATE_POINTS, BEYOND = 21, 11, 1.25
"""Of each gain, and over late links; and how far beyond its bound, or twice its value, they go."""
ROBOTS, LATE_ROBOTS = 200, 20
"""Up to how many robots it is made; and over links that are late."""
GAINS = ("alpha", "beta")


@np.errstate(all="ignore")  # what overflows is infinite, or not a number: it diverges
def gain_map(experiment: Experiment, checked: Check) -> GainMap | None:
    """Return it; None where it is not of one digraph at a constant period, or takes its time."""
    algorithm, h = experiment.algorithm, checked.periods.constant_period
    single = h is not None and lasting_digraph(experiment.topologies) is not None
    known = single and not experiment.byzantine and free_gains(algorithm) == [*GAINS]
    if not known or experiment.n > (LATE_ROBOTS if experiment.impaired else ROBOTS):
        return None
    if experiment.impaired and link_faults_of(experiment).loss.any():
        return None
    assert h is not None
    spectra = spectra_of(experiment.topologies)[-1]
    own = tuple(float(getattr(algorithm, name)) for name in GAINS)
    points, axes = LATE_POINTS if experiment.impaired else POINTS, []
    for name, value in zip(GAINS, own, strict=True):
        bounds = [c.bound for c in checked.conditions if c.name == name and isfinite(c.bound)]
        most = BEYOND * max(value, *(bounds or [2 * value]))
        axes.append((np.arange(points) + 0.5) * most / points)
    radius = np.array(
        [
            [
                factor_at(
                    experiment.with_algorithm(replace(algorithm, alpha=alpha, beta=beta)),  # type: ignore[type-var]
                    spectra,
                    h,
                )
                for alpha in axes[0].tolist()
            ]
            for beta in axes[1].tolist()
        ]
    )
    if not np.isfinite(radius).any():
        return None
    return GainMap(GAINS, (axes[0], axes[1]), radius, (own[0], own[1]))
