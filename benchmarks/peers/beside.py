"""Other co-simulation engines, on the same FMU and for as many steps, beside a recorded run.

    driven    position_ref of every arm is a constant, set once, and a disturbance keeps it in
              motion; a run does the same whose target stands and whose agents begin there, and
              records everything
    chain     position_ref of each arm is q of the one before, for a few steps: what is told is in
              which of the ways of `benchmarks.peers.work` the engine hands values over

Each engine hands q and q̇ of every arm to Python after every step; it has no bus, and keeps nothing
on the disk. Its end must be ours to 1e-9 where arms are driven, in a chain that of a plain loop.
What cannot be installed, crashes, or comes out otherwise is told by name. All take turns; ratios
are medians of the rounds' own.
"""

import json
import signal
import statistics
import subprocess
from argparse import ArgumentParser
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.measured import apart, recorded_file
from benchmarks.peers.fmpy_loop import run as looped
from benchmarks.peers.work import AMPLITUDE, FREQUENCIES, KD, KP, REFERENCE, Work, start
from benchmarks.table import compared, keep, machine, text
from benchmarks.throughput import TICKS
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import parse_scenario
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.recordings.recording import Recording

PEERS: Mapping[str, Sequence[str]] = {
    "fmpy_loop": ["fmpy"],
    "ecos": ["ecospy", "tbb"],
    "libcosim": ["libcosimpy"],
    "cofmu": ["cofmupy"],
    "mosaik_world": ["mosaik"],
    "helics_federates": ["helics"],
}
"""Modules beside this one, and what they need."""
CHAIN = (6, 20)
"""Robots and ticks."""
WAYS = ("Jacobi", "Jacobi, first late", "Gauss-Seidel")
NEAR = 1e-9
PINS = Path(__file__).with_name("requirements.txt")
ROOT = Path(__file__).parents[2]
OURS = "nrs, recorded"
_PATIENCE = 300.0
"""s: for one engine, once."""

SCENARIO = """
[run]
duration = {duration}
sampling_period = 0.1
seed = 1
[algorithm]
name = "dcea1"
alpha = 0.9
beta = 0.9
[controller]
kp = {kp}
kd = {kd}
[network]
generator = {{ kind = "random_k_in", n = {n}, k = 3, pinned = [1] }}
[target]
axes = [{{ offset = {reference[0]} }}, {{ offset = {reference[1]} }}]
[plant]
fmu = "{fmu}"
[disturbance]
axes = [
  {{ sines = [{{ amplitude = {amplitude}, frequency = {frequencies[0]} }}] }},
  {{ sines = [{{ amplitude = {amplitude}, frequency = {frequencies[1]} }}] }},
]
[initial]
position = {position}
velocity = {zero}
q = {q}
qd = {zero}
"""

Found = dict[str, Any]


def standing(work: Work) -> Experiment:
    """Return the scenario of driven arms: the target stands, and all agents know it."""
    n = work.n
    text = SCENARIO.format(
        duration=work.ticks / 10,
        kp=KP,
        kd=KD,
        n=n,
        reference=REFERENCE,
        amplitude=AMPLITUDE,
        frequencies=FREQUENCIES,
        fmu=work.fmu,
        position=[list(REFERENCE)] * n,
        zero=[[0.0, 0.0]] * n,
        q=[list(start(arm)) for arm in range(n)],
    )
    return parse_scenario(text, "standing", Path("/"), "benchmark")


def ours(work: Work, path: Path) -> Found:
    """Run driven arms into a recording; return seconds and the states at the end."""
    found = recorded_file(lambda: standing(work), work.ticks, 1, path)
    with Recording(path) as recording:
        last = recording.states(start=(work.ticks - 0.5) / 10)
    return {
        "seconds": found["seconds"],
        "end": np.hstack([last["position"], last["velocity"]]).tolist(),
    }


def installed(python: str) -> dict[str, str]:
    """Install what the engines need, each by itself; return why one could not be."""
    lacking = {}
    for name, packages in PEERS.items():
        command = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        done = _done([*command, "--constraint", str(PINS), *packages])
        if done.returncode:
            lacking[name] = f"cannot be installed: {_reason(done)}"
    return lacking


def measured(python: str, name: str, file: Path) -> Found:
    """Run an engine on a work; return seconds and the states at the end, or why there are none."""
    try:
        done = _done([python, "-m", f"benchmarks.peers.{name}", str(file)])
    except subprocess.TimeoutExpired:
        return {"failed": f"not done after {_PATIENCE:g} s"}
    if done.returncode:
        return {"failed": _reason(done)}
    found: Found = json.loads(done.stdout.splitlines()[-1])
    return found


def _done(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, cwd=ROOT, check=False, capture_output=True, text=True, timeout=_PATIENCE
    )


def _reason(done: subprocess.CompletedProcess[str]) -> str:
    if done.returncode < 0:
        return f"ended by {signal.Signals(-done.returncode).name}"
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return lines[-1] if lines else f"exited with status {done.returncode}"


def distance(a: Sequence[Sequence[float]], b: Sequence[Sequence[float]]) -> float:
    """Return the largest difference of two states."""
    return float(np.abs(np.subtract(a, b)).max())


def judged(work: Work, end: Any, oracles: Mapping[str, Any]) -> tuple[str, float]:
    """Return which of the ends another one is, and how far off it is."""
    off = {way: distance(end, states) for way, states in oracles.items()}
    nearest = min(off, key=lambda way: off[way])
    if off[nearest] > NEAR:
        return f"none of the known ways, off by {off[nearest]:.1e} at least", off[nearest]
    return (nearest if work.chain else "the same end"), off[nearest]


def rounds_of(work: Work, python: str, names: Sequence[str], rounds: int, folder: Path) -> Found:
    """Return what was measured of all on a work, in turns."""
    file = folder / "work.json"
    file.write_text(json.dumps(asdict(work)), "utf-8")
    found: defaultdict[str, list[Found]] = defaultdict(list)
    for _ in range(rounds):
        if not work.chain:
            found[OURS].append(apart(ours, work, folder / "ours.mcap"))
        for name in names:
            if not any("failed" in one for one in found[name]):
                found[name].append(measured(python, name, file))
    return dict(found)


def row(name: str, work: Work, found: Found, oracles: Mapping[str, Any]) -> Found:
    """Return one line of the table."""
    base = {"what": name, "robots": work.n, "ticks": work.ticks, "chain": work.chain}
    if failed := [one["failed"] for one in found[name] if "failed" in one]:
        return {**base, "failed": failed[0]}
    seconds = [one["seconds"] for one in found[name]]
    how, off = judged(work, found[name][-1]["end"], oracles)
    beside = [one["seconds"] for one in found.get(OURS, [])]
    return {
        **base,
        "per_s": work.n * work.ticks / statistics.median(seconds),
        "ours_over_it": compared(seconds, beside) if beside else None,
        "end": how,
        "off": off,
    }


def line(row: Found) -> str:
    """Return a row as it is printed."""
    head = f"{row['robots']:>7} {'chain' if row['chain'] else 'driven':>7}  {row['what']:<17}"
    if "failed" in row:
        return f"{head}  {row['failed']}"
    ratio = row["ours_over_it"]
    beside = ratio and f"{ratio['ratio']:.2f}  {ratio['ratio_min']:.2f}..{ratio['ratio_max']:.2f}"
    rate = "" if row["chain"] else format(row["per_s"], ",.0f")  # a chain is too short to be timed
    return f"{head}{rate:>10}  {beside or '':<22}{row['end']} ({row['off']:.0e})"


def main() -> None:
    """Install, measure, print the table, and write it as JSON beside."""
    parser = ArgumentParser(description="other engines beside a recorded run")
    parser.add_argument("python", help="of the engines' own environment")
    parser.add_argument("--robots", type=int, nargs="+", default=[6, 100])
    parser.add_argument("--rounds", type=int, default=7)
    given = parser.parse_args()
    python, of = str(Path(given.python).absolute()), machine()
    print(text(of))
    lacking = installed(python)
    for name, why in lacking.items():
        print(f"{name} {why}")
    names = [name for name in PEERS if name not in lacking]
    print(f"medians of {given.rounds} interleaved rounds; steps of 0.1 s\n")
    print(f"{'robots':>7} {'':>7}  {'':17}{'per s':>10}  {'ours / it':<22}its end (off by)")
    rows, fmu = [], str(build("two_link_arm", 2))
    with TemporaryDirectory(prefix="nrs-") as folder:
        for n in given.robots:
            work = Work(fmu, n, TICKS.get(n, 500), chain=False)
            found = rounds_of(work, python, names, given.rounds, Path(folder))
            rows += [row(name, work, found, {OURS: found[OURS][0]["end"]}) for name in found]
        work = Work(fmu, *CHAIN, chain=True)
        found = rounds_of(work, python, names, 1, Path(folder))
        oracles = {way: looped(work, way)[1] for way in WAYS}
        rows += [row(name, work, found, oracles) for name in found]
    print("\n".join(map(line, rows)))
    keep("peers", {"machine": of, "rounds": given.rounds, "lacking": lacking, "rows": rows})


if __name__ == "__main__":
    main()
