"""`nrs run` of the paper's example as a user runs it, beside a script that does less of the same.

Both are commands: start-up is in them. The script has NumPy and FMPy, neither bus nor disk, and
must come to the recorded states within the tolerance of sums that are added in another order. They
take turns; wall time, and processor time of all threads.

`nrs info` of that recording and `nrs check` of that scenario stand beside `import numpy`, for
seconds are another machine's, and beside the libraries that they cannot do without, imported alone.
"""

import os
import statistics
import subprocess
import sys
import time
from argparse import ArgumentParser
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks import plain_script
from benchmarks.table import compared, keep, machine, text
from nrs_cosim.plant_fmu.archives.archive import find_archive
from nrs_cosim.recordings.recording import Recording

SCENARIO = Path(__file__).parents[1] / "scenarios" / "paper_first_order.toml"
COMMAND, SCRIPT = "nrs run", "script with FMPy"
CLOSE = 1e-6
"""rad and rad/s"""
NUMPY = "import numpy"
_LIBRARIES = """import atexit, gc, os
os.environ["PYDANTIC_DISABLE_PLUGINS"] = "__all__"
gc.set_threshold(200_000)
atexit.register(gc.freeze)
import numpy, rich.console, typer
from pathlib import Path
from pydantic import BaseModel
class Table(BaseModel):
    number: int
def command(path: Path) -> None:
    Table(number=1)
app = typer.Typer(pretty_exceptions_enable=False)
app.command()(command)
"""
"""With a command of one path and a table of one field: Typer has pydantic take what is given, and
pydantic loads most of itself for the first table. With the settings of `nrs`."""
_READING = "google.protobuf.descriptor_pb2, mcap.records, zstandard, lz4.frame"
STARTS: Mapping[str, str] = {
    NUMPY: "import numpy",
    "libraries of check": f"{_LIBRARIES}app(['.'])",
    "libraries of info": f"{_LIBRARIES}import {_READING}\napp(['.'])",
}
"""What Python alone does, by what it is called."""


def spent(command: Sequence[str | Path]) -> dict[str, float]:
    """Return the seconds that a command takes, of the wall and of the processor."""
    began, before = time.perf_counter(), os.times()
    subprocess.run(command, check=True, capture_output=True)
    wall, after = time.perf_counter() - began, os.times()
    cpu = after.children_user + after.children_system
    return {"seconds": wall, "cpu": cpu - before.children_user - before.children_system}


def ends_of(path: Path, start: Path) -> np.ndarray:
    """Keep where the arms of a recording begin; return q and q̇ at its end, (n, 4)."""
    with Recording(path) as recording:
        states = recording.states()
    first, last = (states[states["time_ns"] == t] for t in (0, states["time_ns"].max()))
    names = {"q": "position", "qd": "velocity"}
    estimates = {name: f"reference_{name}" for name in ("position", "velocity")}
    np.savez(start, **{name: first[of] for name, of in (names | estimates).items()})
    return np.hstack([last["position"], last["velocity"]])


def measured(folder: Path, rounds: int) -> Mapping[str, list[dict[str, float]]]:
    """Return what each round took."""
    path, start, end = folder / "run.mcap", folder / "start.npz", folder / "end.npy"
    nrs = [sys.executable, "-m", "nrs_cosim.orchestrator", "run", SCENARIO, "-o", path, "--force"]
    fmu = find_archive("two_link_arm", Path()).path
    script = [sys.executable, plain_script.__file__, SCENARIO, fmu, start, end]
    spent(nrs)
    expected = ends_of(path, start)
    found: defaultdict[str, list[dict[str, float]]] = defaultdict(list)
    for _ in range(rounds):
        found[COMMAND].append(spent(nrs))
        found[SCRIPT].append(spent(script))
        np.testing.assert_allclose(np.load(end), expected, rtol=0, atol=CLOSE)
    return found


def started(recording: Path, rounds: int) -> Mapping[str, list[dict[str, float]]]:
    """Return what commands take that do little, and what they load, in rounds."""
    nrs = [sys.executable, "-m", "nrs_cosim.orchestrator"]
    commands: dict[str, Sequence[str | Path]] = {
        what: [sys.executable, "-c", code] for what, code in STARTS.items()
    }
    commands |= {"nrs --version": [*nrs, "--version"], "nrs info": [*nrs, "info", recording]}
    commands["nrs check"] = [*nrs, "check", SCENARIO]
    found: defaultdict[str, list[dict[str, float]]] = defaultdict(list)
    for _ in range(rounds):
        for what, command in commands.items():
            found[what].append(spent(command))
    return found


def main() -> None:
    """Print both, and write them as JSON beside."""
    parser = ArgumentParser(description="the whole command beside a script with FMPy")
    parser.add_argument("--rounds", type=int, default=7)
    given = parser.parse_args()
    of = machine()
    print(text(of))
    with TemporaryDirectory(prefix="nrs-") as folder:
        found = measured(Path(folder), given.rounds)
        starts = started(Path(folder) / "run.mcap", given.rounds)
    kinds = {"seconds": "wall", "cpu": "processor"}
    for kind, word in kinds.items():
        times = {what: [row[kind] for row in rows] for what, rows in found.items()}
        medians = ", ".join(f"{what} {statistics.median(of):.2f} s" for what, of in times.items())
        ratio = compared(times[SCRIPT], times[COMMAND])
        print(f"{word:10}{medians}; script / command {ratio['ratio']:.2f}")
    for what, rows in starts.items():
        ours, numpy = ([row["cpu"] for row in of] for of in (rows, starts[NUMPY]))
        ratio = compared(ours, numpy)["ratio"]
        print(f"{what:20}processor {statistics.median(ours):.2f} s, {ratio:.1f} of {NUMPY}")
    keep("command", {"machine": of, "rounds": found, "starts": starts})


if __name__ == "__main__":
    main()
