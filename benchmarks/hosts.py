"""Recorded robot-intervals per second of a run over two host processes of this machine, and of one.

One host is in the orchestrator's own process, with no socket; two are processes that it starts,
which meet it at a Unix socket, and the orchestrator records in a third. What is timed is the ticks:
starting the hosts and closing the recording are apart. The two take turns, so that a noisy machine
is noisy to both; the ratio is bounded by its cores, of which the recording needs a part.
"""

import os
import statistics
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.table import compared, keep, spread
from benchmarks.throughput import scenario
from orchestrator.hosts.manning import Handling, here
from orchestrator.runs.alone import alone
from orchestrator.runs.lockstep import Manning
from orchestrator.runs.running import run
from orchestrator.scenario.file import ScenarioFile

ROUNDS = 5
SIZES = {100: 400, 1000: 80}
"""Robots, and the ticks of one timed run."""
HANDLING = Handling(restart=False, wait=60.0, show=lambda _text: None)


def per_second(file: ScenarioFile, man: Manning, folder: Path, intervals: int) -> float:
    """Return the robot-intervals that a run records in a second."""
    outcome = run(file, folder / "benchmark.mcap", man)
    assert outcome.status == "completed", outcome.reason
    return intervals / outcome.wall_seconds


def main() -> None:
    """Print the table, and write it as JSON beside."""
    print(f"robot-intervals recorded per second by 2 hosts and by 1, on {os.cpu_count()} cores;")
    print(f"medians of {ROUNDS} interleaved rounds; the ratio is the median of the rounds' own\n")
    print(f"{'robots':>7} {'2 hosts/s':>11} {'1 host/s':>12} {'ratio':>6}   min .. max")
    rows = []
    with TemporaryDirectory(prefix="nrs-") as name:
        folder = Path(name)
        for n, ticks in SIZES.items():
            file = scenario(n, ticks)
            two, one = [], []
            for _ in range(ROUNDS):
                two.append(per_second(file, here(file, 2, HANDLING), folder, n * ticks))
                one.append(per_second(file, alone(file), folder, n * ticks))
            row = {
                "robots": n,
                "two_hosts_per_s": statistics.median(two),
                "one_host_per_s": statistics.median(one),
                **compared(two, one),
            }
            rows.append(row)
            print(
                f"{n:>7} {row['two_hosts_per_s']:>11,.0f} {row['one_host_per_s']:>12,.0f} "
                f"{spread(row)}"
            )
    keep("hosts", rows)


if __name__ == "__main__":
    main()
