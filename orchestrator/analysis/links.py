"""Whether the estimates converge over the links that a scenario has, and by which statement.

Of links that are late by fixed times it is ρ of the recursion with what is under way; of delays
that are drawn, a proof for all that may be; of losses, the mean square. Statements are those of
docs/theory.md. Outages that end within the run say nothing of the steady state (statement L5), and
noise, rounding and duplicates do not decide convergence.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite, isnan
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import seconds
from nrs_cosim.estimator_agents.algorithm import Spectra, Spectrum, nominal_of
from nrs_cosim.estimator_agents.theory.aperiodic import Periods, RadiusBounds
from nrs_cosim.estimator_agents.theory.delays import (
    DelayMargin,
    LateStep,
    contraction,
    delay_margin,
    switching_radius,
)
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep
from nrs_cosim.estimator_agents.theory.loss import (
    almost_sure,
    critical_loss,
    mean_square_radius,
)
from nrs_cosim.estimator_agents.theory.lossy_step import LossyStep
from nrs_cosim.estimator_agents.theory.outermost import bounds_by
from nrs_cosim.estimator_agents.theory.recursion import linear_jump
from nrs_cosim.estimator_agents.theory.switching import (
    contracts_in_any_order,
    gains_up_to_one,
)
from nrs_cosim.orchestrator.analysis.convergence import UNKNOWN
from nrs_cosim.orchestrator.analysis.link_faults import (
    LinkFaults,
    lasting_digraph,
    link_faults_of,
    ticks_of,
)
from nrs_cosim.orchestrator.analysis.link_recursions import (
    lossy_steps,
    radius_of_turns,
    simulated_over,
    step_over,
    why_unknown_over,
)
from nrs_cosim.orchestrator.scenario.experiment import Experiment

LinkStatus = Literal[
    "converges", "converges in mean square", "converges almost surely", "diverges", "unknown"
]
_ALWAYS, _SOMETIMES, _OFTEN = "statement D3", "statement L3", "statement L4"
_IN_TURN, _OF_SQUARES = "statement D6", ("statement L1", "statement L7")
_ITERATED = "statement D1, by Arnoldi's method"
_STATUS: dict[str, LinkStatus] = {"proven": "converges", "refuted": "diverges"}


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
    radius: RadiusBounds = UNKNOWN
    """By what errors are multiplied at a sampling time over these links: ρ where they are late by
    fixed times, or sound; jointly of all that drawn delays may make of it; of the root of the mean
    square where samples are lost. Not a number where it is not known."""
    delays: tuple[int, int] = (0, 0)
    """The shortest and the longest, sampling periods."""
    outages_end: float | None = None
    """s: when the last outage is over; bounds are of the time after it. None without any."""
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

    @property
    def radius_name(self) -> str:
        """What the radius is called."""
        if self.loss:
            return "mean-square radius"
        return "joint spectral radius" if isnan(self.radius.radius) else "spectral radius"

    @property
    def growth(self) -> float | None:
        """What errors are multiplied by at a sampling time, at least; None if not diverging."""
        almost_surely = [self.simulated, self.loss.almost_sure if self.loss else None]
        known = [one.lower for one in almost_surely if one] or [self.radius.lower]
        return max(known) if self.status == "diverges" else None

    @property
    def growth_at_most(self) -> float | None:
        """The other end of `growth`, by simulation or where it is exact; None where not known."""
        if self.growth is None:
            return None
        if self.simulated:
            return self.simulated.upper
        exact = not self.loss and self.radius.upper - self.radius.lower < 1e-6
        return self.radius.upper if exact else None

    @property
    def almost_sure(self) -> RadiusBounds:
        """e^λ: by simulation where samples are lost, or delays are drawn; else it is ρ."""
        if self.simulated:
            return self.simulated
        return self.radius if self.radius_name == "spectral radius" else UNKNOWN

    def as_json(self) -> dict[str, Any]:
        """Return the analysis for JSON."""
        derived = {"radius_name": self.radius_name, "proven": self.proven}
        return {**_finite(asdict(self)), "delays": list(self.delays), **derived}


def _finite(value: Any) -> Any:
    """Return nested values for JSON, which has no infinity."""
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    return None if isinstance(value, float) and not isfinite(value) else value


def link_analysis(
    experiment: Experiment, spectra: Sequence[Spectra], periods: Periods, rho: RadiusBounds
) -> LinkAnalysis:
    """Return what follows from links; ρ is that over links without faults."""
    step, spectrum = step_over(experiment, periods.constant_period), spectra[-1][0]
    alone = lasting_digraph(experiment.topologies)
    margin = delay_margin(step, spectrum) if step and alone else None
    if not experiment.impaired and not experiment.byzantine:
        return LinkAnalysis(_STATUS.get(rho.status, "unknown"), margin=margin, radius=rho)
    faults = link_faults_of(experiment)
    delays = int(faults.least.min()), int(faults.most.max())
    over = seconds(experiment.clock.t(faults.outages_end)) if faults.outages_end else None
    found = LinkAnalysis("unknown", delays=delays, outages_end=over, margin=margin)
    if why := why_unknown_over(experiment, faults):
        return replace(found, why=why)
    if step is None and faults.arrive_in_time and rho.status != "not decided":
        return replace(found, status=_STATUS[rho.status], source="statement R1", radius=rho)
    proof = _proven(experiment, faults, spectrum, periods) if faults.some_arrive else ""
    if not faults.loss.any():
        found = _of_delays(experiment, faults, step, found, proof, spectrum)
        if found.source:
            return found
    else:
        found = _of_losses(experiment, faults, step, found, proof)
    if step:
        found = replace(found, simulated=simulated_over(experiment, faults, step))
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
    alone = lasting_digraph(experiment.topologies)
    if step and faults.fixed:
        if alone:
            late = LateStep(step, alone, faults.most)
            radius = RadiusBounds(*bounds_by(late.radius, spectrum))
            source = "statement D1" if late.is_proven(radius.upper) else proof or _ITERATED
        else:
            radius = RadiusBounds(*[radius_of_turns(experiment, faults, step)] * 2)
            source = "statement D5"
        if not isnan(radius.upper):
            status = _STATUS.get(radius.status, "unknown")
            return replace(found, status=status, source=source, radius=radius)
    if proof:
        status = "converges in mean square" if proof == _SOMETIMES else "converges"
        return replace(found, status=status, source=proof)
    joint = None
    if step and alone and experiment.missing == "hold":
        joint = switching_radius(step, alone, faults.least, faults.most)
    if joint is None:
        return replace(found, why="of such delays, so long or drawn, nothing is proven")
    bounds = RadiusBounds(joint.lower, joint.upper)
    if bounds.status == "proven":
        return replace(found, status="converges", source="statement D4", radius=bounds)
    some = "some" if bounds.status == "refuted" else "perhaps some"
    why = f"with {some} of the delays that may be drawn the estimates diverge"
    return replace(found, why=why, radius=bounds)


def _proven(
    experiment: Experiment, faults: LinkFaults, spectrum: Spectrum, periods: Periods
) -> str:
    """Return the statement by which it converges whatever links delay and lose; empty for none.

    By D3 and D6 it does with certainty where nothing is lost, in mean square where something is.
    """
    algorithm = nominal_of(experiment.algorithm)
    jump = linear_jump(algorithm)
    if lasting_digraph(experiment.topologies) is None:
        prompt = experiment.missing == "hold" or not faults.least.any()
        if not (jump and prompt and contracts_in_any_order(*jump)):
            return ""
        return _IN_TURN if experiment.missing == "hold" else _SOMETIMES
    if experiment.missing == "hold":
        # What a flow along lines does in a period of any length is between two that are known.
        ends = {periods.shortest, periods.longest} if jump else {periods.constant_period}
        steps = [step_over(experiment, h) for h in ends]
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
    phases = ticks_of(experiment.topologies, faults, faults.loss)[1]

    def at(loss: NDArray[np.float64]) -> list[LossyStep] | None:
        return lossy_steps(experiment, faults, step, loss)

    lossy = at(faults.loss)
    radius = mean_square_radius(lossy, phases) if lossy else None
    if lossy and radius and isfinite(radius.upper):
        critical = critical_loss(lambda loss: at(np.where(faults.loss > 0, loss, 0.0)), phases)
        sure = almost_sure(lossy, radius.upper, phases)
        found = replace(found, loss=LossAnalysis(radius, sure, critical), radius=radius)
    if proof:
        return replace(found, status="converges in mean square", source=_SOMETIMES)
    if found.loss is None:
        return replace(
            found,
            why="of so many links that lose samples, or of delays drawn beside, it is not computed",
        )
    if found.loss.mean_square.status == "proven":
        source = _OF_SQUARES[len(phases) > 1]
        return replace(found, status="converges in mean square", source=source)
    if radius and radius.status == "refuted":
        why = "in mean square the estimates diverge, and of almost every run it is not decided"
        return replace(found, why=why)
    return replace(found, why="it is not decided in mean square, nor by simulation")
