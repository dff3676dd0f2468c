"""What is left of a run's beginning at t_k, beside what its errors settle to.

It is z(t_1) after so many jumps and flows, with z = x − what x settles to for the run's target. z
also has the measured factor: the mean by which ‖z‖∞ shrinks at a sampling time, over the second
half of the ticks until it is lost in rounding.

Where it is not known what x settles to, the target might have moved on straight until t_1 as it
does there. Of such a target, x at t_k is within the bound for any target, and z = x − what x would
be at t_1. There is no factor then. Over late links that is not known: samples are under way at t_1
which the target sent while it moved otherwise.
"""

from collections.abc import Iterator
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.fields import ESTIMATE
from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.theory.estimates import SteadyMotion, steady_motion
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep
from nrs_cosim.orchestrator.analysis.bounds import UltimateBounds
from nrs_cosim.orchestrator.analysis.convergence import lasting
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import errors_by_tick

Array = NDArray[np.float64]
Ticks = NDArray[np.int64]

LOST = 1e-9
"""Of the first error: what is below may be rounding."""
LONGEST = 200_000
"""Ticks for which the rest of the beginning is followed."""
NUMBERS, LOOK = 2**14, 64
"""Of the rest, compared at once; and the ticks after which it is seen whether any is left."""


def beginning(
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
    beside = motion or _had_it_moved_straight(ultimate, experiment, past)
    recent = [*(seen - beside.at(then)[:, : seen.shape[1]])] if beside else []
    left = _left(ultimate, experiment, recent, reader.ticks) if recent else None
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


def _had_it_moved_straight(
    ultimate: UltimateBounds, experiment: Experiment, past: int
) -> SteadyMotion | None:
    """Return what errors settle to at a target that moves on as it does when all becomes steady.

    None where that is not known or changes with the periods, or samples of `past` ticks are under
    way.
    """
    _, rate = experiment.target_at(np.array(seconds(experiment.clock.t(ultimate.since))))
    none = np.zeros((experiment.m, 0))
    straight = Harmonic(0 * rate, rate, none, none, none)
    if ultimate.step:
        return None if past else ultimate.step.steady_motion(straight)
    recursion = lasting(ultimate.recursions, experiment.topologies)
    if recursion is None or (ultimate.aperiodic and recursion.drag.any()):
        return None
    return steady_motion(recursion, straight, 0.0)


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
