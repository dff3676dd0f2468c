"""A long run over two workers that are killed and stopped on the way: is every message there, once?

What is expected follows from the scenario alone. The recording is read with all checksums and its
digest verified, and counted by kind; its digest must be that of the same run in one process. The
workers are processes that the run starts, at a Unix socket, and then `nrs worker` over loopback
TCP, where one that was stopped has lost its link. Each run has a process of its own, so that its
peak memory is its own. `make soak` prints the table and writes it to docs/soak.md.
"""

import argparse
import multiprocessing
import os
import platform
import socket
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from operator import itemgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.memory import peak
from benchmarks.mischief import Mischief, blows
from benchmarks.table import keep
from benchmarks.work import scenario
from nrs_cosim.bus.keys import kind_of
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.transport import Bus
from nrs_cosim.orchestrator.cluster.coordinator import Coordinator
from nrs_cosim.orchestrator.cluster.launcher import local_workers, remote_workers
from nrs_cosim.orchestrator.cluster.supervision import WorkerPolicy
from nrs_cosim.orchestrator.engine.in_process import in_process
from nrs_cosim.orchestrator.engine.lockstep import Launcher, Workers
from nrs_cosim.orchestrator.engine.run import Outcome, run
from nrs_cosim.orchestrator.engine.worker import Watch
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.mcap.reader import Reader

PAGE = Path(__file__).parents[1] / "docs" / "soak.md"
KILLS, STOP, SEED = 4, 15.0, 1
POLICY = WorkerPolicy(restart=True, wait=120.0, show=lambda text: print(f"    {text}", flush=True))
MB = 1e6

Row = dict[str, Any]

TEXT = """# A soak

A long run whose workers are killed and stopped on purpose must end with every message, and with
the digest of a run of one process that nothing happened to. `make soak` ran {robots:,} two-link
arms for {ticks:,} ticks three times: in one process, over two worker processes at a Unix socket,
and over two `nrs worker` processes on loopback TCP. In the latter two, workers were killed
{kills} times by SIGKILL, and one was stopped for {stop:g} s, at ticks drawn from a seed. It was
on {machine}.

- *asked to catch up*: a worker that was killed or lost its link goes back to the last checkpoint
  and asks for the samples since then, up to 64 ticks of them at a time.
- *asked late*: a worker asked for samples that had not come for 1 s.
- *batches repeated*: a batch is what a worker says of one tick. One that came back says some
  again; they are recorded once.
- *seconds* are wall time, with the stop in them.

{table}
"""


def expected_messages(file: Experiment) -> dict[str, int]:
    """Return how many messages of each kind a whole recording has."""
    clock, n = file.clock, file.n
    states = len(clock.outputs(0)) + clock.ticks * len(clock.outputs(1))
    checkpoints = clock.ticks // file.scenario.run.checkpoint_every
    return {"sample": (n + 1) * clock.ticks, "state": n * states, "checkpoint": n * checkpoints}


def counted(path: Path) -> tuple[dict[str, int], str, list[str]]:
    """Return how many messages of each kind a recording has, its digest, and what is damaged."""
    with Reader(path, verify=True) as reader:
        topics: Counter[str] = Counter()
        for batch in reader.batches():
            topics.update(map(itemgetter(1), batch))
        kinds: Counter[str] = Counter()
        for topic, count in topics.items():
            kinds[kind_of(topic)] += count
        return dict(kinds), reader.digest, reader.damage


def in_one_process(file: Experiment, path: Path) -> Row:
    """Run in this process alone."""
    return _row("one process", run(file, path, in_process(file)), {})


def at_a_socket(file: Experiment, path: Path) -> Row:
    """Run over two processes that the run starts, and starts again."""
    return _spread("Unix socket", file, path, local_workers(file, 2, POLICY), lambda _name: None)


def over_tcp(file: Experiment, path: Path) -> Row:
    """Run over two `nrs worker`, of which each that is killed is started again here."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
    n = file.n
    assignment = {"local-1": range(1, n // 2 + 1), "local-2": range(n // 2 + 1, n + 1)}
    started: list[subprocess.Popen[bytes]] = []

    def start(name: str) -> None:
        robots = f"{assignment[name][0]}-{assignment[name][-1]}"
        command = [
            sys.executable,
            "-m",
            "orchestrator",
            "worker",
            "--connect",
            endpoint,
            "--insecure-tcp",
        ]
        command += ["--name", name, "--robots", robots]
        started.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))

    for name in assignment:
        start(name)
    try:
        launch = remote_workers(
            file, Endpoints(listen=(endpoint,), insecure_tcp=True), assignment, POLICY
        )
        row = _spread("loopback TCP", file, path, launch, start)
        for process in started:
            process.wait(10.0)
    finally:
        for process in started:
            process.kill()
            process.wait()
    return row


def _spread(
    name: str,
    file: Experiment,
    path: Path,
    launch: Launcher,
    again: Callable[[str], None],
) -> Row:
    clock = file.clock
    dealt = blows(clock.ticks, ("local-1", "local-2"), KILLS, STOP, SEED)
    mischief = Mischief(dealt, clock.t, again)
    coordinators: list[Workers] = []

    def launched(stack: ExitStack, watch: Watch) -> tuple[Bus, Workers]:
        bus, coordinator = launch(stack, watch)
        coordinators.append(coordinator)
        return bus, coordinator

    outcome = run(file, path, launched, watch=mischief.watch)
    (coordinator,) = coordinators
    assert isinstance(coordinator, Coordinator)
    about = {
        "killed": mischief.done["killed"],
        "stopped": mischief.done["stopped"],
        "workers restarted": coordinator.restarts,
        "asked to catch up": coordinator.asked["to catch up"],
        "asked late": coordinator.asked["late"],
        "batches repeated": outcome.repeated,
        **{f"peak MB, {worker}": round(p / MB) for worker, p in sorted(mischief.peaks.items())},
    }
    return _row(name, outcome, about)


def _row(name: str, outcome: Outcome, about: Row) -> Row:
    status = outcome.status + (f": {outcome.reason}" if outcome.reason else "")
    return {
        "run": name,
        "status": status,
        "seconds": round(outcome.wall_seconds, 1),
        "batches rejected": sum(outcome.rejected.values()),
        "peak MB, orchestrator": round(peak(os.getpid()) / MB),
        **about,
    }


def soak(robots: int, ticks: int, folder: Path) -> list[Row]:
    """Return what is to be told of each run."""
    file = scenario(robots, ticks)
    expected = expected_messages(file)
    rows: list[Row] = []
    for perform in (in_one_process, at_a_socket, over_tcp):
        path = folder / "soak.mcap"
        print(perform.__name__, flush=True)
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, mp_context=spawn) as apart:
            row = apart.submit(perform, file, path).result()
        has, digest, damage = counted(path)
        row |= {f"{kind}s expected": count for kind, count in expected.items()}
        row |= {f"{kind}s recorded": has.get(kind, 0) for kind in expected}
        row |= {"digest": digest, "damage": "; ".join(damage) or "none"}
        rows.append(row)
        print(f"    {row}", flush=True)
    return rows


def passed(row: Row, digest: str) -> bool:
    """Return whether a run lost, added and changed nothing."""
    whole = all(
        row[f"{kind}s expected"] == row[f"{kind}s recorded"]
        for kind in ("sample", "state", "checkpoint")
    )
    clean = row["status"] == "completed" and row["damage"] == "none" and not row["batches rejected"]
    return whole and clean and row["digest"] == digest


def table(rows: Sequence[Row]) -> str:
    """Return the rows as a Markdown table that has a run a column."""
    titles = dict.fromkeys(title for row in reversed(rows) for title in row)
    first = ["run", *(title for title in titles if title.endswith(("expected", "recorded")))]
    lines = []
    for title in [*first, *(title for title in titles if title not in first)]:
        values = [row.get(title, "–") for row in rows]
        cells = [f"{cell:,}" if isinstance(cell, int) else str(cell)[:16] for cell in values]
        lines.append(f"| {'' if title == 'run' else title} | " + " | ".join(cells) + " |")
    return "\n".join([lines[0], "|---|" + "---:|" * len(rows), *lines[1:]])


def main() -> None:
    """Soak, print the table, write it; exit with 1 when anything was lost."""
    options = argparse.ArgumentParser(description="a long run over workers that come and go")
    options.add_argument("--robots", type=int, default=1000)
    options.add_argument("--ticks", type=int, default=5000)
    options.add_argument("--page", type=Path, default=PAGE)
    asked = options.parse_args()
    with TemporaryDirectory(prefix="nrs-soak-") as folder:
        rows = soak(asked.robots, asked.ticks, Path(folder))
    keep("soak", rows)
    asked.page.write_text(page(asked.robots, asked.ticks, rows), "utf-8")
    print(table(rows))
    sys.exit(not all(passed(row, rows[0]["digest"]) for row in rows))


def page(robots: int, ticks: int, rows: Sequence[Row]) -> str:
    """Return what docs/soak.md says."""
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    machine += f", Python {platform.python_version()}"
    about = {"robots": robots, "ticks": ticks, "kills": KILLS, "stop": STOP}
    return TEXT.format(**about, machine=machine, table=table(rows))


if __name__ == "__main__":
    main()
