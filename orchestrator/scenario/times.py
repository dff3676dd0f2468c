"""When a scenario's robots exchange samples: periodically, by a list, or early by a jitter.

Either `run.sampling_period`, with a jitter or without, or `run.sampling_times`. A list is the whole
run, unless `run.duration` is a multiple of it: then it is repeated.
"""

from collections.abc import Iterator
from decimal import Decimal
from itertools import pairwise

from nrs_cosim.bus.clock import NS_PER_S, nanoseconds, seconds
from nrs_cosim.orchestrator.scenario.experiment import Experiment

LONGEST_NS, MOST_TICKS = 2**63, 2**32
TRIES = 10_000
"""Divisors that are tried, for advice."""
MOST_PARTS = 64
"""More than the fewest, of a period whose output step is chosen anew."""


def longest_part(period: float, most: float) -> float:
    """Return the longest part of a period that is whole ns and at most so long; all times in s."""
    whole = nanoseconds(period)
    fewest = -(-whole // nanoseconds(most))
    parts = next((n for n in range(fewest, fewest + MOST_PARTS) if whole % n == 0), 1)
    return seconds(whole // parts)


def wrong_times(experiment: Experiment) -> Iterator[str]:
    """Yield what is wrong with the run's times, and in their relation to one another."""
    run = experiment.scenario.run
    if run.sampling_times and run.sampling_period:
        yield "run.sampling_times: give these or run.sampling_period, not both"
        return
    if run.end is None:
        yield "run.duration: missing, it has no default"
    if not run.sampling_times and not run.sampling_period:
        yield "run.sampling_period: missing; give it, or run.sampling_times"
        return
    if run.sampling_times and run.sampling_jitter:
        yield (
            f"run.sampling_jitter: expected none beside run.sampling_times, "
            f"got {run.sampling_jitter!r}"
        )
        return
    given = {name: getattr(run, name) for name in ("duration", "sampling_period", "output_step")}
    given |= {f"sampling_times[{i}]": t for i, t in enumerate(run.sampling_times)}
    wrong = [
        fault for name, time in given.items() if time is not None for fault in _whole(name, time)
    ]
    yield from wrong
    if not wrong:
        yield from _wrong_list(experiment) if run.sampling_times else _wrong_period(experiment)


def _whole(name: str, time: float) -> Iterator[str]:
    try:
        ns = nanoseconds(time)
    except ValueError as error:
        nearest = max(round(Decimal(repr(time)) * NS_PER_S), 1)
        yield (
            f"run.{name}: expected a whole number of nanoseconds, but {error}; the nearest is "
            f"{seconds(nearest)!r} s"
        )
        return
    if ns >= LONGEST_NS:
        yield f"run.{name}: expected less than 2^63 ns (292 years), got {time!r} s"


def _wrong_period(experiment: Experiment) -> Iterator[str]:
    run, made = experiment.scenario.run, experiment.clock
    period, duration = nanoseconds(run.sampling_period or 0), nanoseconds(run.duration or 0)
    if duration // period >= MOST_TICKS:
        yield f"run.duration: expected fewer than 2^32 sampling periods, got {run.duration!r} s"
    if duration % period:
        yield (
            f"run.duration: expected a whole number of sampling periods of "
            f"{run.sampling_period!r} s, such as {_multiples(duration, period)}, "
            f"got {run.duration!r} s"
        )
    if run.output_step and period % nanoseconds(run.output_step):
        yield (
            f"run.output_step: expected a step that divides the sampling period of "
            f"{run.sampling_period!r} s{_divisors(period, nanoseconds(run.output_step))}, got "
            f"{run.output_step!r} s"
        )
        return
    if made.shortest < made.parts:
        yield (
            f"run.sampling_jitter: expected a part that leaves every interval {made.parts} ns at "
            f"least, one for each output step, got {run.sampling_jitter!r}"
        )


def _multiples(ns: int, period: int) -> str:
    """Return the multiples of a period below and above a time."""
    below = ns // period * period
    near = [time for time in (below, below + period) if time]
    return " or ".join(f"{seconds(time)!r}" for time in near)


def _divisors(period: int, step: int) -> str:
    """Name the steps next to one that divide a period, as far as these are soon found."""
    count = max(period // step, 1)
    fewer = next((n for n in range(count, max(count - TRIES, 0), -1) if not period % n), 0)
    more = next((n for n in range(count + 1, count + TRIES) if not period % n), 0)
    near = [f"{seconds(period // n)!r}" for n in (more, fewer) if n]
    return f", such as {' or '.join(near)}" * bool(near)


def _wrong_list(experiment: Experiment) -> Iterator[str]:
    run, made = experiment.scenario.run, experiment.clock
    times = [nanoseconds(t) for t in run.sampling_times]
    for i, (before, after) in enumerate(pairwise((0, *times))):
        if not before < after:
            than = run.sampling_times[i - 1]
            yield (
                f"run.sampling_times[{i}]: expected times that increase, "
                f"got {run.sampling_times[i]!r} after {than!r}"
            )
            return
    turn, end = times[-1], nanoseconds(run.end or 0)
    if end % turn:
        yield (
            f"run.duration: expected the last of run.sampling_times, {run.sampling_times[-1]!r} s, "
            f"or a multiple of it, for the list is repeated, such as {_multiples(end, turn)}; "
            f"got {run.duration!r} s"
        )
        return
    if end // turn * len(times) >= MOST_TICKS:
        yield f"run.duration: expected fewer than 2^32 sampling times, got {run.duration!r} s"
    if made.shortest < made.parts:
        yield (
            f"run.output_step: expected {made.shortest} parts of each interval at most, which is "
            f"as many as the shortest has ns, got {run.output_step!r} s, which makes {made.parts}"
        )
