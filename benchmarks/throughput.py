"""The one table: recorded robot-intervals per second, beside what does less, in one run.

A robot-interval is one sample on the bus, one doStep of h, and one recorded state. Beside runs on
one worker, whose FMUs one thread or two step, and on two workers stand bare loops over the same
FMUs with the same references, which neither exchange nor record: one by FMPy's own methods, one by
calls that are bound beforehand. They end in the very states that were recorded, or this fails. Two
of the latter side by side, in processes that share nothing, are what a second processor gives on
this machine: the gain of two threads is told beside theirs. By themselves stand the bus, a put and
its receipt for each sample, and the writer, a message at a time.

All take turns, so that a noisy machine is noisy to all; each is measured in a process of its own.
Rates are medians, ratios are medians of the rounds' own.
"""

import os
import statistics
import sys
from argparse import ArgumentParser
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.bare import fmpys, prebound
from benchmarks.measured import Found, apart, recorded, written, zenoh_put_and_received
from benchmarks.memory import peak
from benchmarks.table import compared, keep, machine, text
from benchmarks.work import H, Motion, keep_motion, scenario
from nrs_cosim.orchestrator.engine.in_process import threads_worth_it

TICKS = {6: 3_000, 100: 500, 1_000: 200, 10_000: 30}
"""Robots, and the ticks of a timed run unless they are given: a fifth of a second at least, so that
what a file's end takes is no large part of it."""
OURS, OURS_2, FMPY, PREBOUND = "1 worker", "2 workers", "FMPy loop", "pre-bound loop"
THREADS = "1, 2 threads"
"""One worker whose FMUs two threads step."""
TWO_PREBOUND = "2 such loops"
"""Two pre-bound loops side by side, each over as many robots."""
ZENOH, WRITER = "Zenoh, put and received", "writer, messages"
MOST_LOAD = 0.5
"""Of the last minute, with which two processors are free."""
PUTS, TICKS_WRITTEN = 200_000, 50


def bare(kept: Path, by_fmpy: bool) -> Found:
    """Step the arms of a recording without a bus; see `benchmarks.bare`."""
    return (fmpys if by_fmpy else prebound)(Motion(kept))


def two_bare(kept: Path) -> Found:
    """Step the arms of a recording twice, side by side; return what one of both took."""
    context = get_context("spawn")
    with context.Manager() as manager, ProcessPoolExecutor(2, mp_context=context) as pool:
        meet = manager.Barrier(2).wait
        both = [*pool.map(_prebound_after, [kept] * 2, [meet] * 2)]
    return {
        "seconds": max(found["seconds"] for found in both) / 2,
        "cpu": sum(found["cpu"] for found in both) / 2,
        "peak": sum(found["peak"] for found in both),
    }


def _prebound_after(kept: Path, meet: Callable[[], object]) -> Found:
    return {**prebound(Motion(kept), meet), "peak": peak()}


@dataclass(frozen=True, slots=True)
class Case:
    """So many robots for so many ticks."""

    n: int
    ticks: int

    @property
    def intervals(self) -> int:
        """Robot-intervals."""
        return self.n * self.ticks

    def prepare(self, folder: Path) -> None:
        """Keep what bare loops are to follow."""
        file = scenario(self.n, self.ticks)
        recorded(self.n, self.ticks, 1, folder / "first.mcap")
        keep_motion(file, folder / "first.mcap", folder / f"{self.n}.npz")

    def round(self, folder: Path) -> dict[str, Found]:
        """Measure all once."""
        path, kept = folder / "run.mcap", folder / f"{self.n}.npz"
        found = {
            OURS: apart(recorded, self.n, self.ticks, 1, path),
            **self._by_threads(path, kept),
            OURS_2: apart(recorded, self.n, self.ticks, 2, path),
            FMPY: apart(bare, kept, True),
            PREBOUND: apart(bare, kept, False),
        }
        assert len({row["digest"] for row in found.values() if "digest" in row}) == 1
        return found

    def _by_threads(self, path: Path, kept: Path) -> dict[str, Found]:
        if threads_worth_it(self.n) == 1:
            return {}
        by_threads = apart(recorded, self.n, self.ticks, 1, path, 2)
        return {THREADS: by_threads, TWO_PREBOUND: two_bare(kept)}


def row(what: str, case: Case, rounds: Sequence[Mapping[str, Found]]) -> dict[str, Any]:
    """Return one line of the table: what was measured, over all rounds."""
    mine = [found[what] for found in rounds]
    seconds = [found["seconds"] for found in mine]
    rates = sorted(case.intervals / s for s in seconds)
    middle = {name: statistics.median(found[name] for found in mine) for name in mine[0]}
    per_interval = {
        name: middle[name] / case.intervals for name in ("cpu", "bytes") if name in middle
    }
    return {
        "what": what,
        "robots": case.n,
        "ticks": case.ticks,
        "per_s": statistics.median(rates),
        "per_s_min": rates[0],
        "per_s_max": rates[-1],
        "cpu_us": per_interval["cpu"] * 1e6 if "cpu" in per_interval else None,
        "setup_s": middle.get("setup"),
        "setup_cpu_s": middle.get("setup_cpu"),
        "peak_mb": middle["peak"] / 1e6,
        "bytes": per_interval.get("bytes"),
        "instance_bytes": middle.get("instance_bytes"),
        "ours_over_it": compared(seconds, [found[OURS]["seconds"] for found in rounds]),
    }


def line(row: Mapping[str, Any]) -> str:
    """Return a row as it is printed."""
    spread = f"{row['per_s_min']:,.0f}..{row['per_s_max']:,.0f}"
    ratio = row["ours_over_it"]
    beside = f"{ratio['ratio']:.2f}  {ratio['ratio_min']:.2f}..{ratio['ratio_max']:.2f}"
    cells = [
        f"{row['robots']:>7,} {row['ticks']:>6}  {row['what']:<15}",
        f"{row['per_s']:>9,.0f}{spread:>18}",
        number(row["cpu_us"], 7, 2),
        number(row["setup_s"], 9, 2),
        number(row["peak_mb"], 8, 0),
        number(row["bytes"], 6, 0),
        "" if row["what"] == OURS else f"  {beside}",
    ]
    return "".join(cells).rstrip()


def number(value: float | None, width: int, digits: int) -> str:
    """Return a number as a cell, which is empty where there is none."""
    return f"{'' if value is None else format(value, f',.{digits}f'):>{width}}"


def by_themselves(rounds: int, folder: Path) -> list[dict[str, Any]]:
    """Return the rates of the bus and of the writer by themselves."""
    rates: defaultdict[str, list[float]] = defaultdict(list)
    for _ in range(rounds):
        rates[ZENOH].append(PUTS / apart(zenoh_put_and_received, PUTS)["seconds"])
        found = apart(written, 1000, TICKS_WRITTEN, folder / "written.mcap")
        rates[WRITER].append(found["messages"] / found["seconds"])
    return [
        {
            "what": what,
            "per_s": statistics.median(found),
            "per_s_min": min(found),
            "per_s_max": max(found),
        }
        for what, found in rates.items()
    ]


def scale(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return what the most robots cost beside the fewest, and what each of them takes."""
    ours = [row for row in rows if row["what"] == OURS]
    few, many = ours[0], ours[-1]
    fmu = next(r for r in rows if (r["what"], r["robots"]) == (PREBOUND, many["robots"]))
    memory = (many["peak_mb"] - few["peak_mb"]) * 1e6 / (many["robots"] - few["robots"])
    hundred = next((row for row in ours if row["robots"] == 100), few)
    return {
        "robots": many["robots"],
        "beside": hundred["robots"],
        "time": hundred["per_s"] / many["per_s"],
        "processor": many["cpu_us"] / hundred["cpu_us"],
        "setup_ms": many["setup_s"] / many["robots"] * 1e3,
        "setup_cpu_ms": many["setup_cpu_s"] / many["robots"] * 1e3,
        "kb": (memory - fmu["instance_bytes"]) / 1e3,
        "fmu_kb": fmu["instance_bytes"] / 1e3,
    }


def gain_of_threads(rounds: Sequence[Mapping[str, Found]]) -> dict[str, float] | None:
    """Return how many times a pre-bound loop's rate one run with two threads has, and two loops."""
    if THREADS not in rounds[0]:
        return None
    one, threads, loops = (
        [found[what]["seconds"] for found in rounds] for what in (PREBOUND, THREADS, TWO_PREBOUND)
    )
    ours, theirs = compared(one, threads), compared(one, loops)
    return {"two_threads": ours["ratio"], "two_loops": theirs["ratio"]}


def told_of(scale: Mapping[str, float]) -> str:
    """Return the scale in words."""
    return (
        f"{scale['robots']:,} robots: a robot-interval takes {scale['time']:.2f} times as long as "
        f"with {scale['beside']:,}, and {scale['processor']:.2f} times as much of the processor;\n"
        f"set-up {scale['setup_ms']:.2f} ms a robot, {scale['setup_cpu_ms']:.2f} of the processor; "
        f"memory {scale['kb']:.1f} KB a robot beyond the {scale['fmu_kb']:.1f} KB of its FMU"
    )


def main() -> None:
    """Print the table, and write it as JSON beside."""
    parser = ArgumentParser(description="recorded robot-intervals per second, beside bare loops")
    parser.add_argument("--robots", type=int, nargs="+", default=list(TICKS))
    parser.add_argument("--ticks", type=int, help="of every timed run; 500 take about an hour")
    parser.add_argument("--rounds", type=int, default=7)
    given = parser.parse_args()
    cases = [Case(n, given.ticks or TICKS.get(n, 100)) for n in given.robots]
    of = machine()
    print(text(of))
    if (load := os.getloadavg()[0]) > MOST_LOAD:
        print(f"load {load:.1f}: figures of two threads or workers are of a machine in use")
    print(f"medians of {given.rounds} interleaved rounds, least..most; h = {H} s, zstd\n")
    print(
        f"{'robots':>7} {'ticks':>6}  {'':15}{'per s':>9}{'least..most':>18}{'cpu us':>7}"
        f"{'set-up s':>9}{'peak MB':>8}{'bytes':>6}  1 worker / it"
    )
    found: defaultdict[Case, list[dict[str, Found]]] = defaultdict(list)
    with TemporaryDirectory(prefix="nrs-") as name:
        folder = Path(name)
        for case in cases:
            case.prepare(folder)
        for i in range(given.rounds):
            print(f"round {i + 1} of {given.rounds}", file=sys.stderr)
            for case in cases:
                found[case].append(case.round(folder))
        rows = [row(what, case, found[case]) for case in cases for what in found[case][0]]
        print("\n".join(map(line, rows)))
        threads = {case.n: gain for case in cases if (gain := gain_of_threads(found[case]))}
        for n, gain in threads.items():
            print(
                f"\n{n:,} robots, beside one pre-bound loop: a run with two threads "
                f"{gain['two_threads']:.2f}, two such loops side by side {gain['two_loops']:.2f}",
                end="",
            )
        print()
        alone = by_themselves(given.rounds, folder)
    print()
    for part in alone:
        print(
            f"{part['what']:<31}{part['per_s']:>9,.0f}"
            f"{part['per_s_min']:>12,.0f}..{part['per_s_max']:,.0f}"
        )
    of_scale = scale(rows) if len(cases) > 1 else {}
    if of_scale:
        print(f"\n{told_of(of_scale)}")
    keep(
        "throughput",
        {
            "machine": of,
            "rounds": given.rounds,
            "rows": rows,
            "parts": alone,
            "threads": threads,
            "scale": of_scale,
        },
    )


if __name__ == "__main__":
    main()
