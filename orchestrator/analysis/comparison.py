"""After a run: what was measured beside the bounds, quantity by quantity.

The bounds are of t → ∞. At t_k there is also what is left of the beginning: z(t_1) after so many
jumps and flows, with z = x − what x settles to for the run's target. So ‖x(t_k)‖∞ is beyond what is
proven when it is more than the bound for this target and the largest such rest of the last fifth
together. z also has the measured factor: the mean by which ‖z‖∞ shrinks at a sampling time, over
the second half of the ticks until it is lost in rounding. Where it is not known what x settles to,
z = x: at any t_k the rest of x(t_k) is within the bound for any target. There is no factor then.
What is left of the robots' own beginning is not known: while the estimates converge, tracking
beyond its bound is not compared.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import chain, islice
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import ESTIMATE
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep
from nrs_cosim.orchestrator.analysis.bounds import Bound, UltimateBounds, bounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.conditions import finite
from nrs_cosim.orchestrator.analysis.convergence import periods_of
from nrs_cosim.orchestrator.analysis.mean_squares import RootMeanSquare, root_mean_squares
from nrs_cosim.orchestrator.analysis.measured_noise import measured_noise
from nrs_cosim.orchestrator.analysis.noise import NoiseAnalysis
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import SteadyState, errors_by_tick

Array = NDArray[np.float64]
Ticks = NDArray[np.int64]
AgainstBound = Literal["within", "exceeds", "unknown"]
Status = Literal["within", "transient", "exceeded", "unproven", "not measured"]
PAPER = "paper"

SLACK = 1e-6
"""Relative: how far a measurement may be above a bound by rounding."""
NEGLIGIBLE = 1e-3
"""The part of an error that the beginning may have without being told of."""
LOST = 1e-9
"""Of the first error: what is below may be rounding."""
ROUNDING = 2.0**-41
"""Of the largest number of a recursion: what a thousand roundings of it come to."""
TOLERANCE = 1e-9
"""Of the largest number of a robot: what its plant is integrated to."""
LONGEST = 200_000
"""Ticks for which the rest of the beginning is followed."""
NUMBERS, LOOK = 2**14, 64
"""Of the rest, compared at once; and the ticks after which it is seen whether any is left."""


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
    transient, peak, spectral_radius = _beginning(reader, experiment, ultimate)
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


def _beginning(
    reader: Reader, experiment: Experiment, ultimate: UltimateBounds
) -> tuple[tuple[float | None, ...], float, float | None]:
    """Return the rest of the beginning for each quantity, its peak, and the measured factor.

    Of tracking, there is no telling: it is as if nothing was left, where it was time to settle.
    """
    motion, step, past = ultimate.motion, ultimate.step, 0
    fields = step.step.fields if step else ()
    unknown = not {*fields} <= {*experiment.algorithm.STATE}
    if step and experiment.impaired:  # what was under way is known of what is recorded alone
        past, unknown = step.longest, len(fields) > len(ESTIMATE)
    no_recursion = step is None and not ultimate.recursions  # nor is what is left of a beginning
    if unknown or no_recursion or (motion is None and ultimate.worst_case is None):
        return (None,) * 4, 0.0, None
    if motion is not None and not np.all(np.isfinite(motion.phasor)):
        return (None,) * 4, 0.0, None
    since, clock = ultimate.since, experiment.clock
    story = errors_by_tick(reader, experiment.target_at, clock.t(max(since - past, 0)))
    ks, errors = _first(story, past + 1)
    if ks[: past + 1].tolist() != [*range(since - past, since + 1)]:
        return (None,) * 4, 0.0, None
    then, seen = ks[: past + 1], errors[: past + 1]
    if step and len(fields) > len(ESTIMATE):
        then, seen = ks[past : past + 1], _at_first(step.step, experiment)[None]
    recent = [*(seen if motion is None else seen - motion.at(then))]
    left = _left(ultimate, experiment, recent, reader.ticks)
    if left is None:
        return (None,) * 4, 0.0, None
    *transient, peak = left
    if motion is None:
        return (*transient, 0.0, 0.0), peak, None
    parts = chain([(ks[past:], errors[past:])], story)
    aside = (x - motion.at(k)[:, :2] for k, x in parts)
    period = sum(ticks for _, ticks in experiment.topologies.phases()) or 1
    # What is received may be off for ever, so that errors do not fall to the motion itself.
    factor = None if ultimate.added else _factor(aside, period)
    return (*transient, 0.0, 0.0), peak, factor


def _first(story: Iterator[tuple[Ticks, Array]], count: int) -> tuple[Ticks, Array]:
    """Return the first parts of a story that have so many ticks together, or all, as one."""
    ks, errors = np.zeros(0, np.int64), np.zeros((0, 2, 0, 0))
    for k, x in story:
        ks = np.concatenate([ks, k])
        errors = np.concatenate([errors, x]) if len(errors) else x
        if len(ks) >= count:
            break
    return ks, errors


def _left(
    ultimate: UltimateBounds, experiment: Experiment, recent: list[Array], end: int
) -> tuple[float, float, float] | None:
    """Return what is left of z in the last fifth, at most: positions and velocities, ‖·‖∞.

    `recent` are the z, (s, n, m) each, of the ticks up to the first, as many as are under way then.

    Beside them stands the largest that it came to, whose rounding is in all that follows. It is
    known where the last fifth begins when all is as in steady state, and z is of that tick.
    """
    clock = experiment.clock
    fifth = clock.since(clock.t(end) - clock.t(end) // 5)
    if end > LONGEST or fifth < ultimate.since:
        return None
    most, peak, k = np.zeros(2), 0.0, ultimate.since
    story = _rests(ultimate, experiment, recent, end)
    while block := [*islice(story, max(NUMBERS // recent[-1].size, 1))]:
        sizes = np.abs(block)
        peak = max(peak, float(sizes.max()))
        late = sizes[max(fifth - k, 0) :, :2]
        most = np.maximum(most, late.max(axis=(0, 2, 3), initial=0.0))
        k += len(block)
    return float(most[0]), float(most[1]), peak


def _rests(
    ultimate: UltimateBounds, experiment: Experiment, recent: list[Array], end: int
) -> Iterator[Array]:
    """Yield z(t_k), (s, n, m), of each tick until the last, or until they are lost in rounding."""
    clock, topologies, step = experiment.clock, experiment.topologies, ultimate.step
    jumps = [one.jump for one in ultimate.recursions]
    parts = step.parts() if step else []
    shape, least, t = recent[-1].shape, LOST**2 * np.abs(recent).max(), clock.t(ultimate.since)
    for k in range(ultimate.since, end + 1):
        yield recent[-1]
        if k % LOOK == 0 and np.abs(recent).max() <= least:
            return
        if step is None:
            x = jumps[topologies.at(k)] @ recent[-1].reshape(-1, shape[2])
            before, t = t, clock.t(k + 1)
            x[: shape[1]] += seconds(t - before) * x[shape[1] :]
            recent = [x.reshape(shape)]
        else:
            recent = [*recent, step.advance(recent, parts)][-1 - step.longest :]


def _at_first(step: LinearStep, experiment: Experiment) -> Array:
    """Return the errors of all that agents keep at t_1, left limits, (s, n, m)."""
    t = seconds(experiment.clock.t(1))
    left = experiment.algorithm.flow(experiment.initial_state(), t)
    return step.errors(left, experiment.target, t)


def _factor(aside: Iterator[Array], period: int) -> float | None:
    """Return the mean factor of ‖z(t_k)‖∞ over the second half of what is not lost in rounding.

    It is over whole periods of so many ticks, the last ones, and over one at least.
    """
    sizes: list[float] = []
    largest = 0.0
    each = chain.from_iterable(np.abs(z).max(axis=(1, 2, 3)).tolist() for z in aside)
    for size in islice(each, LONGEST):
        sizes.append(size)
        largest = max(largest, size)
        if size <= LOST * largest:
            break
    last = len(sizes) - 1
    span = max((last - len(sizes) // 2) // period, 1) * period
    if len(sizes) < 4 or span > last or not sizes[last - span] > 0 or not sizes[last] > 0:
        return None
    return float((sizes[last] / sizes[last - span]) ** (1 / span))
