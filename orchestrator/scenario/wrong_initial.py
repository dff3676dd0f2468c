"""What may be wrong with what robots start with: a shape, a draw, or a key that nothing has."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import ESTIMATE, Fields, Sizes
from nrs_cosim.bus.text import nearest, shortened
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.scenario import Initial, Kept
from nrs_cosim.orchestrator.scenario.tables.values import Uniform

AXES = "numbers, one for each of the target's axes"


def wrong_initial(experiment: Experiment, *, sized: bool) -> Iterator[str]:
    """Yield what is wrong with the start of all robots, and of single ones.

    `sized` says whether the network is right, which shapes may depend on.
    """
    scenario = experiment.scenario
    n, m = scenario.n, scenario.m
    try:
        kept: Fields | None = experiment.algorithm.STATE
    except InputError:  # what is wrong with the algorithm is said elsewhere
        kept = None
    for name in ("q", "qd"):
        if name in (kept or ()):
            yield f"algorithm.name: STATE: {name} is a key of [initial] for joints; rename it"
    sizes = experiment.sizes if sized else None
    for name in Initial.model_fields:
        yield from _rows_faults(f"initial.{name}", scenario.initial.given(name), n, m)
    yield from _further_faults("initial", scenario.initial, kept, sizes, n)
    for i, robot in enumerate(scenario.robots):
        here = f"robots[{i}].initial"
        for name in Initial.model_fields:
            value = robot.initial.given(name)
            yield from _draw_faults(f"{here}.{name}", value)
            if isinstance(value, tuple):
                yield from length_fault(f"{here}.{name}", value, m, AXES)
        yield from _further_faults(here, robot.initial, kept, sizes, None)


def length_fault(where: str, value: Sequence[Any], length: int, of: str) -> Iterator[str]:
    """Yield that a list has another length than it should have."""
    if len(value) != length:
        yield f"{where}: expected {length} {of}, got {len(value)}"


def _draw_faults(where: str, value: Any) -> Iterator[str]:
    if isinstance(value, Uniform) and value.uniform[0] > value.uniform[1]:
        yield f"{where}.uniform: expected [low, high] with low <= high, got {list(value.uniform)}"


def _rows_faults(where: str, value: Any, n: int, m: int) -> Iterator[str]:
    """Yield what is wrong with m numbers for all robots, or for each."""
    yield from _draw_faults(where, value)
    if not isinstance(value, tuple):
        return
    rows = [row for row in value if isinstance(row, tuple)]
    shape = f"expected {m} numbers for each robot, or {n} x {m}, a row for each"
    if not rows and len(value) != m:
        yield f"{where}: {shape}, got {len(value)} numbers"
    elif rows and len(rows) != n:
        yield f"{where}: {shape}, got {len(rows)} rows"
    for i, row in enumerate(rows):
        yield from length_fault(f"{where}[{i}]", row, m, AXES)


def _further_faults(
    where: str, given: Kept, kept: Fields | None, sizes: Sizes | None, n: int | None
) -> Iterator[str]:
    """Yield what is wrong with fields of the algorithm's own, for n robots or for a single one."""
    further = {name: field for name, field in (kept or {}).items() if name not in ESTIMATE}
    known = [*Initial.model_fields, *further]
    for name, value in (given.model_extra or {}).items() if kept is not None else ():
        here = f"{where}.{shortened(name)}"
        if name not in further:
            yield f"{here}: unknown key{nearest(name, known)}"
            continue
        yield from _draw_faults(here, value)
        if sizes and isinstance(value, tuple):
            shape = further[name].size(sizes)
            allowed = [shape] if n is None else [shape, (n, *shape)]
            got = _shape(value)
            if got not in allowed:
                each = "" if n is None else f", or {_numbers((n, *shape))}, a row for each robot"
                found = "lists of several lengths" if got is None else _numbers(got)
                yield f"{here}: expected {_numbers(shape)}{each}, got {found}"


def _shape(value: Any) -> tuple[int, ...] | None:
    try:
        shape: tuple[int, ...] = np.shape(value)
    except ValueError:
        return None
    return shape


def _numbers(shape: tuple[int, ...]) -> str:
    return f"{' x '.join(map(str, shape))} numbers" if shape else "a number"
