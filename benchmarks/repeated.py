"""Many short runs in one process: what each leaves behind is the slope of memory over runs.

Memory is looked at every so many runs, after Python's rubbish was collected and malloc has given
back what is free; the slope is the least-squares line's over the second half, when caches are full.
Descriptors, threads and temporary folders have no slope: they must be as many after as before.
`make soak` prints all of it, and ends with 1 when a run leaves more than 2 KiB.
"""

import argparse
import ctypes
import gc
import sys
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.memory import now
from benchmarks.work import scenario
from nrs_cosim.orchestrator.engine.in_process import in_process
from nrs_cosim.orchestrator.engine.run import run

MOST = 2.0
"""KiB a run. One publisher that is left on its session is 13."""


@dataclass(frozen=True, slots=True)
class Holdings:
    """What a process holds that has no measure but a count."""

    descriptors: int
    threads: int
    folders: int

    @classmethod
    def now(cls) -> "Holdings":
        """Return what this process holds."""
        native = len([*Path("/proc/self/task").iterdir()])
        temporary = len([*Path(tempfile.gettempdir()).glob("nrs-*")])
        return cls(len([*Path("/proc/self/fd").iterdir()]), native, temporary)


def repeat(runs: int, every: int, folder: Path) -> list[tuple[int, float]]:
    """Run so many times; return after how many how much memory there was, KiB."""
    trim = ctypes.CDLL(None).malloc_trim
    file, seen = scenario(4, 1), []
    for number in range(1, runs + 1):
        outcome = run(file, folder / "run.mcap", in_process(file))
        assert outcome.status == "completed", outcome.reason
        if number % every == 0:
            gc.collect()
            trim(0)
            seen.append((number, now() / 1024))
    return seen


def slope(seen: list[tuple[int, float]]) -> float:
    """Return KiB a run, of the second half."""
    late = np.array(seen[len(seen) // 2 :])
    return float(np.polyfit(late[:, 0], late[:, 1], 1)[0])


def main() -> None:
    """Print memory over runs, and what is held before and after."""
    options = argparse.ArgumentParser(description="many short runs in one process")
    options.add_argument("--runs", type=int, default=1000)
    asked = options.parse_args()
    with TemporaryDirectory(prefix="soak-") as folder:
        repeat(10, 10, Path(folder))  # what is loaded once
        before = Holdings.now()
        seen = repeat(asked.runs, max(asked.runs // 20, 1), Path(folder))
        after = Holdings.now()
    for number, memory in seen:
        print(f"{number:6} runs {memory / 1024:8.2f} MiB", flush=True)
    leak = slope(seen)
    print(f"{leak:.2f} KiB a run in the second half; {threading.active_count()} Python threads")
    print(f"before {before}\nafter  {after}")
    sys.exit(leak > MOST or before != after)


if __name__ == "__main__":
    main()
