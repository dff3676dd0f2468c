"""A run, with everything that a person sees of it: who takes part, how far it is, how it ended."""

import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.text import quoted, storable
from nrs_cosim.orchestrator.analysis.results import Result, theory_beside
from nrs_cosim.orchestrator.cli import progress, summary_text
from nrs_cosim.orchestrator.cli.comparison_text import theory_comparison
from nrs_cosim.orchestrator.cli.output_paths import expect_unlocked, place_for
from nrs_cosim.orchestrator.cli.tables import grid
from nrs_cosim.orchestrator.cluster.launcher import local_workers, remote_workers, workers_worth_it
from nrs_cosim.orchestrator.cluster.supervision import WorkerPolicy
from nrs_cosim.orchestrator.engine.attachments import with_allowed_fmus
from nrs_cosim.orchestrator.engine.in_process import in_process, threads_worth_it
from nrs_cosim.orchestrator.engine.interrupts import interrupts
from nrs_cosim.orchestrator.engine.lockstep import Launcher
from nrs_cosim.orchestrator.engine.pace import NO_PACE, Pace, RealTime
from nrs_cosim.orchestrator.engine.plants import (
    find_recorded,
    group_by_archive,
    with_compiled_fmus,
)
from nrs_cosim.orchestrator.engine.run import Outcome
from nrs_cosim.orchestrator.engine.run import run as run_scenario
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.engine.units import other_rates
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.orchestrator.exit_status import DONE, FAILED, INTERRUPTED
from nrs_cosim.orchestrator.replay.verify import expect_same_types
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import changed
from nrs_cosim.orchestrator.scenario.robot_ids import parse_robots
from nrs_cosim.orchestrator.terminal import err, out, print_json, say
from nrs_cosim.recordings.mcap.container import Compression, Message
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.schemas import about

if TYPE_CHECKING:
    from nrs_cosim.orchestrator.scenario.changes import Change  # it loads tomlkit

KEPT = 0.95
"""Of the pace that was asked for: what is slower did not keep it."""
EXIT = {"completed": DONE, "failed": FAILED, "interrupted": INTERRUPTED}


def policy_of(no_restart: bool, wait: float, expect: int, deadline: float | None) -> WorkerPolicy:
    """Return what is done about workers; `InputError` for a time that is none."""
    for option, seconds_given in (("--wait", wait), ("--deadline", deadline)):
        if seconds_given is not None and not seconds_given > 0:
            raise InputError(f"{option}: expected more than 0 s, got {seconds_given:g}")
    return WorkerPolicy(not no_restart, wait, show, expect)


def launcher_of(
    experiment: Experiment,
    workers: str | None,
    threads: int | None,
    policy: WorkerPolicy,
    listen: list[str] | None,
    connect: list[str] | None,
    ends: Callable[..., Endpoints],
) -> Launcher:
    """Return how a run gets the workers that were asked for."""
    n = experiment.n
    if threads is not None and (listen or connect):
        raise InputError(
            f"--threads {threads}: is of workers on this machine; give it to each `nrs worker`"
        )
    if not 1 <= policy.expected <= n:
        raise InputError(f"--expect: expected 1 to {n} workers, got {policy.expected}")
    if listen or connect:
        if workers is not None:
            option = "--listen" if listen else "--connect"
            raise InputError(f"--workers {workers}: starts workers here, {option} waits for others")
        tls = experiment.scenario.bus.tls
        places = {
            name: parse_robots(robots, f"bus.tls.workers.{name}", n)
            for name, robots in (tls.workers if tls else {}).items()
        }
        endpoints = ends(listen=tuple(listen or ()), connect=tuple(connect or ()), workers=places)
        return remote_workers(experiment, endpoints, places, policy)
    if workers == "auto":
        count = workers_worth_it(n)
    elif workers is None or (workers.isascii() and workers.isdecimal() and 1 <= int(workers) <= n):
        count = int(workers or 1)
    else:
        raise InputError(
            f"--workers: expected auto or 1 to {n}, a robot each at least, got {quoted(workers)}"
        )
    if count == 1:
        return in_process(experiment, threads or threads_worth_it(n))
    return local_workers(experiment, count, policy, threads or threads_worth_it(n, count))


def perform(
    experiment: Experiment,
    output: Path | None,
    launch: Launcher | None,
    compression: Compression = "zstd",
    profile: bool = False,
    deadline: float | None = None,
    past: Iterator[list[Message]] | None = None,
    metadata: Mapping[str, Mapping[str, str]] | None = None,
    pace: Pace = NO_PACE,
    begin: Callable[[Path, Path], None] | None = None,
    force: bool = False,
    as_json: bool = False,
) -> None:
    """Run with everything that a person sees of it, or with the result as JSON alone, and exit."""
    clock = experiment.clock
    with (
        place_for(output, experiment.name, force=force) as place,
        interrupts(_ending()) as stopped,
        progress.running(err, clock) as reached,
    ):

        def watch(time_ns: int) -> None:
            reached(seconds(time_ns))
            if stopped():
                raise Interrupted

        whole = place.written.absolute()  # an FMU may change the working directory
        if begin:
            begin(whole, place.final.absolute())
        outcome = run_scenario(
            experiment,
            whole,
            launch,
            compression=compression,
            watch=watch,
            deadline=deadline,
            past=past,
            metadata=metadata,
            pace=pace,
            more=lambda path: theory_beside(path, experiment),
        )
        path = place.settle(outcome.status == "completed")
    whole = path.absolute()
    with progress.reading(err) as follow, Reader(whole, watch=follow(path)) as reader:
        result = Result.of(reader, experiment)
        drives = [(plant["fmu"], plant["drive"]) for plant in about(reader).plants]
    for warning in other_rates(drives):
        say("yellow", "warning", warning)
    if as_json:
        print_json({**result.as_json(), "file": storable(str(path))})
    else:
        _show(result, outcome, path, clock, pace)
        if profile:
            summary_text.profile(out, outcome.profile, outcome.wall_seconds)
            if outcome.restarts:
                say("yellow", "profile", "what a worker did before it was gone is under other")
    if outcome.status == "failed":
        say("red", "failed", outcome.reason)
    raise typer.Exit(EXIT[outcome.status])


def _show(result: Result, outcome: Outcome, path: Path, clock: Clock, pace: Pace) -> None:
    """Show how a run was, whose recording is at a path."""
    rows = {**result.lines(), "recording": str(path)}
    simulated = seconds(clock.t(outcome.ticks) - clock.t(outcome.copied))
    took = outcome.wall_seconds
    rows["ticks"] += f" in {took:.2f} s, {simulated / took:.3g} x real time"
    if pace.asked and simulated < KEPT * pace.asked * took:
        rows["ticks"] += f"; --realtime {pace.asked:g} was not kept"
    if outcome.copied:
        rows["ticks"] += f"; {outcome.copied} are the earlier recording's"
    last = {name: rows.pop(name) for name in ("digest", "recording")}
    rows["time"] = summary_text.shares(outcome.profile, took)
    if outcome.restarts:
        rows["lost"] = f"{outcome.restarts} x a worker was gone"
    if outcome.rejected:
        rows["rejected"] = _counted(outcome)
    grid(out, rows | last)
    theory_comparison(out, result.theory)


def pace_of(factor: float | None) -> Pace:
    """Return how fast simulated time may pass: at most a factor of the wall's."""
    if factor is None:
        return NO_PACE
    if not 0 < factor < inf:
        raise InputError(f"--realtime: expected a number above 0, got {factor:g}")
    return RealTime(factor)


def _counted(outcome: Outcome) -> str:
    """Say what was refused, and why."""
    reasons = ", ".join(f"{count} {why}" for why, count in sorted(outcome.rejected.items()))
    return f"{sum(outcome.rejected.values())} messages that were not accepted ({reasons})"


CONTINUED = (
    ("run", "duration"),
    ("run", "divergence_limit"),
    ("run", "checkpoint_every"),
    ("bus", "deadline"),
    ("plant", "deadline"),
    ("plant", "threads"),
)
"""Keys that may change when a run is resumed: they decide nothing of what is recorded."""


def resumable(
    reader: Reader,
    output: Path | None,
    changes: "Sequence[Change]" = (),
    *,
    allow_fmus: bool = False,
    compiling: bool = False,
) -> Experiment:
    """Return the experiment of a recording that can be continued; `InputError` where it cannot.

    With changes it may be continued otherwise, and one that is completed for longer. FMUs that it
    holds are run where they are allowed.
    """
    experiment = _continued(reader, changes)
    if allow_fmus:
        experiment = with_allowed_fmus(experiment)
    if compiling:
        experiment = with_compiled_fmus(experiment)
    more = reader.status != "completed" or reader.damage
    if not more and experiment.clock.ticks <= reader.ticks:
        raise InputError(f"{reader.path}: is completed: there is nothing to resume")
    if output is not None and output.exists() and output.samefile(reader.path):
        raise InputError(f"{output}: is the recording to resume; give another name")
    expect_unlocked(Path(reader.path))
    reader.expect_ticks("resume")
    if about(reader).is_former:
        raise InputError(
            f"{reader.path}: was made when sin, cos and draws were those of libraries, and not our "
            "own: it would go on otherwise than it began; run its scenario anew"
        )
    expect_same_types(reader, experiment)
    find = find_recorded(about(reader).plants, experiment)
    group_by_archive(experiment, find=find)
    return experiment


def _continued(reader: Reader, changes: "Sequence[Change]") -> Experiment:
    """Return a recording's experiment with changes that leave what is recorded as it is."""
    experiment = experiment_of(reader)
    if not changes:
        return experiment
    for change in changes:
        for key in change.values:
            if key not in CONTINUED:
                known = ", ".join(".".join(one) for one in CONTINUED)
                raise InputError(
                    f"{change.option} {'.'.join(key)}: what is recorded was run with another; "
                    f"a run is resumed with others of {known} alone"
                )
    again = changed(experiment, changes)
    if again.clock.ticks < reader.ticks:
        end = seconds(again.clock.t(reader.ticks))
        raise InputError(
            f"{changes[-1].option} run.duration: expected at least {end!r} s, which are recorded, "
            f"got {again.scenario.run.duration!r} s"
        )
    return again


def show(text: str) -> None:
    """Tell the user of workers."""
    say("blue", "worker", text)


def _ending() -> list[signal.Signals]:
    """Return the signals that end a run: Ctrl-C, SIGTERM, and SIGHUP of a closed terminal.

    What ignores SIGHUP, as under nohup, goes on to.
    """
    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    return numbers
