"""What a study costs beyond its runs, and what it survives.

    python -m benchmarks.studies [overhead] [efficiency] [memory] [kills] [engines] [size]

Times are of processors, so that a busy machine does not decide; efficiency alone is of the wall
clock, and of a machine at rest.
"""

import argparse
import json
import os
import random
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import nrs_cosim as nrs
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.scenario.file import parse_scenario, read_scenario
from nrs_cosim.orchestrator.study.axes import axis_of
from nrs_cosim.orchestrator.study.plan import StudyPlan, task_of
from nrs_cosim.orchestrator.study.point_run import run_point
from nrs_cosim.orchestrator.study.points import PointReader
from nrs_cosim.orchestrator.study.rows import StudyRow
from nrs_cosim.orchestrator.study.store import StudyStore

PAPER = Path(__file__).parents[1] / "scenarios/paper_first_order.toml"
NRS = Path(sys.executable).with_name("nrs")
POINTS = 24
MEMORY = int(os.environ.get("NRS_STUDY_POINTS", "10000"))
KILLS = int(os.environ.get("NRS_STUDY_KILLS", "20"))


def overhead() -> None:
    """Processor time of a point beyond its bare run: planning, theory, measuring, the row."""
    base = read_scenario(PAPER)
    plan = StudyPlan({base.name: base}, [])
    reader = PointReader(plan.scenarios)
    with TemporaryDirectory() as folder, StudyStore(Path(folder)) as store:
        found: dict[str, list[float]] = {"first of its gains": [], "same but for the seed": []}
        whole: list[float] = []
        for number in range(POINTS):
            for kind, seed in (("first of its gains", 1), ("same but for the seed", 2)):
                values = {"algorithm.alpha": 0.5 + number / 50, "run.seed": seed}
                begun = process_time()
                point = reader.at(values)
                task = task_of(point, plan, store)
                row = run_point(task)
                assert isinstance(row, dict)
                store.put(StudyRow.of(row))
                all_of_it = process_time() - begun
                experiment = parse_scenario(task.text, task.name, base.folder, "bare")
                begun = process_time()
                run(experiment, Path(folder) / "bare.mcap")
                bare = process_time() - begun
                found[kind].append(all_of_it - bare)
                whole.append(all_of_it)
    for kind, times in found.items():
        print(f"overhead, {kind:22} {1e3 * median(times):6.1f} ms, least {1e3 * min(times):.1f} ms")
    print(f"a point of 300 ticks            {1e3 * median(whole):6.1f} ms of one processor, "
          f"{1 / median(whole):.2f} points/s")  # fmt: skip


def efficiency() -> None:
    """Points a second of a pool of two beside two loops of bare runs side by side."""
    loop = (
        "import sys; from pathlib import Path; from time import perf_counter;"
        "from nrs_cosim.orchestrator.engine.run import run;"
        "from nrs_cosim.orchestrator.scenario.file import parse_scenario, read_scenario;"
        "e = read_scenario(Path(sys.argv[1])); run(e.but(), Path(sys.argv[2]));"
        "t = perf_counter();"
        "[run(e.but(), Path(sys.argv[2])) for _ in range(40)]; print(perf_counter() - t)"
    )
    with TemporaryDirectory() as folder:

        def bare(number: int) -> float:
            command = [sys.executable, "-c", loop, str(PAPER), f"{folder}/{number}.mcap"]
            return float(subprocess.run(command, capture_output=True, check=True, text=True).stdout)

        with ThreadPoolExecutor(2) as pool:
            each = max(pool.map(bare, range(2)))
        scenario = nrs.Scenario.load(PAPER)
        times: list[float] = []
        nrs.sweep(
            scenario, {}, seeds=84, jobs=2, progress=lambda _now: times.append(perf_counter())
        )
    rate = (len(times) - 1 - 4) / (times[-1] - times[4])
    print(f"efficiency on two processors    {rate / (80 / each):6.2f} of two loops of bare runs")


def memory() -> None:
    """How the memory of a process grows over many points of one tick."""
    base = read_scenario(PAPER)
    plan = StudyPlan({base.name: base}, [])
    reader = PointReader(plan.scenarios)
    sizes: list[tuple[int, float]] = []
    with TemporaryDirectory() as folder, StudyStore(Path(folder)) as store:
        for number in range(MEMORY):
            values = {"run.duration": 0.1, "run.seed": number}
            row = run_point(task_of(reader.at(values), plan, store))
            assert isinstance(row, dict)
            store.put(StudyRow.of(row))
            if number % 100 == 99:
                resident = int(Path("/proc/self/statm").read_text("ascii").split()[1])
                sizes.append((number, resident * resource.getpagesize() / 1024))
    late = [one for one in sizes if one[0] >= MEMORY // 4]
    slope = (late[-1][1] - late[0][1]) / (late[-1][0] - late[0][0])
    print(f"memory                          {slope:6.2f} KiB a point, of the last {len(late)}00 of "
          f"{MEMORY}; {late[-1][1] / 1024:.0f} MiB")  # fmt: skip


OVER = "algorithm.alpha=0.5:1.5:11"


def sweep_command(folder: Path) -> list[str]:
    """Return the command of a study of 22 short runs."""
    return [
        str(NRS), "sweep", str(PAPER), "--set", "run.duration=2", "--over", OVER, "--seeds", "2",
        "-o", str(folder), "--jobs", "2", "--json",
    ]  # fmt: skip


@contextmanager
def dask(folder: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Yield the address and the process of a scheduler with two workers, which end with it."""
    program, run = NRS.with_name("dask"), {"cwd": folder, "start_new_session": True}
    scheduler = subprocess.Popen(
        [program, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"],
        stderr=subprocess.PIPE, text=True, **run,
    )  # fmt: skip
    assert scheduler.stderr
    address = next(line.split()[-1] for line in scheduler.stderr if "Scheduler at:" in line)
    worker = subprocess.Popen(
        [program, "worker", address, "--nworkers", "2", "--nthreads", "1", "--no-dashboard",
         "--death-timeout", "20"], stderr=subprocess.DEVNULL, **run,
    )  # fmt: skip
    try:
        yield address, scheduler
    finally:
        for process in (worker, scheduler):
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def kills() -> None:
    """SIGKILL of a worker, the parent and a scheduler, at seeded times: rows, table, orphans."""
    chance = random.Random(1)
    with TemporaryDirectory() as place:
        whole = Path(place) / "whole"
        subprocess.run(sweep_command(whole), capture_output=True, check=True)
        expected = nrs.Study(whole).digest
        for who in ("worker", "parent", "scheduler"):
            same = orphans = lost = 0
            for number in range(KILLS):
                folder = Path(place) / f"{who}{number}"
                after = chance.randrange(1, 20)
                stack = ExitStack()
                command, scheduler = sweep_command(folder), None
                if who == "scheduler":
                    address, scheduler = stack.enter_context(dask(Path(place)))
                    command = [*command[: command.index("--jobs")], "--dask", address, "--json"]
                process = subprocess.Popen(
                    command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
                )
                assert process.stdout
                rows = []
                for line in process.stdout:
                    rows += [found["row"]] if "row" in (found := json.loads(line)) else []
                    if len(rows) == after:
                        break
                if scheduler:
                    os.killpg(scheduler.pid, signal.SIGKILL)
                else:
                    os.kill(rows[-1]["pid"] if who == "worker" else process.pid, signal.SIGKILL)
                process.communicate()
                stack.close()  # Dask's workers are not the command's
                orphans += sum(not _ends(row["pid"], 5.0) for row in rows)
                kept = {row.key for row in nrs.Study(folder).rows}
                lost += sum(row["key"] not in kept for row in rows)
                subprocess.run(sweep_command(folder), capture_output=True, check=False)
                same += nrs.Study(folder).digest == expected
            print(f"SIGKILL of the {who:16} {same:3} of {KILLS} tables the same, {lost} rows lost, "
                  f"{orphans} orphans after 5 s")  # fmt: skip


def _ends(pid: int, seconds: float) -> bool:
    """Return whether a process ends within so many s."""
    import select  # noqa: PLC0415, of this alone

    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([descriptor], [], [], seconds)[0])
    finally:
        os.close(descriptor)


def engines() -> None:
    """The table of 500 points by this process, by a pool, and by Dask, bit for bit."""
    import distributed  # noqa: PLC0415, an extra

    scenario = nrs.Scenario.load(PAPER).replace({"run.duration": 1.0})
    axes = {"algorithm.alpha": "0.5:1.5:25", "run.sampling_period": [0.02, 0.05, 0.1, 0.2]}
    digests = set()
    with (
        TemporaryDirectory() as place,
        dask(Path(place)) as (address, _),
        distributed.Client(address, set_as_default=False) as client,
    ):
        client.wait_for_workers(2)
        for name, engine in (
            ("this process", {"jobs": 0}),
            ("a pool of two", {"jobs": 2}),
            ("Dask, two workers", {"executor": client.get_executor(pure=False), "jobs": 2}),
        ):
            study = nrs.sweep(scenario, axes, seeds=5, **engine)
            digests.add(study.digest)
            print(f"{len(study)} points, {name:20} table {study.digest[:16]}")
    assert len(digests) == 1


def size() -> None:
    """A study of 100,000 rows is opened, and drawn."""
    rows = 100_000
    with TemporaryDirectory() as place:
        short = nrs.Scenario.load(PAPER).replace({"run.duration": 1.0})
        study = nrs.sweep(
            short, {"algorithm.alpha": [0.9], "algorithm.beta": [1.1]}, out=place, jobs=0
        )
        row = study.rows[0].as_json()
        store = StudyStore(study.folder)
        axes = [
            axis_of("", "algorithm.alpha=0.1:1.3:100"),
            axis_of("", "algorithm.beta=0.1:1.3:100"),
        ]
        store.define(
            StudyPlan({}, axes).definition() | {"scenarios": store.definition()["scenarios"]}
        )
        with store:
            lines = []
            for number in range(rows):
                at = number // 10
                values = {
                    "algorithm.alpha": axes[0].values[at // 100][0],
                    "algorithm.beta": axes[1].values[at % 100][0],
                }
                lines.append(row | {
                    "key": f"{number:064x}", "seed": number % 10, "point": json.dumps(values),
                    "spectral_radius": max(abs(1 - v) for v in values.values()) + 0.7,
                })  # fmt: skip
                if len(lines) == 5000:
                    store.journal.write_text("\n".join(map(json.dumps, lines)) + "\n", "utf-8")
                    store.roll()
                    lines = []
        begun = perf_counter()
        opened = nrs.Study(place)
        count = len(opened)
        print(f"{count} rows                     opened in {perf_counter() - begun:.2f} s")
        begun, spent = perf_counter(), process_time()
        opened.report(Path(place) / "report.html")
        print(f"                                drawn in {perf_counter() - begun:.2f} s, of which "
              f"{process_time() - spent:.2f} s of a processor")  # fmt: skip


PARTS: dict[str, Callable[[], None]] = {
    one.__name__: one for one in (overhead, efficiency, memory, kills, engines, size)
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="what a study costs, and what it survives")
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], default=[])
    for name in parser.parse_args().parts or PARTS:
        PARTS[name]()
