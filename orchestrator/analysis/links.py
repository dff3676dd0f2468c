"""Whether the estimates converge over the links that a scenario has, and by which statement.

Of links that are late by fixed times it is ρ of the recursion with what is under way; of delays
that are drawn, a proof for all that may be; of losses, the mean square. Statements are those of
docs/theory.md. Outages that end within the run say nothing of the steady state (statement L5), and
noise, rounding and duplicates do not decide convergence.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite, isnan, log, nan
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.links.links import LinkFault
from nrs_cosim.bus.links.outages import Outages
from nrs_cosim.estimator_agents.algorithm import Spectra, Spectrum, nominal_of
from nrs_cosim.estimator_agents.theory.aperiodic import Periods, RadiusBounds
from nrs_cosim.estimator_agents.theory.delays import (
    DelayMargin,
    LateStep,
    contraction,
    delay_margin,
    switching_radius,
)
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep, linear_step
from nrs_cosim.estimator_agents.theory.loss import (
    almost_sure,
    critical_loss,
    mean_square_radius,
)
from nrs_cosim.estimator_agents.theory.lossy_step import LossyStep, lossy_step
from nrs_cosim.estimator_agents.theory.recursion import Recursion, linear_jump
from nrs_cosim.estimator_agents.theory.simulated_links import simulated_growth
from nrs_cosim.estimator_agents.theory.switching import gains_up_to_one
from nrs_cosim.orchestrator.scenario.experiment import Experiment

LinkStatus = Literal[
    "converges", "converges in mean square", "converges almost surely", "diverges", "unknown"
]
_ALWAYS, _SOMETIMES, _OFTEN = "statement D3", "statement L3", "statement L4"
_ITERATED = "statement D1, by Arnoldi's method"
_STATUS: dict[str, LinkStatus] = {"proven": "converges", "refuted": "diverges"}


@dataclass(frozen=True, slots=True, eq=False)
class LinkFaults:
    """What links do to samples in steady state, by edge."""

    least: NDArray[np.int64]
    """(E,) the shortest delay, sampling periods."""
    most: NDArray[np.int64]
    """(E,) the longest."""
    loss: NDArray[np.float64]
    """(E,) the probability that a sample is lost."""
    noisy: bool
    """Whether noise is added to samples, so that no error is bounded."""
    since: int
    """The tick from which on all is as in steady state: no sample is missing that an outage took,
    or that is late from before t_1."""

    @property
    def some_arrive(self) -> bool:
        """Whether no link loses every sample."""
        return not (self.loss == 1).any()

    @property
    def fixed(self) -> bool:
        """Whether each link is late by the same time at all ticks."""
        return bool((self.least == self.most).all())


@dataclass(frozen=True, slots=True)
class LossAnalysis:
    """What follows from the probabilities of losses."""

    mean_square: RadiusBounds
    """ρ(E[A ⊗ A])^½"""
    almost_sure: RadiusBounds
    """e^λ, of almost every run: proven."""
    critical: float | None
    """The least loss of the links that have some, all alike, at which it does not converge in mean
    square; 0 where it does not without, 1 where none was found; None where it is not computed."""


@dataclass(frozen=True, slots=True)
class LinkAnalysis:
    """What follows from what links do to samples."""

    status: LinkStatus
    source: str = ""
    """The statement from which it follows; empty where links do nothing."""
    why: str = ""
    """Why it is not known, where it is not."""
    radius: RadiusBounds | None = None
    """Of the recursion over these links, or jointly of all that delays may make of it."""
    delays: tuple[int, int] = (0, 0)
    """The shortest and the longest, sampling periods."""
    margin: DelayMargin | None = None
    """Of all links alike, without other faults; None where it is not computed."""
    loss: LossAnalysis | None = None
    simulated: RadiusBounds | None = None
    """e^λ by simulation, with a confidence of 99.9 %, where losses or delays are drawn."""

    @property
    def proven(self) -> bool:
        """Whether the status rests on no simulation, nor on eigenvalues of a search."""
        if self.source == _ITERATED:
            return False
        return self.source != _OFTEN or bool(self.loss and self.loss.almost_sure.lower >= 1)

    def rate(self, h: float) -> float | None:
        """Return how fast errors fall asymptotically, per s, at least; None where not known.

        It is of their mean squares' roots where samples are lost.
        """
        of = self.loss.mean_square if self.source == "statement L1" and self.loss else self.radius
        return -log(of.upper) / h if of and 0 < of.upper < 1 else None

    def as_json(self) -> dict[str, Any]:
        """Return the analysis for JSON."""
        return {**_finite(asdict(self)), "delays": list(self.delays), "proven": self.proven}


def _finite(value: Any) -> Any:
    """Return nested values for JSON, which has no infinity."""
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    return None if isinstance(value, float) and not isfinite(value) else value


def link_faults_of(experiment: Experiment) -> LinkFaults:
    """Return what links do to samples, over the edges of `experiment.topologies.links`."""
    links, given, sound = experiment.topologies.links, experiment.link_faults, LinkFault()
    edges = zip(links.source.tolist(), links.sink.tolist(), strict=True)
    faults = [given.get(edge, sound) for edge in edges]
    delays = np.array([fault.delay for fault in faults], np.int64).reshape(-1, 2)
    cuts = Outages.of({e: f.outages for e, f in enumerate(faults)}, experiment.clock.since)
    over = max(int(of.end.max(initial=1)) for of in (cuts, experiment.outages))
    return LinkFaults(
        delays[:, 0],
        delays[:, 1],
        np.array([fault.loss for fault in faults]),
        any(fault.noise for fault in faults),
        over + int(delays.max(initial=0)),
    )


def step_of_run(
    experiment: Experiment, periods: Periods, recursions: Sequence[Recursion]
) -> tuple[LateStep | None, int]:
    """Return a period over late links, or of agents that keep more, and the tick it is so from."""
    topologies, h = experiment.topologies, periods.constant_period
    if experiment.impaired:
        faults = link_faults_of(experiment)
        late = _late_step(experiment, faults, periods)
        return late, faults.since if late else 1
    since = 1 if topologies.repeat else topologies.since[-1]
    if recursions or h is None or len(topologies.digraphs) > 1:
        return None, since
    step = linear_step(nominal_of(experiment.algorithm), h)
    sound = np.zeros(len(topologies.links.source), np.int64)
    return None if step is None else LateStep(step, topologies.links, sound), since


def _late_step(experiment: Experiment, faults: LinkFaults, periods: Periods) -> LateStep | None:
    """Return the recursion where links, in steady state, are late by fixed times and round at most.

    None where that is not so, or not known.
    """
    if _why_unknown(experiment, faults) or faults.noisy or not faults.fixed or faults.loss.any():
        return None
    step = _step_of(experiment, periods.constant_period)
    return None if step is None else LateStep(step, experiment.topologies.links, faults.most)


def link_analysis(
    experiment: Experiment, spectra: Sequence[Spectra], periods: Periods, rho: RadiusBounds
) -> LinkAnalysis:
    """Return what follows from links; ρ is that over links without faults."""
    step, spectrum = _step_of(experiment, periods.constant_period), spectra[-1][0]
    one = len(experiment.topologies.digraphs) == 1
    margin = delay_margin(step, spectrum) if step and one else None
    if not experiment.impaired and not experiment.byzantine:
        return LinkAnalysis(_STATUS.get(rho.status, "unknown"), margin=margin)
    faults = link_faults_of(experiment)
    delays = int(faults.least.min()), int(faults.most.max())
    found = LinkAnalysis("unknown", delays=delays, margin=margin)
    if why := _why_unknown(experiment, faults):
        return replace(found, why=why)
    proof = _proven(experiment, spectrum, periods) if faults.some_arrive else ""
    if not faults.loss.any():
        found = _of_delays(experiment, faults, step, found, proof, spectrum)
        if found.source:
            return found
    else:
        found = _of_losses(experiment, faults, step, found, proof)
    if step:
        shape = experiment.topologies.links, faults.least, faults.most, faults.loss
        found = replace(found, simulated=simulated_growth(step, *shape, experiment.missing))
    return found if found.source else _by_simulation(found)


def _by_simulation(found: LinkAnalysis) -> LinkAnalysis:
    """Return what almost every run does, where nothing else is known of them."""
    often, sure = found.simulated, found.loss.almost_sure.lower if found.loss else 0.0
    if sure >= 1 or (often and often.lower > 1):
        return replace(found, status="diverges", source=_OFTEN, why="")
    if often and often.upper < 1:
        return replace(found, status="converges almost surely", source=_OFTEN, why="")
    return found


def _of_delays(
    experiment: Experiment,
    faults: LinkFaults,
    step: LinearStep | None,
    found: LinkAnalysis,
    proof: str,
    spectrum: Spectrum,
) -> LinkAnalysis:
    """Return what follows where links lose nothing, from delays that are fixed or drawn."""
    links = experiment.topologies.links
    late = LateStep(step, links, faults.most) if step and faults.fixed else None
    radius = late.radius(spectrum) if late else nan
    exact = RadiusBounds(radius, radius)
    if late and not isnan(radius):
        source = "statement D1" if late.is_proven(radius) else proof or _ITERATED
        return replace(found, status=_STATUS[exact.status], source=source, radius=exact)
    if proof:
        status: LinkStatus = "converges" if proof == _ALWAYS else "converges in mean square"
        return replace(found, status=status, source=proof)
    joint = None
    if step and experiment.missing == "hold":
        joint = switching_radius(step, links, faults.least, faults.most)
    if joint is None:
        return replace(found, why="of such delays, so long or drawn, nothing is proven")
    bounds = RadiusBounds(joint.lower, joint.upper)
    if bounds.status == "proven":
        return replace(found, status="converges", source="statement D4", radius=bounds)
    some = "some" if bounds.status == "refuted" else "perhaps some"
    why = f"with {some} of the delays that may be drawn the estimates diverge"
    return replace(found, why=why, radius=bounds)


def _proven(experiment: Experiment, spectrum: Spectrum, periods: Periods) -> str:
    """Return the statement by which it converges whatever links delay and lose; empty for none.

    By D3 it does with certainty where nothing is lost, and in mean square where something is.
    """
    algorithm = nominal_of(experiment.algorithm)
    jump = linear_jump(algorithm)
    if experiment.missing == "hold":
        # What a flow along lines does in a period of any length is between two that are known.
        ends = {periods.shortest, periods.longest} if jump else {periods.constant_period}
        steps = [_step_of(experiment, h) for h in ends]
        known = [step for step in steps if step]
        if len(known) == len(steps) and contraction(known, spectrum) < 1:
            return _ALWAYS
    return _SOMETIMES if jump and gains_up_to_one(*jump) else ""


def _of_losses(
    experiment: Experiment,
    faults: LinkFaults,
    step: LinearStep | None,
    found: LinkAnalysis,
    proof: str,
) -> LinkAnalysis:
    """Return what follows where links lose samples."""

    def at(loss: NDArray[np.float64]) -> LossyStep | None:
        return _lossy_step(experiment, faults, step, loss)

    lossy = at(faults.loss)
    radius = mean_square_radius(lossy) if lossy else None
    if lossy and radius and isfinite(radius.upper):
        critical = critical_loss(lambda loss: at(np.where(faults.loss > 0, loss, 0.0)))
        found = replace(
            found, loss=LossAnalysis(radius, almost_sure(lossy, radius.upper), critical)
        )
    if proof:
        return replace(found, status="converges in mean square", source=_SOMETIMES)
    if found.loss is None:
        return replace(
            found,
            why="of so many links that lose samples, or of delays drawn beside, it is not computed",
        )
    if found.loss.mean_square.status == "proven":
        return replace(found, status="converges in mean square", source="statement L1")
    return replace(found, why="it is not decided in mean square, nor by simulation")


def lossy_recursion(
    experiment: Experiment, faults: LinkFaults, periods: Periods
) -> tuple[LinearStep, LossyStep] | None:
    """Return a period and the recursion where links lose samples; None where it is not known."""
    step = _step_of(experiment, periods.constant_period)
    if not faults.loss.any() or _why_unknown(experiment, faults):
        return None
    lossy = _lossy_step(experiment, faults, step, faults.loss)
    return (step, lossy) if step and lossy else None


def factor_over_links(
    experiment: Experiment, spectrum: Spectrum, periods: Periods
) -> RadiusBounds | None:
    """Return bounds on the factor over links that are late or lose samples; None if not known.

    Where they lose some it is of the root of the mean square.
    """
    late = step_of_run(experiment, periods, ())[0]
    if late:
        return RadiusBounds(*[late.radius(spectrum)] * 2)
    lossy = lossy_recursion(experiment, link_faults_of(experiment), periods)
    return mean_square_radius(lossy[1]) if lossy else None


def _lossy_step(
    experiment: Experiment,
    faults: LinkFaults,
    step: LinearStep | None,
    loss: NDArray[np.float64],
) -> LossyStep | None:
    if step is None or not faults.fixed:
        return None
    return lossy_step(step, experiment.topologies.links, faults.most, loss, experiment.missing)


def _why_unknown(experiment: Experiment, faults: LinkFaults) -> str:
    """Return why nothing follows from links by any statement; empty where something may."""
    reasons = {
        "robots lie": bool(experiment.byzantine),
        "of several digraphs it is not computed": len(experiment.topologies.digraphs) > 1,
        "robots decide when they send": experiment.algorithm.TRIGGERED,
        "a link loses every sample, and agents hold what they never received": (
            experiment.missing == "hold" and not faults.some_arrive
        ),
        "an outage lasts to the end of the run": faults.since > experiment.clock.ticks,
    }
    return next((why for why, so in reasons.items() if so), "")


def _step_of(experiment: Experiment, h: float | None) -> LinearStep | None:
    """Return a period of h, s, where it is known and the age of samples is nothing to it."""
    step = None if h is None else linear_step(nominal_of(experiment.algorithm), h)
    return step if step and step.ageless else None
