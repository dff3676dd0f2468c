"""The work that is measured: arms with three in-neighbours each, and the same arms without a bus.

A robot-interval is one sample on the bus, one doStep of h, and one recorded state. What follows
the recorded references instead, through whatever interface, must come to the recorded states.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.values import Values
from nrs_cosim.orchestrator.engine.robots import agents_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import parse_scenario
from nrs_cosim.recordings.export.tables import SAMPLES
from nrs_cosim.recordings.recording import Recording

H = 0.1
KP, KD = 200.0, 300.0
AMPLITUDE, FREQUENCY = 2.0, 1.0
"""Of the disturbance on the first joint."""

SCENARIO = """
[run]
duration = {duration}
sampling_period = 0.1
seed = 1
{more}
[algorithm]
name = "dcea1"
alpha = 0.9
beta = 0.9
[controller]
kp = {KP}
kd = {KD}
[network]
generator = {{ kind = "random_k_in", n = {n}, k = 3, pinned = [1] }}
[target]
axes = [{{ rate = 2.0, sines = [{{ amplitude = 1.0, frequency = 1.0 }}] }}, {{ rate = -2.0 }}]
[plant]
fmu = "two_link_arm"
[disturbance]
axes = [{{ sines = [{{ amplitude = {AMPLITUDE}, frequency = {FREQUENCY} }}] }}, {{}}]
[initial]
position = {{ uniform = [-1.0, 1.0] }}
velocity = {{ uniform = [-1.0, 1.0] }}
q = {{ uniform = [-1.0, 1.0] }}
qd = {{ uniform = [-1.0, 1.0] }}
"""


def scenario(n: int, ticks: int, more: str = "") -> Experiment:
    """Return n arms, each with three in-neighbours, the first pinned; `more` is in `[run]`."""
    numbers = {"KP": KP, "KD": KD, "AMPLITUDE": AMPLITUDE, "FREQUENCY": FREQUENCY}
    text = SCENARIO.format(duration=ticks / 10, n=n, more=more, **numbers)
    return parse_scenario(text, f"arms_{n}", Path(), "benchmark")


def keep_motion(file: Experiment, recorded: Path, kept: Path) -> None:
    """Keep what the arms of a recording were given and came to, for `Motion`."""
    robots = range(1, file.scenario.n + 1)
    agents = agents_of(file, robots)
    first = file.initial_estimates(robots)
    references = [np.hstack([first.position, first.velocity])]
    with Recording(recorded) as recording:
        start, end = (
            recording.states(end=H / 2),
            recording.states(start=recording.ticks * H - H / 2),
        )
        for _, rows in recording.chunks([SAMPLES]):
            for k in np.unique(rows["k"]).tolist():
                of_k = rows[rows["k"] == k]
                received = of_k[np.isin(of_k["robot"], agents.in_neighbours)]
                fields = ("position", "velocity")
                agents.receive(k, received["robot"], {name: received[name] for name in fields})
                left = of_k[of_k["robot"] > 0]
                agents.jump(k, Values({name: left[name] for name in fields}))
                estimate = agents.state
                references.append(np.hstack([estimate.position, estimate.velocity]))
    np.savez(
        kept,
        references=np.array(references[:-1]),
        start=np.hstack([start["position"], start["velocity"]]),
        end=np.hstack([end["position"], end["velocity"]]),
    )


class Motion:
    """What the arms of a recording were given and came to.

    `references` (ticks, n, 4) hold ε_i(t_k⁺), υ_i(t_k⁺), `start` and `end` (n, 4) q and q̇.
    """

    def __init__(self, kept: Path) -> None:
        with np.load(kept) as arrays:
            self.references: NDArray[np.float64] = arrays["references"]
            self.start: NDArray[np.float64] = arrays["start"]
            self.end: NDArray[np.float64] = arrays["end"]

    def expect(self, found: Sequence[Sequence[float]] | NDArray[np.float64]) -> None:
        """Raise AssertionError unless q and q̇ are those that were recorded last, bit by bit."""
        assert np.array_equal(np.asarray(found), self.end), "not the states that were recorded"
