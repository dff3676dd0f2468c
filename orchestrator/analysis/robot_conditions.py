"""Conditions on a scenario's robots that no eigenvalue is in: gains, and the digraph."""

import numpy as np

from nrs_cosim.bus.clock import seconds
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.theory.honest_hull import HonestHull, honest_hull
from nrs_cosim.orchestrator.scenario.conversion import gains
from nrs_cosim.orchestrator.scenario.experiment import Experiment

POSITIVE = "positive definite"


def graph_conditions(experiment: Experiment) -> list[Condition]:
    """Return the algorithm's conditions on the digraph: of several, the nearest."""
    byzantine = frozenset(experiment.byzantine)
    found = [
        experiment.algorithm.graph_conditions(digraph, byzantine)
        for digraph in experiment.topologies.digraphs
    ]
    return [min(same, key=lambda c: c.margin) for same in zip(*found, strict=True)]


def hull_of(experiment: Experiment) -> HonestHull | None:
    """Return what the honest robots' estimates stay within; None where that is not known."""
    liars = experiment.byzantine
    received = [
        np.bincount(t.sink[np.isin(t.source, liars) & ~np.isin(t.sink, liars)], minlength=1).max()
        for t in experiment.topologies.digraphs
    ]
    if experiment.impaired or not experiment.algorithm.stays_within(int(max(received))):
        return None
    clock = experiment.clock
    times = np.array([seconds(clock.t(k)) for k in range(clock.ticks + 1)])
    honest = [robot for robot in range(1, experiment.n + 1) if robot not in {*liars}]
    return honest_hull(times, experiment.initial_estimates(honest), experiment.target.at(times[1:]))


def gain_conditions(experiment: Experiment) -> list[Condition]:
    """Return that all robots' PD gains are positive definite: 0 < min x'Kx over |x| = 1.

    Those of a frequency and a damping, which no scenario has at or below 0, always are.
    """
    scenario = experiment.scenario
    controllers = [
        scenario.controller,
        *(experiment.of_robot(robot.id).controller for robot in scenario.robots),
    ]
    conditions = []
    both = zip(*(gains(c, experiment.m) for c in controllers if c.frequency is None), strict=True)
    for name, given in zip(("kp", "kd"), both, strict=False):
        smallest = min(float(np.linalg.eigvalsh((K + K.T) / 2)[0]) for K in given)
        conditions.append(Condition(name, POSITIVE, 0.0, smallest, at_least=True))
    return conditions
