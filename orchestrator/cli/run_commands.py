"""`nrs run`, `nrs resume` and `nrs worker`: a run as its user starts, continues and joins it."""

import socket
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from nrs_cosim.orchestrator.cli.options import (
    WAIT,
    Compressed,
    Connect,
    Deadline,
    Expect,
    Force,
    InsecureTcp,
    Listen,
    NoRestart,
    Output,
    Port,
    Realtime,
    RecordingPath,
    ScenarioPath,
    Set,
    ShowLive,
    ShowProfile,
    Stay,
    TlsCa,
    TlsCertificate,
    TlsKey,
    Wait,
    Workers,
    expect_of,
)
from nrs_cosim.orchestrator.terminal import AsJson, err, say


def run(
    scenario: ScenarioPath,
    output: Output = None,
    changes: Set = None,
    as_json: AsJson = False,
    force: Force = False,
    compression: Compressed = "zstd",
    workers: Workers = None,
    profile: ShowProfile = False,
    deadline: Deadline = None,
    no_restart: NoRestart = False,
    listen: Listen = None,
    connect: Connect = None,
    expect: Expect = 1,
    wait: Wait = None,
    tls_ca: TlsCa = None,
    tls_certificate: TlsCertificate = None,
    tls_key: TlsKey = None,
    insecure_tcp: InsecureTcp = False,
    realtime: Realtime = None,
    live: ShowLive = False,
    port: Port = None,
    stay: Stay = False,
) -> None:
    """Run a scenario and record every message."""
    from nrs_cosim.bus.network.endpoints import Endpoints
    from nrs_cosim.orchestrator.analysis.conditions import check
    from nrs_cosim.orchestrator.cli import terminal_run
    from nrs_cosim.orchestrator.cli.tls import tls_of
    from nrs_cosim.orchestrator.engine.plants import naming_field
    from nrs_cosim.orchestrator.engine.units import mixed_units
    from nrs_cosim.orchestrator.scenario.changes import Change
    from nrs_cosim.orchestrator.scenario.file import read_scenario, scenario_name

    pace = terminal_run.pace_of(realtime)
    expect_of({"--live": live or None}, {"--stay": stay or None, "--port": port})
    _expect_of_workers(workers, listen, connect, wait, no_restart)
    wait = WAIT if wait is None else wait
    _expect_beyond(listen, connect, tls_ca, tls_certificate, tls_key, insecure_tcp)
    asked = [Change.of("--set", text) for text in changes or ()]
    experiment = read_scenario(scenario, asked)
    for warning in check(experiment).warnings():
        say("yellow", "warning", warning)
    with naming_field(scenario_name(scenario)):
        if mixed := mixed_units(experiment):
            say("yellow", "warning", mixed)
    tls = tls_of(tls_ca, tls_certificate, tls_key, experiment.scenario.bus.tls, experiment.folder)
    ends = partial(Endpoints, tls=tls, insecure_tcp=insecure_tcp, wait=wait)
    policy = terminal_run.policy_of(no_restart, wait, expect, deadline)
    launch = terminal_run.launcher_of(experiment, workers, policy, listen, connect, ends)
    start = partial(
        terminal_run.perform,
        experiment,
        output,
        launch,
        compression,
        profile,
        deadline,
        pace=pace,
        force=force,
        as_json=as_json,
    )
    with naming_field(scenario_name(scenario)):
        if not live:
            start()
        else:
            from nrs_cosim.orchestrator.report.live import Live

            with Live(port or 0, stay) as page:
                start(begin=page.begin)


def resume(
    recording: RecordingPath,
    output: Output = None,
    changes: Set = None,
    as_json: AsJson = False,
    force: Force = False,
    compression: Compressed = "zstd",
    workers: Workers = None,
    profile: ShowProfile = False,
    deadline: Deadline = None,
    no_restart: NoRestart = False,
    listen: Listen = None,
    connect: Connect = None,
    expect: Expect = 1,
    wait: Wait = None,
    tls_ca: TlsCa = None,
    tls_certificate: TlsCertificate = None,
    tls_key: TlsKey = None,
    insecure_tcp: InsecureTcp = False,
) -> None:
    """Continue a run that did not come to its end, in a new recording that holds all of it."""
    from nrs_cosim.bus.network.endpoints import Endpoints
    from nrs_cosim.orchestrator.cli import terminal_run
    from nrs_cosim.orchestrator.cli.output_paths import unfinished
    from nrs_cosim.orchestrator.cli.progress import opened
    from nrs_cosim.orchestrator.cli.tls import tls_of
    from nrs_cosim.orchestrator.engine.run import past_of
    from nrs_cosim.orchestrator.scenario.changes import Change

    _expect_of_workers(workers, listen, connect, wait, no_restart)
    wait = WAIT if wait is None else wait
    if (part := unfinished(recording)) != recording:
        say("blue", "resume", f"{part}, which was to take the place of {recording}")
        recording = part
    _expect_beyond(listen, connect, tls_ca, tls_certificate, tls_key, insecure_tcp)
    with opened(err, recording) as reader:
        asked = [Change.of("--set", text) for text in changes or ()]
        experiment = terminal_run.resumable(reader, output, asked)
        tls = tls_of(
            tls_ca, tls_certificate, tls_key, experiment.scenario.bus.tls, experiment.folder
        )
        ends = partial(Endpoints, tls=tls, insecure_tcp=insecure_tcp, wait=wait)
        policy = terminal_run.policy_of(no_restart, wait, expect, deadline)
        launch = terminal_run.launcher_of(experiment, workers, policy, listen, connect, ends)
        terminal_run.perform(
            experiment,
            output,
            launch,
            compression,
            profile,
            deadline,
            past_of(reader),
            force=force,
            as_json=as_json,
        )


def worker(
    connect: Annotated[
        list[str],
        typer.Option(metavar="ENDPOINT", help="Where to meet, such as tls/lab.example:7447."),
    ],
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
    wait: Wait = None,
    tls_ca: TlsCa = None,
    tls_certificate: TlsCertificate = None,
    tls_key: TlsKey = None,
    insecure_tcp: InsecureTcp = False,
) -> None:
    """Run some robots of a run that an orchestrator elsewhere listens for."""
    from nrs_cosim.bus.network.certificate_check import common_name
    from nrs_cosim.bus.network.endpoints import Endpoints
    from nrs_cosim.orchestrator.cli.terminal_run import show
    from nrs_cosim.orchestrator.cli.tls import tls_of
    from nrs_cosim.orchestrator.cluster.worker_client import JoinOptions, serve
    from nrs_cosim.orchestrator.scenario.robot_ids import parse_robots

    wait = WAIT if wait is None else wait
    tls = tls_of(tls_ca, tls_certificate, tls_key)
    endpoints = Endpoints(connect=tuple(connect), tls=tls, insecure_tcp=insecure_tcp, wait=wait)
    wanted = None if robots is None else parse_robots(robots, "--robots")
    own = name or (common_name(tls) if tls else None) or socket.gethostname()
    options = JoinOptions(own, wanted, run_id, wait, allow_fmus, True, show)
    serve(options, endpoints)


def _expect_of_workers(
    workers: str | None,
    listen: list[str] | None,
    connect: list[str] | None,
    wait: float | None,
    no_restart: bool,
) -> None:
    """Refuse what is about workers where the run has none."""
    owners = {"--workers": workers, "--listen": listen or None, "--connect": connect or None}
    expect_of(owners, {"--wait": wait, "--no-restart": no_restart or None})


def _expect_beyond(
    listen: list[str] | None,
    connect: list[str] | None,
    tls_ca: Path | None,
    tls_certificate: Path | None,
    tls_key: Path | None,
    insecure_tcp: bool,
) -> None:
    """Refuse what is about links beyond this process where the run has none."""
    tls = {"--tls-ca": tls_ca, "--tls-certificate": tls_certificate, "--tls-key": tls_key}
    owners = {"--listen": listen or None, "--connect": connect or None}
    expect_of(owners, {**tls, "--insecure-tcp": insecure_tcp or None})
