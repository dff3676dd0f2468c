"""`nrs run`, `nrs resume` and `nrs worker`: a run as its user starts, continues and joins it."""

import socket
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from nrs_cosim.orchestrator.cli.option_groups import (
    OF_OUTPUT,
    OF_WORKERS,
    LinkOptions,
    RunOptions,
    WorkerOptions,
    with_groups,
)
from nrs_cosim.orchestrator.cli.option_rules import OptionRules, required_by
from nrs_cosim.orchestrator.cli.options import (
    AllowFmus,
    Compile,
    Port,
    Realtime,
    RecordingPath,
    ScenarioPath,
    ShowFoxglove,
    ShowLive,
    Stay,
    ThreadsOfWorker,
)
from nrs_cosim.orchestrator.terminal import err, say

if TYPE_CHECKING:
    from nrs_cosim.orchestrator.scenario.experiment import Experiment


@OptionRules(
    {**OF_WORKERS, **required_by(["--live", "--foxglove"], "--stay", "--port")},
    (*OF_OUTPUT, ("--live", "--foxglove")),
)
@with_groups
def run(
    scenario: ScenarioPath,
    *,
    options: RunOptions,
    ends: WorkerOptions,
    realtime: Realtime = None,
    live: ShowLive = False,
    foxglove: ShowFoxglove = False,
    port: Port = None,
    stay: Stay = False,
    embed_fmus: Annotated[
        bool,
        typer.Option(
            "--embed-fmus",
            help="Record FMUs that are not bundled too, for replays where their files are not.",
        ),
    ] = False,
    compiling: Compile = False,
) -> None:
    """Run a scenario and record every message."""
    from nrs_cosim.orchestrator.analysis.check_warnings import warnings_of
    from nrs_cosim.orchestrator.analysis.conditions import check
    from nrs_cosim.orchestrator.analysis.stiffness import mobility_at_start, stiffness
    from nrs_cosim.orchestrator.cli.terminal_run import pace_of
    from nrs_cosim.orchestrator.engine.attachments import with_fmus
    from nrs_cosim.orchestrator.engine.plants import naming_field, with_compiled_fmus
    from nrs_cosim.orchestrator.engine.scenario_warnings import scenario_warnings
    from nrs_cosim.orchestrator.scenario.file import read_scenario, scenario_name

    pace = pace_of(realtime)
    experiment = read_scenario(scenario, options.scenario_changes())
    if compiling:
        with naming_field(scenario_name(scenario)):
            experiment = with_compiled_fmus(experiment)
    with naming_field(scenario_name(scenario)):
        if embed_fmus:
            experiment = with_fmus(experiment)
    # Options are judged before anything is warned of.
    start = partial(_performing(experiment, options, ends), pace=pace)
    for warning in warnings_of(check(experiment)):
        say("yellow", "warning", warning)
    for part in stiffness(experiment, mobility_at_start(experiment)):
        say("yellow", "warning", part.sentence())
    with naming_field(scenario_name(scenario)):
        for warning in scenario_warnings(experiment):
            say("yellow", "warning", warning)
    with naming_field(scenario_name(scenario)):
        if foxglove:
            from nrs_cosim.orchestrator.report.foxglove import Foxglove

            with Foxglove(port or 0, stay) as server:
                start(begin=server.begin)
        elif live:
            from nrs_cosim.orchestrator.report.live import Live

            with Live(port or 0, stay) as page:
                start(begin=page.begin)
        else:
            start()


@OptionRules(OF_WORKERS, OF_OUTPUT)
@with_groups
def resume(
    recording: RecordingPath,
    *,
    options: RunOptions,
    ends: WorkerOptions,
    allow_fmus: AllowFmus = False,
    compiling: Compile = False,
) -> None:
    """Continue a run that did not come to its end, in a new recording that holds all of it.

    --set changes run.duration, run.divergence_limit, run.checkpoint_every and deadlines alone.
    """
    from nrs_cosim.orchestrator.cli.output_paths import unfinished
    from nrs_cosim.orchestrator.cli.progress import opened
    from nrs_cosim.orchestrator.cli.terminal_run import resumable
    from nrs_cosim.orchestrator.engine.run import past_of

    if (part := unfinished(recording)) != recording:
        say("blue", "resume", f"{part}, which was to take the place of {recording}")
        recording = part
    with opened(err, recording) as reader:
        changes = options.scenario_changes()
        experiment = resumable(
            reader, options.output, changes, allow_fmus=allow_fmus, compiling=compiling
        )
        _performing(experiment, options, ends)(past=past_of(reader))


def _performing(
    experiment: "Experiment", options: RunOptions, ends: WorkerOptions
) -> Callable[..., None]:
    """Return what runs an experiment as it was asked for."""
    from nrs_cosim.orchestrator.cli.terminal_run import perform

    return partial(
        perform,
        experiment,
        options.output,
        ends.launcher(experiment),
        options.compression,
        options.profile,
        ends.deadline,
        force=options.force,
        as_json=options.as_json,
    )


@with_groups
def worker(
    connect: Annotated[
        list[str],
        typer.Option(metavar="ENDPOINT", help="Where to meet, such as tls/lab.example:7447."),
    ],
    *,
    robots: Annotated[
        str | None,
        typer.Option(metavar="1-3,7", help="Which robots; any that are free unless given."),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(
            help="Of this worker; by default its certificate's common name, or machine's."
        ),
    ] = None,
    run_id: Annotated[
        str | None,
        typer.Option(
            "--run", metavar="ID", help="How the run's id begins, when there are several."
        ),
    ] = None,
    allow_fmus: Annotated[
        bool,
        typer.Option(
            "--allow-fmus",
            help="Run FMUs that the orchestrator sends or names by path: native code.",
        ),
    ] = False,
    threads: ThreadsOfWorker = 1,
    ends: LinkOptions,
) -> None:
    """Run some robots of a run that an orchestrator elsewhere listens for."""
    from nrs_cosim.bus.network.certificate_check import common_name
    from nrs_cosim.bus.network.endpoints import Endpoints
    from nrs_cosim.orchestrator.cli.terminal_run import show
    from nrs_cosim.orchestrator.cluster.worker_client import JoinOptions, serve
    from nrs_cosim.orchestrator.scenario.robot_ids import parse_robots

    wait, tls = ends.seconds_to_wait, ends.certificates()
    endpoints = Endpoints(
        connect=tuple(connect), tls=tls, insecure_tcp=ends.insecure_tcp, wait=wait
    )
    wanted = None if robots is None else parse_robots(robots, "--robots")
    own = name or (common_name(tls) if tls else None) or socket.gethostname()
    serve(JoinOptions(own, wanted, run_id, wait, allow_fmus, True, show, threads), endpoints)
