"""Run the algorithms that are here on one example, and set what they cost beside what they reach.

`python -m docs.comparison DATA PAGE` writes recordings to DATA and a table to PAGE.
"""

import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

from benchmarks.table import machine
from nrs_cosim.bus.clock import seconds
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.orchestrator.analysis.bounds import ultimate_bounds
from nrs_cosim.orchestrator.engine.robots import agents_of
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import measure
from nrs_cosim.orchestrator.scenario.changes import Change
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import changed, read_scenario
from nrs_cosim.orchestrator.scenario.robot_ids import with_parameters
from nrs_cosim.recordings.export.tables import samples
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import SteadyState

SCENARIOS = Path(__file__).parents[1] / "scenarios"
OFF = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
"""rad and rad/s, that others may be off before an estimate is sent."""
PERIODS = (0.1, 0.01)
"""s, of sampling, at gains in proportion."""
ROBOTS, TICKS, TIMES = 1000, 50, 5
"""Of the network on which computation is timed, the sampling times, and how often these."""


@dataclass(frozen=True, slots=True)
class Compared:
    """What an algorithm reached on the example, and what it took."""

    algorithm: str
    h: float
    """s"""
    messages: float
    """Per robot and second."""
    numbers: float
    """Sent per robot and second."""
    errors: SteadyState
    bound: EstimateBounds | None
    """Of the errors of estimates in steady state, for this target."""
    fewest: tuple[float, float]
    """Sampling periods between two samples of a robot in the last fifth, by robot: from and to."""
    proven: NDArray[np.float64] | None
    """(n,) how many there are at least."""
    computation: float
    """µs of processor time per robot and second of simulated time; 0 where it is not timed."""


def compared(experiment: Experiment, recording: Path, *, timed: bool = True) -> Compared:
    """Run an experiment, and read its recording."""
    recording.unlink(missing_ok=True)
    run(experiment, recording)
    end = seconds(experiment.clock.t(experiment.clock.ticks))
    with Reader(recording) as reader:
        errors = measure(reader, experiment)
        tables = [found[["robot", "k"]][found["robot"] > 0] for found in samples(reader)]
        sent = np.concatenate(tables)
    messages = len(sent) / experiment.n / end
    ultimate = ultimate_bounds(experiment)
    chosen, h = experiment.scenario.algorithm, seconds(experiment.clock.longest)
    size = sum(int(np.prod(shape)) for shape in experiment.codecs.samples.shapes.values())
    return Compared(
        with_parameters(chosen.name, chosen.parameters),
        h,
        messages,
        messages * size,
        errors,
        ultimate.steady_state,
        _fewest(sent, experiment),
        ultimate.gaps,
        1e6 * computation(experiment) / h if timed else 0.0,
    )


def _fewest(sent: NDArray[np.void], experiment: Experiment) -> tuple[float, float]:
    """Return the fewest periods between two samples of a robot, the least and most by robot."""
    late = experiment.clock.ticks * 4 / 5
    fewest = []
    for robot in range(1, experiment.n + 1):
        k = sent["k"][sent["robot"] == robot]
        fewest.append(np.diff(k)[k[1:] > late].min(initial=experiment.clock.ticks))
    return float(min(fewest)), float(max(fewest))


def computation(experiment: Experiment) -> float:
    """Return the least processor time of an agent for a sampling time, s, of many that there are.

    It is of an algorithm alone: its flow, what it sends, and what it makes of what it receives.
    """
    network = f"network.generator={{kind='random_k_in',n={ROBOTS},k=4,pinned={[*range(1, 51)]}}}"
    large = changed(experiment, [Change.of("--set", network)])
    target = {name: np.zeros((1, *shape)) for name, shape in large.codecs.samples.shapes.items()}
    nodes, every = np.array([0]), np.arange(1, ROBOTS + 1)
    least = np.inf
    for _ in range(TIMES):
        agents = agents_of(large, every)
        began = process_time()
        for k in range(1, TICKS + 1):
            left = agents.left(seconds(large.clock.longest))
            agents.receive(k, nodes, target)
            if agents.observes:
                left = agents.observe(k, left)
            left, messages, who = agents.send(k, left)
            rows = slice(None) if who is None else who
            agents.receive(k, every[rows], {name: of[rows] for name, of in messages.items()})
            agents.jump(k, left)
        least = min(least, process_time() - began)
    return least / TICKS / ROBOTS


def row(found: Compared) -> str:
    """Return a row of the table."""
    errors = (
        found.errors.position_estimate,
        found.errors.velocity_estimate,
        found.errors.position_tracking,
    )
    cells = [
        f"`{found.algorithm}`",
        f"{found.h:g}",
        f"{found.messages:.3g}",
        f"{found.numbers:.3g}",
        *map(_number, errors),
        _number(found.bound and found.bound.position),
        f"{found.computation:.2g}",
    ]
    return _line(cells)


def triggered(data: Path) -> Iterator[str]:
    """Yield rows of what an event-triggered algorithm sends, and how far it is off."""
    experiment = read_scenario(SCENARIOS / "compare_event_triggered.toml")
    for h, off in product(PERIODS, OFF):
        gains = f"algorithm.alpha={9 * h},algorithm.beta={11 * h},run.sampling_period={h}"
        change = Change.of("--set", f"{gains},algorithm.c0={off},algorithm.d0={off}")
        other = changed(experiment, [change])
        found = compared(other, data / f"triggered_{h}_{off}.mcap", timed=False)
        errors, bound, proven = found.errors, found.bound, found.proven
        assert proven is not None
        yield _line(
            [
                f"{h:g}",
                f"{off:g}",
                f"{found.messages:.3g}",
                f"{(1 / proven).mean() / h:.3g}",
                _range(*found.fewest),
                _range(proven.min(), proven.max()),
                *map(_number, (errors.position_estimate, bound and bound.position)),
                *map(_number, (errors.velocity_estimate, bound and bound.velocity)),
            ]
        )


def _range(low: float, high: float) -> str:
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _number(number: float | None) -> str:
    return "–" if number is None else f"{number:.3g}"


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


_COLUMNS = (
    "algorithm",
    "h, s",
    "messages per robot and s",
    "numbers sent per robot and s",
    "sup ‖ε̄‖∞, rad",
    "sup ‖ῡ‖∞, rad/s",
    "sup ‖e‖₂, rad",
    "bound on ‖ε̄‖∞, rad",
    "computation, µs per robot and s",
)
PAGE = """# Algorithms on the paper's example

Written by `make paper` from `scenarios/compare_*.toml`: six arms, of which robot 3 receives from
the target, 2t + sin t and −2t − cos t. What the paper says of other algorithms in words is here in
numbers: what an estimate costs, and how far it is off in the last fifth.

{table}

The bound is for this target, in steady state; there is none where the theory knows of none.
Computation is processor time of the agents alone, of {robots} robots that receive from four others,
the least of {times} times {ticks} sampling times, on {machine}.

- `sliding` is made for continuous interaction. At h = 0.1 s its steps stay as an error; at 0.01 s
  it is about as good as the DCEA at 0.1 s, for ten times the messages and computation.
- `pd_like` is `dcea2` with one gain. `impulsive` seeks a constant value and lags behind the target.
- `dcea3` sends and keeps an acceleration too, for a third of the error. `event_triggered` is
  `dcea1` that sends what is off by c0 or d0 alone; its bounds are in [theory](../theory.md).
- `pi_consensus` adds an integral to `dcea1`, which takes most of the position's error away, for no
  further message.
- `kalman_consensus` also sends what was measured. A robot that receives from one that measures is
  as good as that one; robot 2, which does not, makes the largest errors. It alone measures with
  noise, of a standard deviation of 0.01 rad.

## Messages against errors

With `event_triggered`, α = 9 h and β = 11 h, by what a position (rad) and a velocity (rad/s)
may be off before they are sent: how much is sent, how many sampling periods there are at least
between two samples of a robot in the last fifth, by robot, and how far the estimates then are.
Each is beside what is proven of the steady state ([E1 to E3](../theory.md)); of samples and periods
that is of any target that moves and accelerates no more than this one, and whatever others' models
do within c0 and d0:

{triggered}
"""
_TRIGGERED = (
    "h, s",
    "c0 = d0",
    "messages per robot and s",
    "at most",
    "fewest periods",
    "at least",
    "sup ‖ε̄‖∞, rad",
    "bound",
    "sup ‖ῡ‖∞, rad/s",
    "bound",
)


def main(data: Path, page: Path) -> None:
    """Run all scenarios and write the page."""
    data.mkdir(parents=True, exist_ok=True)
    found = [
        compared(read_scenario(path), data / f"{path.stem}.mcap")
        for path in sorted(SCENARIOS.glob("compare_*.toml"))
    ]
    about = machine()
    text = PAGE.format(
        table="\n".join([_line(_COLUMNS), _line("---" for _ in _COLUMNS), *map(row, found)]),
        triggered="\n".join(
            [_line(_TRIGGERED), _line("---" for _ in _TRIGGERED), *triggered(data)]
        ),
        robots=ROBOTS,
        ticks=TICKS,
        times=TIMES,
        machine=f"{about['processor']}, Python {about['python']}, NumPy {about['numpy']}",
    )
    (page / "comparison.md").write_text(text, "utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
