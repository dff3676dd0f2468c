"""Before a run: whether the theory lets its estimates converge (paper, Theorems 1 and 3)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import inf, isfinite, isnan, log
from typing import Any, Literal

import numpy as np

from nrs_cosim.estimator_agents.algorithm import Spectrum, nominal_of
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.theory.aperiodic import Periods, RadiusBounds
from nrs_cosim.estimator_agents.theory.declared_modes import expect_modes
from nrs_cosim.estimator_agents.theory.delays import LateStep
from nrs_cosim.estimator_agents.theory.honest_hull import HonestHull
from nrs_cosim.estimator_agents.theory.network import NetworkSummary
from nrs_cosim.estimator_agents.theory.outermost import known_of, within_of
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.spectrum import smallest_theta
from nrs_cosim.estimator_agents.theory.tracking import TRACKING
from nrs_cosim.estimator_agents.theory.transient import ticks_until
from nrs_cosim.orchestrator.analysis.chords import Chords, chords_of
from nrs_cosim.orchestrator.analysis.convergence import (
    conditions_for,
    merged,
    periods_of,
    recursions_of,
    rho_of,
    spectra_of,
    why_unknown,
)
from nrs_cosim.orchestrator.analysis.link_recursions import step_of_run
from nrs_cosim.orchestrator.analysis.links import LinkAnalysis, LinkStatus, link_analysis
from nrs_cosim.orchestrator.analysis.missing_bounds import UNDECIDED
from nrs_cosim.orchestrator.analysis.plant_bounds import Find, tracking_conditions
from nrs_cosim.orchestrator.analysis.robot_conditions import (
    POSITIVE,
    gain_conditions,
    graph_conditions,
    hull_of,
)
from nrs_cosim.orchestrator.analysis.switching import (
    AnyOrder,
    Phase,
    any_order_of,
    any_order_over,
    phases_of,
)
from nrs_cosim.orchestrator.engine.layouts import expect_same_on_any_workers
from nrs_cosim.orchestrator.scenario.experiment import Experiment

_OF_ONE_ROBOT = (TRACKING, POSITIVE)
"""Where conditions come from that are of a robot by itself, whatever others say."""
ConditionStatus = Literal["holds", "void", "violated", "unknown"]
OF_PERIOD = "sampling_period"
"""The conditions of this name are on a period that is always the same."""


@dataclass(frozen=True, slots=True)
class Check:
    """Conditions and convergence of an experiment."""

    algorithm: str
    parameters: Mapping[str, Any]
    """Of the algorithm, by name."""
    spectrum: list[tuple[float, float]]
    """Eigenvalues of D, (real, imaginary), by real then imaginary part; of all digraphs."""
    rho: RadiusBounds
    """Of the estimation error, over links without faults and among robots that do not lie."""
    why: str
    """Why that is not known, where it is not a number."""
    alpha_beta_bound: float
    """min θ_i, in s⁰: what Theorem 1 bounds α and β by, and Theorem 3 β."""
    h_bound: float | None
    """What Theorem 3 bounds a constant period by, s; None for an algorithm that has no such."""
    conditions: tuple[Condition, ...]
    """For all digraphs: where there are turns, of the one that is nearest to its bound."""
    phases: tuple[Phase, ...]
    repeat: int | None
    """After how many ticks the turns come again."""
    any_order: AnyOrder | None
    periods: Periods
    period: Recursion | LateStep | None
    """What is the same at all ticks, a step of agents that keep more; None where nothing is, or it
    is not linear."""
    links: LinkAnalysis
    """What follows from what links do to samples."""
    impaired: bool
    """Whether links have faults, which `rho` and the conditions know nothing of."""
    byzantine: tuple[int, ...]
    """The robots that lie, which they know nothing of either."""
    lying_by: Sequence[tuple[int, str]]
    """Those of them that lie by another algorithm, and by which."""
    hull: HonestHull | None
    """What honest robots' estimates stay within in this run; None where that is not known."""
    chords: Chords | None
    """What references are between sampling times; None where they are lines."""

    @property
    def premise(self) -> str:
        """What `rho` and the conditions are of, where the scenario is not; empty where it is."""
        parts = ["links without faults"] * self.impaired
        parts += ["robots that do not lie"] * bool(self.byzantine)
        return " and ".join(parts)

    @property
    def network(self) -> NetworkSummary | None:
        """The only digraph; None where there are several."""
        digraphs = [digraph for phase in self.phases for digraph in phase.digraphs]
        return digraphs[0].network if len(digraphs) == 1 else None

    @property
    def spanning_tree(self) -> bool:
        """Assumption A2: directed paths lead from the target to every robot, at each tick."""
        return all(of.network.spanning_tree for phase in self.phases for of in phase.digraphs)

    @property
    def spectral_radius(self) -> float:
        """ρ over the links that the scenario has, of `links.radius`; not a number if not known."""
        return self.links.radius.radius

    @property
    def whole_spectrum(self) -> bool:
        """Whether all eigenvalues of D are there; of very large digraphs the outermost may be."""
        return all(within_of(of.spectrum) is None for phase in self.phases for of in phase.digraphs)

    @property
    def others_within(self) -> float | None:
        """Within what of 0 the eigenvalues are that are not in `spectrum`; None if all are."""
        radii = [within_of(of.spectrum) for phase in self.phases for of in phase.digraphs]
        return max((radius for radius in radii if radius is not None), default=None)

    @property
    def undecided(self) -> str:
        """What is said where `rho` may be below 1 and above."""
        if self.periods.early:
            return UNDECIDED + " under every jitter"
        return UNDECIDED + ": not all eigenvalues are known" * (not self.whole_spectrum)

    @property
    def rate(self) -> float:
        """−ln ρ / h, per s, for the largest that ρ may be: errors fall as e^(−rate t) or faster.

        Where links lose samples it is of the root of their mean square.
        """
        radius = self.links.radius.upper
        return -log(radius) / self.periods.mean if radius > 0 else inf if radius == 0 else radius

    @property
    def settling_time(self) -> float | None:
        """s, from the beginning, until any error is a millionth of it; None where not known."""
        period, h = self.period, self.periods.constant_period
        if self.premise or period is None or h is None or not self.rho.upper < 1:
            return None
        matrix = period.matrix() if isinstance(period, LateStep) else period.matrix
        ticks = ticks_until(matrix, 1e-6)
        return None if ticks is None else ticks * h

    @property
    def why_unsettled(self) -> str:
        """Why there is no settling time; empty where there is one, or no convergence without it."""
        if not self.rho.upper < 1:
            return ""
        reasons = {
            "links have faults": self.impaired,
            "robots lie": bool(self.byzantine),
            "sampling is not periodic": self.periods.constant_period is None,
            "there are several digraphs": self.network is None,
            "agents decide when they send, or are not linear": self.period is None,
        }
        why = next((why for why, so in reasons.items() if so), "")
        return why or "there are too many robots" * (self.settling_time is None)

    @property
    def keeps_more(self) -> bool:
        """Whether agents keep more than a position and a velocity, so that errors are of it all."""
        return isinstance(self.period, LateStep)

    @np.errstate(all="ignore")
    def as_json(self) -> dict[str, Any]:
        """Return the analysis for JSON, with each condition's margin and whether it holds."""
        result: dict[str, Any] = {
            "algorithm": self.algorithm,
            "parameters": {**self.parameters},
            "convergence": self.convergence,
            "conditions_of": self.premise or "the links as they are",
            "byzantine": list(self.byzantine),
            "honest": None
            if self.hull is None
            else {name: getattr(self.hull, name).tolist() for name in ("position", "velocity")},
            "lying_by": [{"robot": robot, "algorithm": by} for robot, by in self.lying_by],
            "spectrum": self.spectrum,
            "spectral_radius": finite(self.spectral_radius),
            "spectral_radius_without_faults": finite(self.rho.radius),
            "alpha_beta_bound": finite(self.alpha_beta_bound),
            "h_bound": finite(self.h_bound),
            "spanning_tree": self.spanning_tree,
            "conditions": [_condition_json(c, self.status(c)) for c in self.conditions],
            "network": asdict(self.network) if self.network else None,
            "period": self.periods.mean,
            "whole_spectrum": self.whole_spectrum,
            "others_within": self.others_within,
            "links": self.links.as_json(),
            "rate": finite(self.rate),
            "settling_time": self.settling_time,
            "why_unsettled": self.why_unsettled,
        }
        if self.periods.constant_period is None:
            result["aperiodic"] = {
                "shortest": self.periods.shortest,
                "longest": self.periods.longest,
                **_bounds(self.links.radius),
                "status": "unknown" if isnan(self.links.radius.upper) else self.links.radius.status,
            }
        if self.chords:
            result["reference"] = asdict(self.chords)
        if self.network is None:
            result["topologies"] = [_phase_json(phase, self.status) for phase in self.phases]
        if self.any_order:
            order = {**asdict(self.any_order), "order": list(self.any_order.order)}
            result["switching"] = {"repeat": self.repeat, "any_order": order}
        return result

    @property
    def convergence(self) -> Literal["converges", "diverges", "unknown"]:
        """Whether the estimates converge over the links that the scenario has.

        What converges in mean square does, and it is `links.status` that says so; what almost
        every run does by simulation alone is not known. Among robots that lie it is not: ρ and the
        conditions are of robots none of which lies.
        """
        known: dict[LinkStatus, Literal["converges", "diverges"]] = {
            "converges": "converges",
            "converges in mean square": "converges",
            "diverges": "diverges",
        }
        return known.get(self.links.status, "unknown") if self.links.proven else "unknown"

    def status(self, condition: Condition) -> ConditionStatus:
        """Return whether a condition holds; void where that proves nothing, for robots lie."""
        if isnan(condition.margin):
            return "unknown"
        if not condition.holds:
            return "violated"
        presumes = not condition.of_liars and condition.source not in _OF_ONE_ROBOT
        return "void" if self.byzantine and presumes else "holds"


@np.errstate(all="ignore")  # what overflows is infinite, or not a number: no bound
def check(experiment: Experiment, find: Find | None = None) -> Check:
    """Return what the theory says of an experiment; `find` as `bounded` has it."""
    topologies, algorithm = experiment.topologies, experiment.algorithm
    periods = periods_of(experiment)
    expect_modes(algorithm, periods.mean)
    expect_same_on_any_workers(experiment)
    spectra = spectra_of(topologies)
    everywhere = merged(spectra)
    own = conditions_for(algorithm, everywhere, periods.longest)
    bounds = [c.right for c in own if c.name == OF_PERIOD]
    recursions = recursions_of(algorithm, topologies, periods.mean)
    rho = rho_of(nominal_of(algorithm), topologies, spectra, periods)
    return Check(
        algorithm=experiment.scenario.algorithm.name,
        parameters=experiment.scenario.algorithm.parameters,
        spectrum=_pairs(np.concatenate([known_of(one) for one in everywhere])),
        rho=rho,
        why=why_unknown(nominal_of(algorithm), topologies, periods),
        alpha_beta_bound=min(map(smallest_theta, everywhere)),
        h_bound=min(bounds, default=None),
        conditions=_with_own(experiment, own, periods, find),
        phases=phases_of(algorithm, topologies, spectra, periods),
        repeat=topologies.repeat,
        any_order=any_order_over(experiment, periods)
        or any_order_of(algorithm, topologies, periods),
        periods=periods,
        period=_same_at_all_ticks(experiment, periods, recursions),
        links=link_analysis(experiment, spectra, periods, rho),
        impaired=experiment.impaired,
        byzantine=tuple(experiment.byzantine),
        lying_by=experiment.lying_by,
        hull=hull_of(experiment),
        chords=chords_of(experiment),
    )


def _same_at_all_ticks(
    experiment: Experiment, periods: Periods, recursions: Sequence[Recursion]
) -> Recursion | LateStep | None:
    if len(recursions) == 1:
        return recursions[0]
    if experiment.algorithm.nominal() is not None:  # what triggers let pass does not fall
        return None
    return step_of_run(experiment, periods, recursions)[0]


@np.errstate(all="ignore")  # as above
def conditions_of(experiment: Experiment) -> tuple[Condition, ...]:
    """Return the conditions alone, which are of links without faults, and of no radius."""
    periods, everywhere = periods_of(experiment), merged(spectra_of(experiment.topologies))
    own = conditions_for(experiment.algorithm, everywhere, periods.longest)
    return _with_own(experiment, own, periods)


def _with_own(
    experiment: Experiment, own: Sequence[Condition], periods: Periods, find: Find | None = None
) -> tuple[Condition, ...]:
    """Return all conditions: those on the algorithm's gains, and the others."""
    return (
        *(c for c in own if periods.constant_period is not None or c.name != OF_PERIOD),
        *experiment.algorithm.demands(periods.longest, *experiment.target.bounds()),
        *graph_conditions(experiment),
        *gain_conditions(experiment),
        *tracking_conditions(experiment, find),
    )


def finite(number: float | None) -> float | None:
    """JSON has no infinity: a bound that no number reaches is null."""
    return number if number is not None and isfinite(number) else None


def _pairs(spectrum: Spectrum) -> list[tuple[float, float]]:
    return [(float(s.real), float(s.imag)) for s in np.sort_complex(spectrum)]


def _bounds(rho: RadiusBounds) -> dict[str, float | None]:
    return {"lower": finite(rho.lower), "upper": finite(rho.upper)}


def _condition_json(condition: Condition, status: str) -> dict[str, Any]:
    return {
        "name": condition.name,
        "source": condition.source,
        "value": finite(condition.value),
        "relation": ">" if condition.at_least else "<",
        "bound": finite(condition.bound),
        "margin": finite(condition.margin),
        "status": status,
        "sampled": condition.sampled,
    }


def _phase_json(phase: Phase, status: Callable[[Condition], str]) -> dict[str, Any]:
    """Return what is said of a turn by itself, for JSON."""
    return {
        "from": phase.since,
        "spectral_radius": finite(phase.rho.radius),
        **_bounds(phase.rho),
        "conditions": [_condition_json(c, status(c)) for c in phase.conditions],
        "digraphs": [
            {
                "of": digraph.of,
                "spectrum": _pairs(known_of(digraph.spectrum)),
                "whole_spectrum": within_of(digraph.spectrum) is None,
                "others_within": within_of(digraph.spectrum),
                "alpha_beta_bound": finite(smallest_theta(digraph.spectrum)),
                "spanning_tree": digraph.network.spanning_tree,
                "network": asdict(digraph.network),
            }
            for digraph in phase.digraphs
        ],
    }
