"""A sampled target is there for the whole run: its times increase, and cover 0 to run.duration."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from estimator_agents.target import Sampled
from orchestrator.scenario.tables import SampledTarget, Scenario


def wrong_target(scenario: Scenario) -> Iterator[str]:
    """Yield what is wrong with a sampled target; until that is right, its axes are not counted."""
    target, duration = scenario.target, scenario.run.duration
    if not isinstance(target, SampledTarget):
        return
    times, rows = target.times, target.positions
    if target.file is not None:
        yield (
            f"target.file: {target.file!r} was not read, which is done where a scenario file is; "
            f"give times and positions instead"
        )
        return
    if len(times) < 2:
        yield (
            f"target.times: expected two times at least, got {len(times)}; "
            f"give times and positions, or file"
        )
        return
    if len(rows) != len(times):
        yield (
            f"target.positions: expected {len(times)} rows, one for each of target.times, "
            f"got {len(rows)}"
        )
        return
    wrong = [
        f"target.positions[{i}]: expected {len(rows[0])} numbers, as in the first row, "
        f"got {len(row)}"
        for i, row in enumerate(rows)
        if len(row) != len(rows[0])
    ]
    wrong += [
        f"target.times[{i}]: expected times that increase, got {after!r} after {before!r}"
        for i, (before, after) in enumerate(pairwise(times), 1)
        if not before < after
    ]
    yield from wrong[:1]
    if wrong:
        return
    if times[0] > 0 or times[-1] < duration:
        yield (
            f"target.times: expected times that cover 0 to {duration!r} s (run.duration), got "
            f"{times[0]!r} to {times[-1]!r} s; give samples of the rest, or a shorter run"
        )
    if not _is_finite(target):
        yield "target.positions: expected a motion of finite velocity and acceleration, got none"


def _is_finite(target: SampledTarget) -> bool:
    with np.errstate(all="ignore"):
        try:
            motion = Sampled.of(target.times, target.positions)
        except ValueError:  # times so near to one another that there is no solution
            return False
        return bool(np.all(np.isfinite(motion.spline.c)) and np.all(np.isfinite(motion.bounds())))
