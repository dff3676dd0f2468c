"""What every peer does: arms of one FMU, driven to a reference, or each to where the one before is.

    driven    position_ref of every arm is a constant, set once; a disturbance keeps it in motion
    chain     position_ref of arm i is q of arm i - 1; that of the first is the constant

After every step of h the values q, qd of every arm are handed to Python. This runs in the engines'
own environment, so nothing else of this project is imported. What a chain comes to depends on when
values go over:

    Jacobi              all at once, before each step, the first included
    Jacobi, first late  the same, but the first step still has the constant
    Gauss-Seidel        each after the step of the one before
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

H = 0.1
REFERENCE = (0.5, -0.3)
KP, KD = 200.0, 300.0
AMPLITUDE, FREQUENCIES = 50.0, (1.0, 2.0)
"""Of the disturbance, N m and rad/s."""
JOINTS = (1, 2)

States = list[list[float]]
"""q and qd of each arm."""


@dataclass(frozen=True)
class Work:
    """n arms for some ticks; `fmu` is FMI 2.0."""

    fmu: str
    n: int
    ticks: int
    chain: bool

    def start_values(self, arm: int) -> dict[str, float]:
        """Return what an arm starts with, by variable."""
        return {
            **{f"kp[{i},{i}]": KP for i in JOINTS},
            **{f"kd[{i},{i}]": KD for i in JOINTS},
            **{f"disturbance_amplitude[{i},1]": AMPLITUDE for i in JOINTS},
            **{f"disturbance_frequency[{i},1]": FREQUENCIES[i - 1] for i in JOINTS},
            **{f"position_ref[{i}]": REFERENCE[i - 1] for i in JOINTS},
            **{f"q[{i}]": q for i, q in zip(JOINTS, start(arm), strict=True)},
        }

    @property
    def links(self) -> list[tuple[tuple[int, str], tuple[int, str]]]:
        """What goes where: arm and variable, arm and variable."""
        if not self.chain:
            return []
        return [
            ((arm - 1, f"q[{i}]"), (arm, f"position_ref[{i}]"))
            for arm in range(1, self.n)
            for i in JOINTS
        ]


def start(arm: int) -> tuple[float, float]:
    """Return q of an arm at t = 0."""
    return 0.4 - 0.3 * (arm % 7) / 7, -0.2 + 0.3 * (arm % 5) / 5


OUTPUTS = [f"{name}[{i}]" for name in ("q", "qd") for i in JOINTS]


def report(run: Callable[[Work], tuple[float, States]]) -> None:
    """Run the work that a file holds; print the seconds of its steps, and the states at its end."""
    work = Work(**json.loads(Path(sys.argv[1]).read_text("utf-8")))
    seconds, end = run(work)
    print("\n" + json.dumps({"seconds": seconds, "end": end}))


def timed(work: Work, step: Callable[[int], States]) -> tuple[float, States]:
    """Return the seconds of all steps, each of which returns the states, and the last of them."""
    began, states = time.perf_counter(), []
    for k in range(work.ticks):
        states = step(k)
    return time.perf_counter() - began, states
