"""After a run: what was measured beside the bounds, quantity by quantity.

The bounds are of t → ∞. At t_k there is also what is left of the beginning (`beginning`): so
‖x(t_k)‖∞ is beyond what is proven when it is more than the bound for this target and the largest
such rest of the last fifth together. What is left of the robots' own beginning is not known: while
the estimates converge, tracking beyond its bound is not compared.
"""

from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.analysis.beginning import beginning
from nrs_cosim.orchestrator.analysis.bounds import Bound, UltimateBounds, bounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.conditions import finite
from nrs_cosim.orchestrator.analysis.convergence import periods_of
from nrs_cosim.orchestrator.analysis.mean_squares import RootMeanSquare, root_mean_squares
from nrs_cosim.orchestrator.analysis.measured_noise import measured_noise
from nrs_cosim.orchestrator.analysis.noise import NoiseAnalysis
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import SteadyState

AgainstBound = Literal["within", "exceeds", "unknown"]
Status = Literal["within", "transient", "exceeded", "unproven", "not measured"]
PAPER = "paper"

SLACK = 1e-6
"""Relative: how far a measurement may be above a bound by rounding."""
NEGLIGIBLE = 1e-3
"""The part of an error that the beginning may have without being told of."""
ROUNDING = 2.0**-41
"""Of the largest number of a recursion: what a thousand roundings of it come to."""
TOLERANCE = 1e-9
"""Of the largest number of a robot: what its plant is integrated to."""


@dataclass(frozen=True, slots=True)
class ComparedQuantity:
    """One quantity of a run."""

    bound: Bound
    measured: float | None
    """None where nothing was recorded."""
    tick: int
    """The last sampling time up to when it was reached, k."""
    transient: float | None
    """What is left of the beginning, at most, in the last fifth; None where that is not known."""
    against_bound: AgainstBound
    rounding: float = 0.0
    """What of it may be rounding, or a plant's tolerance."""

    @property
    def status(self) -> Status:
        """What a person and a program are told of it, in a word.

        What is above a bound of the steady state, and yet no more than the beginning allows, is a
        transient; nothing is proven where no bound is, and above the paper's own on tracking.
        """
        if self.measured is None:
            return "not measured"
        if self.against_bound == "exceeds":
            return "exceeded"
        if self.against_bound == "unknown":
            return "unproven"
        return "transient" if {*self.above} - {PAPER} else "within"

    @property
    def bounds(self) -> dict[str, float | None]:
        """The bounds of the steady state, by the names that all outputs have for them."""
        b = self.bound
        return {"steady_state": b.steady_state, "worst_case": b.worst_case, PAPER: b.paper}

    @property
    def above(self) -> tuple[str, ...]:
        """The names of the bounds that were passed."""
        if self.measured is None:
            return ()
        most = (self.measured - self.rounding) / (1 + NEGLIGIBLE)
        return tuple(
            law for law, bound in self.bounds.items() if bound is not None and most > bound
        )


@dataclass(frozen=True, slots=True)
class TheoryComparison:
    """A run beside the theory."""

    why_not: str
    """Why the theory says nothing of the estimates; empty where it does."""
    quantities: tuple[ComparedQuantity, ...]
    spectral_radius: float | None
    """ρ"""
    measured_radius: float | None
    """What it was in the run; None where too little was recorded."""
    untracked: str = ""
    """Why there are no bounds on tracking; empty where there are."""
    noise: NoiseAnalysis | None = None
    """What noise on links comes to, and came to; None where there is none."""
    mean_squares: tuple[RootMeanSquare, ...] = ()
    """Of errors over links that lose samples; none where nothing is expected of them."""
    steady_since: float | None = None
    """s: from when on all is as in steady state, where that is only after the last fifth has begun:
    outages, or digraphs that hold no more, last until then."""

    @property
    def left(self) -> float | None:
        """What is left of the beginning, at most; None where that is no part worth telling."""
        transient = max((row.transient or 0.0 for row in self.quantities), default=0.0)
        most = max((row.measured or 0.0 for row in self.quantities), default=0.0)
        return transient if transient > NEGLIGIBLE * most else None

    def as_json(self) -> dict[str, Any]:
        """Return the comparison for JSON."""
        rows = [
            {
                "name": row.bound.name,
                "measured": finite(row.measured),
                "tick": row.tick,
                "bounds": {law: finite(bound) for law, bound in row.bounds.items()},
                "sampled": row.bound.sampled,
                "unproven": [PAPER] if row.bound.unproven else [],
                "transient": None if row.transient is None else finite(row.transient),
                "rounding": finite(row.rounding),
                "status": row.status,
                "above": list(row.above),
            }
            for row in self.quantities
        ]
        return {
            "why_not": self.why_not,
            "quantities": rows,
            "transient": finite(self.left),
            "steady_since": self.steady_since,
            "spectral_radius": self.spectral_radius,
            "measured_radius": self.measured_radius,
            "untracked": self.untracked,
            "noise": self.noise.as_json() if self.noise else None,
            "mean_squares": [asdict(one) for one in self.mean_squares],
        }


@np.errstate(all="ignore")  # what is not finite is told as such
def compare_to_theory(
    reader: Reader,
    experiment: Experiment,
    measured: SteadyState,
    ultimate: UltimateBounds | None = None,
) -> TheoryComparison:
    """Return a recording's measurements beside the bounds of its experiment, if known already."""
    try:
        ultimate = ultimate or ultimate_bounds(experiment)
    except InputError as error:  # its algorithm is not installed here
        return TheoryComparison(str(error), (), None, None)
    transient, peak, spectral_radius = beginning(reader, experiment, ultimate)
    clock = experiment.clock
    found = (
        measured.position_estimate,
        measured.velocity_estimate,
        measured.position_tracking,
        measured.velocity_tracking,
    )
    of_estimates = ROUNDING * (measured.size + peak)
    of_robots = of_estimates + TOLERANCE * measured.size
    lost = (of_estimates, of_estimates, of_robots, of_robots)
    rows = zip(bounds(ultimate), found, measured.times_ns, transient, lost, strict=True)
    quantities = [
        ComparedQuantity(
            bound,
            value,
            clock.since(at + 1) - 1,
            left if which < 2 else None,
            _against_bound(bound, value, left, rounding),
            rounding,
        )
        for which, (bound, value, at, left, rounding) in enumerate(rows)
    ]
    why = next((part.why for part in ultimate.robots if part.why), "")
    estimates, tracking = quantities[:2], quantities[2:]
    if any((row.transient or 0.0) > NEGLIGIBLE * (row.measured or 0.0) for row in estimates):
        tracking = [
            replace(row, against_bound="unknown") if row.against_bound == "exceeds" else row
            for row in tracking
        ]
    noise = ultimate.noise
    return TheoryComparison(
        ultimate.why_not,
        (*estimates, *tracking),
        finite(ultimate.radius),
        spectral_radius,
        why,
        noise and measured_noise(noise, reader, experiment, periods_of(experiment)),
        root_mean_squares(reader, experiment),
        _steady_since(experiment, ultimate.since, reader.ticks),
    )


def _steady_since(experiment: Experiment, since: int, ticks: int) -> float | None:
    clock = experiment.clock
    is_late = since > clock.since(clock.t(ticks) - clock.t(ticks) // 5)
    return seconds(clock.t(since)) if is_late and since <= ticks else None


def _against_bound(
    bound: Bound, measured: float | None, transient: float | None, rounding: float
) -> AgainstBound:
    proven = bound.steady_state if bound.steady_state is not None else bound.worst_case
    if measured is None or proven is None or transient is None:
        return "unknown"
    return "within" if measured <= (proven + transient) * (1 + SLACK) + rounding else "exceeds"
