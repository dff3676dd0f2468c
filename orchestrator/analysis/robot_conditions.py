"""Conditions on a scenario's robots that no eigenvalue is in: their gains, and who hears whom."""

import numpy as np

from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.orchestrator.scenario.conversion import gain
from nrs_cosim.orchestrator.scenario.experiment import Experiment

POSITIVE = "positive definite"


def graph_conditions(experiment: Experiment) -> list[Condition]:
    """Return the algorithm's conditions on who hears whom: of several digraphs, the nearest."""
    byzantine = frozenset(experiment.byzantine)
    found = [
        experiment.algorithm.graph_conditions(digraph, byzantine)
        for digraph in experiment.topologies.digraphs
    ]
    return [min(same, key=lambda c: c.margin) for same in zip(*found, strict=True)]


def gain_conditions(experiment: Experiment) -> list[Condition]:
    """Return that all robots' PD gains are positive definite: 0 < min x'Kx over |x| = 1."""
    scenario = experiment.scenario
    controllers = [
        scenario.controller,
        *(experiment.of_robot(robot.id).controller for robot in scenario.robots),
    ]
    conditions = []
    for name in ("kp", "kd"):
        gains = [gain(getattr(controller, name), experiment.m) for controller in controllers]
        smallest = min(float(np.linalg.eigvalsh((K + K.T) / 2)[0]) for K in gains)
        conditions.append(Condition(name, POSITIVE, 0.0, smallest, at_least=True))
    return conditions
