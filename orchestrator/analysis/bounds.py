"""Before a run: how near its estimates and its robots come to the target, as the theory has it."""

from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.algorithm import modes, nominal_of
from nrs_cosim.estimator_agents.theory.aperiodic import RadiusBounds
from nrs_cosim.estimator_agents.theory.aperiodic_bounds import (
    worst_case_aperiodic,
    worst_case_of_list,
)
from nrs_cosim.estimator_agents.theory.delays import LateStep
from nrs_cosim.estimator_agents.theory.estimates import (
    EstimateBounds,
    PaperBound,
    SteadyMotion,
)
from nrs_cosim.estimator_agents.theory.received_errors import (
    Added,
    periods_between,
    received_errors,
)
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.spectrum import spectral_radius
from nrs_cosim.orchestrator.analysis.chords import chords_of
from nrs_cosim.orchestrator.analysis.conditions import finite
from nrs_cosim.orchestrator.analysis.convergence import (
    UNKNOWN,
    lasting,
    periods_of,
    recursions_of,
    rho_of,
    spectra_of,
)
from nrs_cosim.orchestrator.analysis.known import Known, of_drawn_delays, of_recursion, of_step
from nrs_cosim.orchestrator.analysis.link_recursions import factor_over_links, step_of_run
from nrs_cosim.orchestrator.analysis.missing_bounds import why_no_bounds
from nrs_cosim.orchestrator.analysis.noise import (
    NoiseAnalysis,
    noise_analysis,
    rounding_bounds,
    rounds,
)
from nrs_cosim.orchestrator.analysis.plant_bounds import Bounded, Find, plant_bounds
from nrs_cosim.orchestrator.analysis.stiffness import Stiffness, sampled_mobility, stiffness
from nrs_cosim.orchestrator.analysis.tracking import Tracking, tracking_of
from nrs_cosim.orchestrator.analysis.without_loops import sliding_bounds
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.targets import FmuMotion, SampledTarget, TargetMotion

_UNKNOWN_ERRORS = "what errors of received samples add is not computed of such networks or times"


@dataclass(frozen=True, slots=True, eq=False)
class UltimateBounds:
    """What the errors of a run come to in steady state, at most."""

    gamma_1: float
    """sup ‖υ_0‖∞ (A1)"""
    gamma_2: float
    """sup ‖a_0‖∞ (A1)"""
    source: str
    """What γ1 and γ2 are of, where that is no formula."""
    why_not: str
    """Why there are no bounds on the estimates; empty where there are."""
    aperiodic: bool
    switching: bool
    """Whether digraphs take turns for ever."""
    recursions: list[Recursion]
    """Of each exchange, and the period in the middle between the longest and the shortest."""
    since: int
    """The tick from which all is as in steady state: 1, or that of the turn that stays."""
    radius: float
    """ρ, or what takes its place where sampling is aperiodic; not a number where nothing does."""
    motion: SteadyMotion | None
    """What the errors settle to; None of a target that goes on neither in sines nor straight."""
    step: LateStep | None
    """A period of agents that keep more, or over links that are late; None of others, which have
    recursions."""
    added: Added | None
    """What is added to these by errors of what is received; None of an algorithm without such."""
    noise: NoiseAnalysis | None
    """What noise on links comes to; None where there is none."""
    gaps: NDArray[np.float64] | None
    """(n,) how many sampling periods lie at least between two samples of each robot (E2)."""
    worst_case: EstimateBounds | None
    """Infinite of a quantity of which nothing is known beside the other."""
    paper: PaperBound | None
    robots: list[Bounded]
    tracking: Tracking
    stiff: list[Stiffness]
    """Robots whose gains are large for their inertia."""

    @property
    def steady_state(self) -> EstimateBounds | None:
        """The largest that the estimates' errors come to, for this target."""
        if self.motion is None:
            return None
        bound = self.motion.bound
        return bound.plus(self.added.sampled) if self.added else bound

    @property
    def why_loose(self) -> str:
        """Why the worst case may be above what a target attains; empty where it is not, or none."""
        if self.step is None or self.worst_case is None:
            return ""
        late = bool(self.step.longest)
        return "samples are late" if late else "agents keep more than a position and a velocity"

    @property
    def sampled(self) -> bool:
        """Whether what is said of tracking rests on P3 of some robots as it was sampled."""
        return any(part.sampled for part in self.robots)

    def as_json(self) -> dict[str, Any]:
        """Return the bounds for JSON."""
        return {
            "gamma_1": finite(self.gamma_1),
            "gamma_2": finite(self.gamma_2),
            "source": self.source,
            "why_not": self.why_not,
            "why_loose": self.why_loose,
            "norms": _norms(self.paper) if self.paper else [],
            "estimates": {
                "steady_state": pair_json(self.steady_state),
                "worst_case": pair_json(self.worst_case),
                "paper": pair_json(self.paper.bound if self.paper else None),
            },
            "noise": self.noise.as_json() if self.noise else None,
            "periods_between_samples": None if self.gaps is None else self.gaps.tolist(),
            "plants": [_plant(part) for part in self.robots],
            "stiff": [part.as_json() for part in self.stiff],
            "tracking": {
                **{name: pair_json(getattr(self.tracking, name)) for name in TRACKED},
                "unproven": ["paper", "paper_of_worst_case"],
            },
        }


@dataclass(frozen=True, slots=True)
class Bound:
    """The bounds of one quantity in steady state; None where there is none."""

    name: str
    steady_state: float | None
    """For the scenario's target."""
    worst_case: float | None
    """For any target within γ1 and γ2; of tracking, what is proven of worst-case estimates."""
    paper: float | None
    sampled: bool = False
    """Whether it rests on P3 of some robots as it was sampled, and is no proven bound."""
    unproven: bool = False
    """Whether `paper` does not follow from the paper's proof, as its balls of tracking do not."""


def bounds(ultimate: UltimateBounds) -> list[Bound]:
    """Return the bounds by quantity: errors of estimates, then of tracking."""
    estimates, tracking = (
        ("|eps - eps_0|inf", "|ups - ups_0|inf"),
        ("|q - eps_0|2", "|qd - ups_0|2"),
    )
    paper, of_tracking = ultimate.paper.bound if ultimate.paper else None, ultimate.tracking
    return [
        *_rows(estimates, ultimate.steady_state, ultimate.worst_case, paper),
        *_rows(
            tracking,
            None,
            of_tracking.worst_case,
            of_tracking.paper,
            sampled=ultimate.sampled,
            unproven=True,
        ),
    ]


def _rows(
    names: tuple[str, str],
    steady_state: EstimateBounds | None,
    worst: EstimateBounds | None,
    paper: EstimateBounds | None,
    *,
    sampled: bool = False,
    unproven: bool = False,
) -> list[Bound]:
    """Return bounds of a pair of quantities, of positions and of velocities."""
    return [
        Bound(name, _of(steady_state, part), _of(worst, part), _of(paper, part), sampled, unproven)
        for name, part in zip(names, ("position", "velocity"), strict=True)
    ]


def _of(pair: EstimateBounds | None, part: str) -> float | None:
    return finite(getattr(pair, part)) if pair else None


TRACKED = ("paper", "paper_of_worst_case", "worst_case")


@np.errstate(all="ignore")  # what overflows is infinite, or not a number: no bound
def ultimate_bounds(
    experiment: Experiment, radius: RadiusBounds | None = None, find: Find | None = None
) -> UltimateBounds:
    """Return the bounds of an experiment; the radius over its links is found unless it is given.

    `find` is as `plant_bounds` has it.
    """
    topologies, periods = experiment.topologies, periods_of(experiment)
    target, algorithm = experiment.target, experiment.algorithm
    nominal = algorithm.nominal()
    algorithm = nominal_of(algorithm)
    middle, r = ((periods.longest + sign * periods.shortest) / 2 for sign in (1, -1))
    recursions = recursions_of(algorithm, topologies, periods.constant_period or middle)
    recursion = lasting(recursions, topologies)
    spectra = spectra_of(topologies)
    if radius is None and experiment.impaired:
        radius = factor_over_links(experiment, spectra[-1][0], periods) or UNKNOWN
    rho = radius or rho_of(algorithm, topologies, spectra, periods)
    robots = plant_bounds(experiment, find)
    whole = target.bounds()
    step, since = step_of_run(experiment, periods, recursions)
    links_bounded = not experiment.impaired or step is not None
    if experiment.impaired and step and (step.longest or not recursions):
        recursions, recursion = [], None
    why_not = why_no_bounds(experiment, algorithm, recursions, recursion, step, rho, links_bounded)
    added, gaps = None, None
    if not why_not and (nominal or rounds(experiment)):
        added, gaps = _added(experiment, recursion, step, rho.upper)
        why_not = "" if added else _UNKNOWN_ERRORS
    step = None if recursions else step
    chords = chords_of(experiment)
    chord = chords.step if chords else 0.0
    sliding, drawn = sliding_bounds(experiment), None
    if experiment.impaired and not links_bounded:
        drawn = of_drawn_delays(experiment, spectra[-1][0], periods, chord)
    known = Known(None, sliding, sliding if sliding and isfinite(sliding.position) else None)
    if drawn or known.always:
        known, why_not, recursions, recursion = drawn or known, "", [], None
    elif step is not None and not why_not:
        known = of_step(step, target, rho.upper, added, chord)
    elif recursion is not None and not why_not and periods.constant_period is None:
        both = None
        if not periods.early:
            both = worst_case_of_list(recursion, periods.gaps, *whole, rho.upper)
        if both is None:
            of_middle = spectral_radius(modes(algorithm, spectra[-1], middle))
            both = worst_case_aperiodic(recursion, r, *whole, of_middle)
        known = Known(None, *(both or ()))
    elif recursion is not None and not why_not:
        known = of_recursion(recursion, target, rho.upper, added, topologies.switching)
    constant = recursion if periods.constant_period is not None and not added else None
    of_paper = known.paper.bound if known.paper else None
    tracking = tracking_of(robots, target, constant, known.always, of_paper, known.steps)
    source = _source(experiment.scenario.target)
    return UltimateBounds(
        *whole,
        source,
        why_not,
        periods.constant_period is None,
        topologies.switching,
        recursions,
        since,
        rho.radius,
        known.motion,
        step,
        added,
        noise_analysis(experiment, periods),
        gaps,
        known.worst,
        known.paper,
        robots,
        tracking,
        stiffness(experiment, sampled_mobility(find)),
    )


def _added(
    experiment: Experiment, recursion: Recursion | None, step: LateStep | None, radius: float
) -> tuple[Added | None, NDArray[np.float64] | None]:
    """Return what errors of received samples add, and how long robots are silent, if known."""
    if experiment.impaired:
        return (rounding_bounds(experiment, step, radius) if step else None), None
    algorithm, topologies = experiment.algorithm, experiment.topologies
    nominal = algorithm.nominal()
    period = recursion or (step.step if step else None)
    if nominal is None or period is None or len(topologies.digraphs) > 1:
        return None, None
    added = received_errors(period, topologies.digraphs[0].D, nominal[1], radius)
    return added, periods_between(algorithm, recursion, *experiment.target.bounds(), radius)


def _source(target: TargetMotion) -> str:
    if isinstance(target, SampledTarget):
        return f"of the spline through its {len(target.times)} samples"
    if isinstance(target, FmuMotion):
        return f"of the cubics through {len(target.times)} samples of {target.fmu}"
    return ""


def pair_json(pair: EstimateBounds | None) -> dict[str, float | None] | None:
    """Return a pair of bounds for JSON."""
    if pair is None:
        return None
    return {"position": finite(pair.position), "velocity": finite(pair.velocity)}


def _norms(paper: PaperBound) -> list[dict[str, Any]]:
    found = [("A", paper.norm, paper.kappa), ("P", paper.velocity_norm, paper.velocity_kappa)]
    return [
        {
            "matrix": name,
            "family": norm.family,
            "value": finite(norm.value),
            "b": finite(norm.b),
            "c": finite(norm.c),
            "kappa": finite(kappa),
        }
        for name, norm, kappa in found
        if norm is not None
    ]


def _finite(numbers: Any) -> dict[str, Any] | None:
    """Return the fields of a dataclass for JSON, which has no infinity."""
    if numbers is None:
        return None
    values = asdict(numbers)
    return {k: finite(v) if isinstance(v, float) else v for k, v in values.items()}


def _plant(part: Bounded) -> dict[str, Any]:
    return {
        "robots": list(part.robots),
        "fmu": part.plant,
        "lambda_d": finite(part.lambda_d),
        "bounds": _finite(part.bounds),
        "constants": _finite(part.constants),
        "gains": _finite(part.drive),
        "why_not": part.why,
    }
