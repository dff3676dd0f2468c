"""Recorded robot-intervals per second beside a bare FMPy loop over the same FMUs, in one run.

A robot-interval is one sample on the bus, one doStep of h, and one recorded state. The bare loop
sets the same references, steps and reads the same outputs through FMPy's own methods, and does
neither exchange nor record. The two take turns, so that a noisy machine is noisy to both.
"""

import platform
import statistics
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from fmpy.fmi3 import FMU3Slave

from benchmarks.table import compared, keep, spread
from orchestrator.runs.running import run
from orchestrator.scenario.file import ScenarioFile, parse_scenario
from plant_fmu.archives.archive import find_archive, unpacked

H = 0.1
ROUNDS = 5
SIZES = {6: 2000, 100: 100, 1000: 20}
"""Robots, and the ticks of one timed run."""

SCENARIO = """
[run]
duration = {duration}
sampling_period = 0.1
seed = 1
{more}
[algorithm]
name = "dcea1"
alpha = 0.9
beta = 1.1
[controller]
kp = 200.0
kd = 300.0
[network]
adjacency = {adjacency}
pinning = {pinning}
[target]
axes = [{{ rate = 2.0, sines = [{{ amplitude = 1.0, frequency = 1.0 }}] }}, {{ rate = -2.0 }}]
[plant]
fmu = "two_link_arm"
[disturbance]
axes = [{{ sines = [{{ amplitude = 2.0, frequency = 1.0 }}] }}, {{}}]
[initial]
position = {{ uniform = [-1.0, 1.0] }}
velocity = {{ uniform = [-1.0, 1.0] }}
q = {{ uniform = [-1.0, 1.0] }}
qd = {{ uniform = [-1.0, 1.0] }}
"""


def scenario(n: int, ticks: int, more: str = "") -> ScenarioFile:
    """Return n arms of which each hears up to three that stand before it, the first the target.

    `more` are further keys of `[run]`.
    """
    rng = np.random.default_rng(n)
    adjacency = np.zeros((n, n), int)
    for i in range(1, n):
        adjacency[i, rng.choice(i, min(i, 3), replace=False)] = 1
    text = SCENARIO.format(
        duration=ticks * H,
        more=more,
        adjacency=adjacency.tolist(),
        pinning=[1] + [0] * (n - 1),
    )
    return parse_scenario(text, f"arms_{n}", Path(), "benchmark")


def recorded(file: ScenarioFile, folder: Path) -> float:
    """Return the seconds that the ticks of a run take, set-up and closing apart."""
    return run(file, folder / "benchmark.mcap").wall_seconds


@contextmanager
def arms(n: int) -> Iterator[list[FMU3Slave]]:
    """Open n arms as a user of FMPy would, with the gains of the scenario."""
    archive = find_archive("two_link_arm", Path())
    by_name = {v.name: v.valueReference for v in archive.description.modelVariables}
    with ExitStack() as stack:
        folder = stack.enter_context(unpacked(archive))
        opened = []
        for i in range(n):
            arm = FMU3Slave(
                guid=archive.description.instantiationToken,
                unzipDirectory=str(folder),
                modelIdentifier=archive.name,
                instanceName=f"arm {i}",
            )
            arm.instantiate()
            arm.setFloat64([by_name["kp"]], [200.0, 0.0, 0.0, 200.0])
            arm.setFloat64([by_name["kd"]], [300.0, 0.0, 0.0, 300.0])
            arm.setFloat64([by_name["disturbance_amplitude"]], [2.0] + [0.0] * 15)
            arm.setFloat64([by_name["disturbance_frequency"]], [1.0] + [0.0] * 15)
            arm.enterInitializationMode()
            arm.exitInitializationMode()
            opened.append(arm)
        yield opened


def bare(n: int, ticks: int) -> float:
    """Return the seconds that FMPy's own methods take for the same steps."""
    archive = find_archive("two_link_arm", Path())
    by_name = {v.name: v.valueReference for v in archive.description.modelVariables}
    reference = [by_name["position_ref"], by_name["velocity_ref"]]
    outputs = [by_name["q"], by_name["qd"], by_name["tau_applied"]]
    rng = np.random.default_rng(1)
    offsets = rng.uniform(-0.3, 0.3, (n, 2)).tolist()
    with arms(n) as opened:
        start = time.perf_counter()
        for k in range(ticks):
            t = k * H
            for arm, (a, b) in zip(opened, offsets, strict=True):
                arm.setFloat64(reference, [2 * t + np.sin(t) + a, -2 * t + b, 2 + np.cos(t), -2.0])
                arm.doStep(t, H)
                arm.getFloat64(outputs, nValues=6)
        return time.perf_counter() - start


def main() -> None:
    """Print the table, and write it as JSON beside."""
    print(f"{platform.platform()}, Python {platform.python_version()}, ", end="")
    print(", ".join(f"{part} {version(part)}" for part in ("fmpy", "eclipse-zenoh", "mcap")))
    print(f"medians of {ROUNDS} interleaved rounds, h = {H} s, zstd; set-up and closing apart")
    print("the ratio is the median of the rounds' own ratios\n")
    print(f"{'robots':>7} {'recorded/s':>11} {'bare FMPy/s':>12} {'ratio':>6}   min .. max")
    rows = []
    with TemporaryDirectory(prefix="nrs-") as folder:
        for n, ticks in SIZES.items():
            file = scenario(n, ticks)
            ours, theirs = [], []
            for _ in range(ROUNDS):
                ours.append(n * ticks / recorded(file, Path(folder)))
                theirs.append(n * ticks / bare(n, ticks))
            row = {
                "robots": n,
                "recorded_per_s": statistics.median(ours),
                "bare_fmpy_per_s": statistics.median(theirs),
                **compared(ours, theirs),
            }
            rows.append(row)
            print(
                f"{n:>7} {row['recorded_per_s']:>11,.0f} {row['bare_fmpy_per_s']:>12,.0f} "
                f"{spread(row)}"
            )
    keep("throughput", rows)


if __name__ == "__main__":
    main()
