"""A run: a scenario in, a closed recording out, whatever happens in between."""

import json
import platform
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.errors import Cause, RunError
from nrs_cosim.bus.keys import ORCHESTRATOR
from nrs_cosim.estimator_agents.installed import package_of
from nrs_cosim.orchestrator.engine.attachments import (
    asset_records,
    attachments,
    expect_attachable,
    folder_from,
    recorded_assets,
    urdf_records,
    urdfs_of,
)
from nrs_cosim.orchestrator.engine.growth import growth_before
from nrs_cosim.orchestrator.engine.in_process import InProcess, in_process
from nrs_cosim.orchestrator.engine.last_fifth import LastFifth
from nrs_cosim.orchestrator.engine.layouts import expect_same_on_any_workers
from nrs_cosim.orchestrator.engine.lockstep import Launcher, Lockstep, TargetNode, Workers, window
from nrs_cosim.orchestrator.engine.native.arranging import load_arranging
from nrs_cosim.orchestrator.engine.pace import NO_PACE, Pace
from nrs_cosim.orchestrator.engine.restart import AT_ONCE
from nrs_cosim.orchestrator.engine.summary import told_of
from nrs_cosim.orchestrator.engine.worker import Spent, Watch, needed
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.algorithms import ALGORITHM
from nrs_cosim.recordings.channels import channels, schemas
from nrs_cosim.recordings.link_counts import LinkCounter
from nrs_cosim.recordings.mcap.container import Closing, Compression, Message
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.ticks import ticks
from nrs_cosim.recordings.mcap.writer import Writer
from nrs_cosim.recordings.metadata import (
    ASSETS,
    CAUSE,
    LINKS,
    REJECTED,
    RUN,
    SAMPLES,
    SPENT,
    VERSIONS,
)
from nrs_cosim.recordings.recorder import Recorder
from nrs_cosim.recordings.schemas import fields_record

_PARTS = ("nrs-cosim", "eclipse-zenoh", "fmpy", "mcap", "numpy", "scipy")


@dataclass(frozen=True, slots=True)
class Profile:
    """Where the wall time of a run went, s."""

    workers: Mapping[str, Spent]
    orchestrator: Spent
    recording: float
    in_one_thread: bool
    """Whether the only worker is in the orchestrator's own thread."""
    numpy_why: str
    """Then: why NumPy does the ticks; nothing where native code does."""
    steps_why: str
    """Then: why native code that does the ticks does not step the plants too; nothing if so."""

    @classmethod
    def of(cls, workers: Workers, lockstep: Lockstep) -> "Profile":
        """Return where the time of a run went that is over."""
        here = isinstance(workers, InProcess)
        why = (workers.numpy_why, workers.steps_why) if isinstance(workers, InProcess) else ("", "")
        return cls(workers.spent(), lockstep.spent, lockstep.recording, here, *why)

    def as_json(self) -> dict[str, dict[str, float]]:
        """Return it for JSON, s by process and by what it was spent on."""
        workers = {name: asdict(spent) for name, spent in self.workers.items()}
        mine = {**asdict(self.orchestrator), "recording": self.recording}
        return {**workers, ORCHESTRATOR: mine}


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended, and where its recording is."""

    status: Closing
    reason: str
    path: Path
    ticks: int
    messages: int
    wall_seconds: float
    """From the states at t_0 to the last tick; set-up and closing are apart."""
    profile: Profile
    rejected: Mapping[str, int]
    """How many batches were rejected, by reason."""
    restarts: int
    """How often a worker was gone, and the run went on."""
    repeated: int
    """How many batches were said again, and kept once."""
    copied: int
    """How many ticks an earlier recording had."""


def run(
    experiment: Experiment,
    output: Path,
    launch: Launcher | None = None,
    *,
    compression: Compression = "zstd",
    watch: Watch = lambda _time_ns: None,
    deadline: float | None = None,
    past: Iterator[list[Message]] | None = None,
    metadata: Mapping[str, Mapping[str, str]] | None = None,
    pace: Pace = NO_PACE,
    more: Callable[[Path], Mapping[str, str]] = lambda _path: {},
) -> Outcome:
    """Run an experiment into a recording.

    `launch` gets its workers; by default its robots are in this thread. `watch` is told each output
    time, ns, that was reached, and ends the run by `Interrupted`. A failure before the states at
    t_0 is raised and leaves no file; a later one is the outcome's. `deadline`, s, goes before the
    scenario's. `past` are the ticks from 0 on, as messages, that an earlier recording of the same
    run has: they are copied, and the run goes on after them. `metadata` joins the recording's own.
    `pace` is the fastest at which ticks close. Of a run that comes to its end, what `more` returns
    of the recording joins what is said there; it is whole when that is called.
    """
    clock, n, scenario = experiment.clock, experiment.n, experiment.scenario
    every, faulty = scenario.run.checkpoint_every, experiment.faulty
    checkpoints = 0 < every <= clock.ticks
    expect_attachable(experiment.assets)
    expect_same_on_any_workers(experiment)
    # What is not finite is looked for and named, not warned of.
    with ExitStack() as stack, np.errstate(all="ignore"):
        bus, workers = (launch or in_process(experiment))(stack, watch)
        wire = workers.wire()
        target = TargetNode(bus, clock, wire, experiment.target)
        plants = workers.describe_plants()
        assets, urdfs = recorded_assets(experiment, plants), urdfs_of(experiment, plants)
        measuring = experiment.topologies.ever_pinned
        topics = channels(experiment.codecs, n, faulty, checkpoints, plants, measuring.tolist())
        writer = stack.enter_context(
            Writer(
                output,
                version=version("nrs-cosim"),
                channels=topics,
                schemas=schemas(topics, experiment.codecs),
                metadata={
                    RUN: _about_run(experiment, plants, output),
                    VERSIONS: {**_versions(), **_packages(experiment)},
                    **fields_record(experiment.codecs),
                    **({ASSETS: asset_records(assets)} if assets else {}),
                    **urdf_records(urdfs),
                    **(metadata or {}),
                },
                attachments=attachments(experiment, assets, urdfs),
                compression=compression,
                arranging=load_arranging(),
            )
        )
        fifth, met = LastFifth(experiment), LinkCounter(n)
        recorder = Recorder(writer, wire, n, every + 2 * AT_ONCE, fifth.take, met.take)
        of_tick = wire.samples.size + wire.states.size * len(clock.outputs(1))
        of_tick += sum(codec.size for codec in wire.of_agents.values())
        lockstep = Lockstep(
            clock,
            target,
            workers,
            recorder,
            needs_of(experiment, workers.assignment),
            window(n * of_tick),
            deadline or scenario.bus.deadline,
            watch,
            pace,
        )
        status: Closing = "completed"
        reason, cause = "", None
        copied = 0
        started = perf_counter()
        try:
            for k, tick in enumerate(past or ()):
                recorder.copy(k, tick)
                watch(clock.t(k))
            copied = max(recorder.closed, 0)
            workers.begin(recorder)
            for _ in lockstep.run():
                pass
        except Interrupted:
            last = max(recorder.closed, 0)
            at = seconds(clock.t(last))
            status, reason = "interrupted", f"stopped by the user after t = {at:g} s"
            cause = Cause("interrupted", last, clock.t(last))
        except RunError as error:
            status, reason, cause = "failed", str(error), _placed(error.cause, clock, recorder)
        wall_seconds = perf_counter() - started
        workers.end()
        recorder.end()
        if cause and cause.kind == "plant":
            reason = _grown_before(writer, experiment) + reason
        rejected = Counter(recorder.rejected) + Counter(workers.rejected)
        profile = Profile.of(workers, lockstep)
        extra = {
            SPENT: json.dumps(profile.as_json()),
            REJECTED: json.dumps(rejected),
            SAMPLES: str(recorder.sent),
            **(fifth.said() if status == "completed" else {}),
            **({LINKS: met.found().model_dump_json()} if faulty else {}),
        }
        if cause:
            extra[CAUSE] = json.dumps(asdict(cause))
        writer.finish(status, reason, extra, lambda: more(output))
    done = max(recorder.closed, 0)
    return Outcome(
        status,
        reason,
        output,
        done,
        recorder.messages,
        wall_seconds,
        profile,
        rejected,
        workers.restarts,
        recorder.repeated,
        copied,
    )


def _grown_before(writer: Writer, experiment: Experiment) -> str:
    """Return how the estimates that are recorded had grown when a plant gave up, if they had."""
    writer.flush()
    with Reader(writer.path) as reader:
        growth = growth_before(reader, experiment)
    if growth is None:
        return ""
    faster = f", {growth.rate:.3g} times at each sampling time" if growth.rate else ""
    return f"the estimates' errors had grown to {growth.after:.3g}{faster}, and a plant gave up: "


def _placed(cause: Cause, clock: Clock, recorder: Recorder) -> Cause:
    """Return a cause with the tick that did not close and its time, where it does not say so."""
    tick = recorder.closed + 1 if cause.tick is None else cause.tick
    time_ns = clock.t(min(tick, clock.ticks)) if cause.time_ns is None else cause.time_ns
    return replace(cause, tick=tick, time_ns=time_ns)


def past_of(reader: Reader) -> Iterator[list[Message]]:
    """Yield the messages of a recording's ticks from 0 on, up to the first that is missing."""
    return (tick.messages(reader.topics) for tick in ticks(reader))


def needs_of(
    experiment: Experiment, assignment: Mapping[str, Sequence[int]]
) -> dict[str, frozenset[str]]:
    """Return the workers whose samples each worker needs: for its robots, and for lies to them."""
    nodes = {worker: np.array(robots) for worker, robots in assignment.items()}
    links, found = experiment.topologies.links, {}
    for worker, robots in assignment.items():
        receiving = {*robots, *(own.robot for own in experiment.algorithm_lies(robots))}
        sources = links.source[np.isin(links.sink, [*receiving])]
        found[worker] = needed(np.unique(sources), nodes)
    return found


def _about_run(
    experiment: Experiment, plants: Sequence[Mapping[str, Any]], output: Path
) -> dict[str, str]:
    """Return the run's metadata record; its numbers are decimal, its times in ns."""
    return {
        "name": experiment.name,
        "folder": folder_from(output, experiment),
        **{key: str(number) for key, number in told_of(experiment).items()},
        "plants": json.dumps([{k: v for k, v in plant.items() if k != "urdf"} for plant in plants]),
    }


def _packages(experiment: Experiment) -> dict[str, str]:
    """Return the packages of algorithms that are not ours, also of those by which robots lie."""
    liars = [entry.algorithm for entry in experiment.scenario.faults.byzantine]
    names = {one.name for one in (experiment.scenario.algorithm, *liars) if one}
    found = {ALGORITHM + name: package_of(name) for name in sorted(names)}
    return {name: package for name, package in found.items() if package}


@cache
def _versions() -> Mapping[str, str]:
    return {
        **{part: version(part) for part in _PARTS},
        "python": platform.python_version(),
        "platform": " ".join([platform.system(), platform.machine(), *platform.libc_ver()]).strip(),
    }
