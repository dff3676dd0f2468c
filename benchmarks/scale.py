"""What a robot-interval costs by how many robots there are: time, memory, bytes of the recording.

Robots whose equations are linear, each with three in-neighbours, ten ticks on one worker; each
network in a process of its own. The set-up is apart.
"""

from argparse import ArgumentParser
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.measured import Found, apart, recorded_file
from benchmarks.table import keep, machine
from benchmarks.work import SCENARIO
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import parse_scenario

TICKS = 10
SIZES = (1_000, 10_000, 30_000, 100_000)
WIDE = (8, 15, 6, 10, 8, 6)
SHOWN = (("robots", 0), ("cpu_us", 2), ("us", 2), ("setup_ms", 3), ("peak_mb", 0), ("bytes", 0))
SOFT = {"KP": 2.0, "KD": 3.0, "AMPLITUDE": 2.0, "FREQUENCY": 1.0}


def measured(n: int, path: Path) -> Found:
    """Return what a run of n robots takes."""
    text = SCENARIO.format(duration=TICKS / 10, n=n, more="", **SOFT)
    text = text.replace("two_link_arm", "planar_robot")

    def read() -> Experiment:
        return parse_scenario(text, f"robots_{n}", Path(), "benchmark")

    return recorded_file(read, TICKS, 1, path)


def main() -> None:
    """Print the table, and write it as JSON beside."""
    options = ArgumentParser(description=__doc__)
    options.add_argument("sizes", nargs="*", type=int, default=SIZES)
    heads = ("robots", "processor, us", "us", "set-up, ms", "peak, MB", "bytes")
    print(" ".join(f"{head:>{wide}}" for head, wide in zip(heads, WIDE, strict=True)))
    rows = []
    with TemporaryDirectory() as folder:
        for n in options.parse_args().sizes:
            found = apart(measured, n, Path(folder) / f"{n}.mcap")
            intervals = n * TICKS
            row = {
                "robots": n,
                "cpu_us": found["cpu"] / intervals * 1e6,
                "us": found["seconds"] / intervals * 1e6,
                "setup_ms": found["setup_cpu"] / n * 1e3,
                "peak_mb": found["peak"] / 1e6,
                "bytes": found["bytes"] / intervals,
            }
            rows.append(row)
            print(
                " ".join(
                    f"{row[name]:{wide}.{digits}f}"
                    for (name, digits), wide in zip(SHOWN, WIDE, strict=True)
                )
            )
    keep("scale", {"machine": machine(), "rows": rows})


if __name__ == "__main__":
    main()
