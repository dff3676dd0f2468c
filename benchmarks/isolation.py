"""What a worker process costs: the same arms stepped in it and in this process, in one run.

Both take new references, advance by h and give their states, without bus or recording. The two
take turns, so that a noisy machine is noisy to both.
"""

import statistics
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from benchmarks.table import keep
from nrs_cosim.plant_fmu.archives.archive import find_archive
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.isolation.isolated import IsolatedPlants
from nrs_cosim.plant_fmu.plants import Body, Disturbance, Plants

H = 0.1
ROUNDS = 9
SIZES = {1: 1000, 10: 500, 100: 100, 1000: 10}
"""Robots, and the intervals of one timed round."""


def bodies(n: int) -> list[Body]:
    """Return n arms at rest, with the paper's gains and a disturbance."""
    zero, ones = np.zeros(2), np.ones((2, 1))
    waves = Disturbance(zero, zero, 2 * ones, ones, 0 * ones)
    kp, kd = 200.0 * np.eye(2), 300.0 * np.eye(2)
    return [Body(i, {}, kp, kd, waves, zero, zero, zero, zero) for i in range(1, n + 1)]


def timed(plants: Plants, n: int, first: int, intervals: int) -> float:
    """Return the seconds that some intervals take."""
    ahead = np.linspace(-0.3, 0.3, 2 * n).reshape(n, 2)
    start = time.perf_counter()
    for k in range(first, first + intervals):
        t = k * H
        plants.hold(ahead + np.sin(t), ahead + np.cos(t))
        plants.advance(t, H)
    return time.perf_counter() - start


def measure(n: int, intervals: int) -> dict[str, float]:
    """Return the µs of a robot-interval in a worker and here, and the median of their ratio."""
    archive = find_archive("two_link_arm", Path())
    with ExitStack() as stack:
        isolated = IsolatedPlants(stack, archive, bodies(n), {}, Driving(), 10.0)
        here = open_plants(stack, archive, bodies(n), {})
        rounds = [
            [timed(plants, n, i * intervals, intervals) for plants in (isolated, here)]
            for i in range(ROUNDS)
        ]
        assert np.array_equal(isolated.q, here.q)
    us = 1e6 / (n * intervals)
    return {
        "robots": n,
        "isolated_us": statistics.median(a for a, _ in rounds) * us,
        "here_us": statistics.median(b for _, b in rounds) * us,
        "ratio": statistics.median(a / b for a, b in rounds),
    }


def main() -> None:
    """Print the table, and write it as JSON beside."""
    print(f"us of a robot-interval, h = {H} s; medians of {ROUNDS} interleaved rounds\n")
    print(f"{'robots':>7} {'in a worker':>12} {'in process':>11} {'ratio':>6}")
    rows = []
    for n, intervals in SIZES.items():
        row = measure(n, intervals)
        rows.append(row)
        print(f"{n:>7} {row['isolated_us']:>12.1f} {row['here_us']:>11.1f} {row['ratio']:>6.2f}")
    keep("isolation", rows)


if __name__ == "__main__":
    main()
