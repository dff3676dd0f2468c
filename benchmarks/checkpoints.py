"""What checkpoints cost in time and bytes: runs with one every so many ticks, beside runs without.

All robots are in this process, and the time is what its threads had of a processor, from the first
tick to the last: a checkpoint waits for nothing. The intervals between checkpoints take turns, so
that a noisy machine is noisy to all, and the least of each is taken, since noise only adds. What
one checkpoint costs is told in ticks of a run without: from the shortest interval, where it is
largest beside the noise, and of bytes likewise. That many ticks, over the share that a checkpoint
may cost, is the shortest interval within it. A recording with checkpoints has more channels, hence
larger chunks, which compress better: so the rare ones seem to cost less than nothing.
"""

import statistics
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

from benchmarks.table import keep
from benchmarks.work import scenario
from nrs_cosim.orchestrator.engine.run import run

EVERY = (500, 100, 50, 10)
"""Ticks between checkpoints; the first is what a scenario has by default."""
SIZES = {6: (2000, 9), 100: (500, 7), 1000: (500, 3)}
"""Robots; the ticks of one timed run, and how many rounds."""
SHARE = 0.02
"""Of time and bytes, what checkpoints may cost."""


def cost(n: int, ticks: int, every: int, path: Path) -> tuple[float, float]:
    """Return the seconds of processor time that a run takes, and the bytes of its recording."""
    at: list[float] = []
    file = scenario(n, ticks, f"checkpoint_every = {every}")
    run(file, path, watch=lambda _time_ns: at.append(process_time()))
    return at[-1] - at[0], float(path.stat().st_size)


def measure(n: int, ticks: int, rounds: int, path: Path) -> list[dict[str, float]]:
    """Return, by interval, the ratios to a run without, and the shortest within SHARE."""
    costs = [[cost(n, ticks, every, path) for every in (0, *EVERY)] for _ in range(rounds)]
    least = [min(took for took, _ in of_one) for of_one in zip(*costs, strict=True)]
    sizes = [statistics.median(size for _, size in of_one) for of_one in zip(*costs, strict=True)]
    times, sizes = [s / least[0] for s in least[1:]], [size / sizes[0] for size in sizes[1:]]
    return [
        {
            "robots": n,
            "every": every,
            "time": time,
            "bytes": size,
            "shortest_by_time": (times[-1] - 1) * EVERY[-1] / SHARE,
            "shortest_by_bytes": (sizes[-1] - 1) * EVERY[-1] / SHARE,
        }
        for every, time, size in zip(EVERY, times, sizes, strict=True)
    ]


def main() -> None:
    """Print the table, and write it as JSON beside."""
    print("a run with checkpoints beside one without, as ratios; the least of interleaved rounds\n")
    print(f"{'robots':>7} {'every':>6} {'time':>7} {'bytes':>7}")
    rows = []
    with TemporaryDirectory(prefix="nrs-") as folder:
        for n, (ticks, rounds) in SIZES.items():
            found = measure(n, ticks, rounds, Path(folder) / "benchmark.mcap")
            rows += found
            for row in found:
                print(f"{n:>7} {row['every']:>6} {row['time']:>7.3f} {row['bytes']:>7.4f}")
            print(
                f"{n:>7} within {SHARE:.0%}: every {max(row['shortest_by_time'], 0):.0f} ticks "
                f"or more by time, {row['shortest_by_bytes']:.0f} by bytes"
            )
    keep("checkpoints", rows)


if __name__ == "__main__":
    main()
