"""What noise and rounding on links come to: how far estimates stay from what they settle to.

Before a run it is the standard deviation of each number of a robot's estimate (statements N1, N2);
after one also the root of the mean of squares over the last fifth, beside where it is expected in
95 of 100 runs (N3).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.links.links import LinkFault
from nrs_cosim.bus.topologies import InteractionGraphs
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import nominal_of
from nrs_cosim.estimator_agents.theory.aperiodic import Periods
from nrs_cosim.estimator_agents.theory.delays import LateStep
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep, linear_step
from nrs_cosim.estimator_agents.theory.noise import NoiseFloor, noise_floor, received_covariance
from nrs_cosim.estimator_agents.theory.received_errors import Added, rounding_errors
from nrs_cosim.estimator_agents.theory.recursion import recursion_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment

Array = NDArray[np.float64]

PAIR = ("position", "velocity")


@dataclass(frozen=True, slots=True, eq=False)
class NoiseAnalysis:
    """What noise on links comes to in steady state, and came to in a run."""

    source: str
    """The statement from which it follows."""
    why_not: str = ""
    """Why it is not known; empty where it is."""
    floor: NoiseFloor | None = None
    expected: Array | None = None
    """(2, n, 2) between what the roots of the means of squares are in 95 of 100 such runs."""
    measured: Array | None = None
    """(2, n) what they were in the last fifth; None before a run, and where the motion that the
    estimates settle to beside the noise is not known."""

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON: lists by robot."""
        return {
            "source": self.source,
            "why_not": self.why_not,
            "deviation": _pairs(None if self.floor is None else self.floor.deviation),
            "expected": _pairs(self.expected),
            "measured": _pairs(self.measured),
        }


def noise_analysis(experiment: Experiment, periods: Periods) -> NoiseAnalysis | None:
    """Return what noise comes to; None where there is none on links."""
    faults = experiment.link_faults
    if not any(fault.noise for fault in faults.values()):
        return None
    topologies, h = experiment.topologies, periods.constant_period
    algorithm = nominal_of(experiment.algorithm)
    step = None if h is None else linear_step(algorithm, h)
    found = NoiseAnalysis("statement N2" if topologies.switching else "statement N1")
    if step is None or h is None:
        why = "periodic sampling" if h is None else "algorithms that are known to be linear"
        return replace(found, why_not=f"it is computed of {why} alone")
    late = any(fault.delay != (0, 0) for fault in faults.values())
    reasons = {
        "robots lie": bool(experiment.byzantine),
        "robots decide when they send": experiment.algorithm.TRIGGERED,
        "links lose samples": any(fault.loss for fault in faults.values()),
        "delays are drawn": any(low != high for low, high in (f.delay for f in faults.values())),
        "of several digraphs it is computed without delays alone": late
        and not topologies.is_constant,
    }
    why = next((why for why, so in reasons.items() if so), "")
    if why:
        return replace(found, why_not=why)
    if topologies.switching:
        order = [e for e, count in topologies.phases() for _ in range(count)]
    else:
        order = [len(topologies.exchanges) - 1]
    of_exchange = {e: _tick(experiment, step, topologies.exchanges[e]) for e in {*order}}
    floor = noise_floor([of_exchange[e] for e in order], topologies.n)
    if floor is None:
        return replace(found, why_not="the estimates do not converge, or robots are too many")
    return replace(found, floor=floor)


def _tick(
    experiment: Experiment, step: LinearStep, exchange: InteractionGraphs
) -> tuple[Any, Array]:
    """Return A and Q of a tick at which an exchange holds."""
    over = {
        name: exchange.velocity if name == "velocity" else exchange.position for name in step.sent
    }
    variances = {name: _by_field(experiment, over[name], "noise", name) ** 2 for name in step.sent}
    Q = received_covariance(step, over, variances)
    if exchange.has_two_digraphs:
        recursion = recursion_of(nominal_of(experiment.algorithm), exchange, step.h)
        assert recursion is not None, "it keeps a position and a velocity, and is linear"
        return recursion.matrix, Q
    if experiment.topologies.is_constant:
        return LateStep(step, exchange.position, delays_of(experiment)).matrix(), Q
    return step.matrix(exchange.position.D), Q


def delays_of(experiment: Experiment) -> NDArray[np.int64]:
    """Return the delay of each link, (E,) sampling periods, where all are fixed."""
    faults = _of_edges(experiment, experiment.topologies.links)
    return np.array([fault.delay[1] for fault in faults], np.int64)


def _by_field(experiment: Experiment, topology: Topology, kind: str, field: str) -> Array:
    """Return what the faults of a kind are of a field, (E,)."""
    faults = _of_edges(experiment, topology)
    return np.array([getattr(fault, kind).get(field, 0.0) for fault in faults])


def _of_edges(experiment: Experiment, topology: Topology) -> list[LinkFault]:
    sound = LinkFault()
    edges = zip(topology.source.tolist(), topology.sink.tolist(), strict=True)
    return [experiment.link_faults.get(edge, sound) for edge in edges]


def rounds(experiment: Experiment) -> bool:
    """Return whether links round samples."""
    return any(fault.quantisation for fault in experiment.link_faults.values())


def rounding_bounds(experiment: Experiment, late: LateStep, radius: float) -> Added | None:
    """Return what rounding on links adds to the bounds at most; None where it is not known."""
    topology = late.topology
    steps = {name: _by_field(experiment, topology, "quantisation", name) for name in late.step.sent}
    return rounding_errors(late.step, late.matrix(), topology, steps, radius)


def _pairs(numbers: Array | None) -> dict[str, Any] | None:
    return None if numbers is None else dict(zip(PAIR, numbers.tolist(), strict=True))
