"""`nrs replay` and `nrs diff`: what a recording says when it is run again, or beside another."""

from pathlib import Path
from typing import Annotated

import typer

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.cli.option_rules import OptionRules, required_by
from nrs_cosim.orchestrator.cli.options import (
    AllowFmus,
    Compile,
    Connect,
    Epoch,
    Force,
    InsecureTcp,
    Listen,
    Output,
    Port,
    RecordingPath,
    ShowFoxglove,
    epoch_ns_of,
    moment,
    number,
    whole_number,
)
from nrs_cosim.orchestrator.exit_status import DONE, FAILED
from nrs_cosim.orchestrator.terminal import AsJson, err, out, print_json, say

SLOWEST = 1e-6
LISTENER = "tcp/127.0.0.1:7447"
_STORED = (
    "scenarios and digests, that of a file whose every checksum agrees as it stands there; "
    "--verify computes them from the messages"
)


@OptionRules(
    {
        **required_by(["--verify"], "--agents-only"),
        **required_by(["--publish", "--foxglove"], "--speed", "--from", "--until"),
        **required_by(["--publish"], "--as-fast-as-possible"),
        **required_by(["--foxglove"], "--port"),
        **required_by(["--publish"], "--ros2"),
        **required_by(["--ros2"], "--domain", "--epoch"),
        **required_by(["--publish"], "--listen", "--connect", "--insecure-tcp", "--wait"),
        **required_by(["--plant", "--algorithm"], "-o", "--force"),
    },
    [("--speed", "--as-fast-as-possible")],
    [("--verify",), ("--publish",), ("--foxglove",), ("--plant", "--algorithm")],
)
def replay(
    recording: RecordingPath,
    verifying: Annotated[
        bool, typer.Option("--verify", help="Run it again, and compare bit by bit.")
    ] = False,
    agents_only: Annotated[
        bool, typer.Option("--agents-only", help="With --verify: without the FMUs.")
    ] = False,
    publishing: Annotated[
        bool, typer.Option("--publish", help="Put its messages back on the bus, for live tools.")
    ] = False,
    ros2: Annotated[
        bool,
        typer.Option(
            "--ros2",
            help="With --publish: as nodes of ROS 2 do over rmw_zenoh, what `convert --to ros2` "
            "writes. Experimental: it was not tried on ROS itself.",
        ),
    ] = False,
    domain: Annotated[
        int,
        typer.Option(
            metavar="N", parser=whole_number("--domain", 0, 232), help="The ROS_DOMAIN_ID."
        ),
    ] = 0,
    epoch: Epoch = 0,
    foxglove: ShowFoxglove = False,
    port: Port = None,
    speed: Annotated[
        float | None,
        typer.Option(
            metavar="X",
            parser=number("--speed"),
            help="Simulated time over wall time; 1 unless given.",
        ),
    ] = None,
    unpaced: Annotated[
        bool, typer.Option("--as-fast-as-possible", help="With --publish: do not pace it.")
    ] = False,
    since: Annotated[
        float | None,
        typer.Option(
            "--from",
            metavar="T",
            parser=moment("--from"),
            help="Begin with messages of this simulated time, s.",
        ),
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            "--until",
            "--to",
            metavar="T",
            parser=moment("--until"),
            help="End before messages of this simulated time, s.",
        ),
    ] = None,
    listen: Listen = None,
    connect: Connect = None,
    insecure_tcp: InsecureTcp = False,
    wait: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            parser=number("--wait"),
            help="With --publish: how long to wait for a subscriber.",
        ),
    ] = 60.0,
    plant: Annotated[
        list[str] | None,
        typer.Option(
            metavar="robots=3,plant.fmu=other.fmu",
            help="What if: change plants, and run again; may be given again.",
        ),
    ] = None,
    algorithm: Annotated[
        list[str] | None,
        typer.Option(metavar="beta=0.9", help="What if: change the algorithm, and run again."),
    ] = None,
    output: Output = None,
    force: Force = False,
    allow_fmus: AllowFmus = False,
    compiling: Compile = False,
) -> None:
    """Run a recording again: to verify it, to publish or show it, or to change it (what if)."""
    from nrs_cosim.bus.network.endpoints import Endpoints
    from nrs_cosim.orchestrator.cli import terminal_replay
    from nrs_cosim.orchestrator.cli.progress import opened

    if speed is not None and speed < SLOWEST:
        raise InputError(f"--speed: expected at least {SLOWEST:g}, got {speed:g}")
    if verifying:
        terminal_replay.verify_again(
            recording, plants=not agents_only, allow_fmus=allow_fmus, compiling=compiling
        )
        return
    with opened(err, recording) as reader:
        if foxglove:
            terminal_replay.serve(reader, port or 0, speed or 1.0, (since, until))
        elif publishing:
            endpoints = Endpoints(
                listen=tuple(listen or (() if connect else (LISTENER,))),
                connect=tuple(connect or ()),
                insecure_tcp=insecure_tcp,
            )
            pace = None if unpaced else speed or 1.0
            as_ros2 = (domain, epoch_ns_of(epoch, reader)) if ros2 else None
            terminal_replay.put_back(reader, endpoints, pace, (since, until), wait, as_ros2)
        else:
            terminal_replay.what_if(
                reader, plant or [], algorithm or [], output, force, allow_fmus, compiling
            )


def diff(
    a: Annotated[Path, typer.Argument(metavar="A", help="A recording (MCAP).")],
    b: Annotated[Path, typer.Argument(metavar="B", help="Another.")],
    as_json: AsJson = False,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Draw how far apart they are, over time."),
    ] = None,
    verifying: Annotated[
        bool,
        typer.Option(
            "--verify", help="Compute digests from the messages; do not take them as stored."
        ),
    ] = False,
) -> None:
    """Compare two recordings; exit status 1 when anything differs.

    Equal digests of whole recordings are taken as they are stored, unless --verify is given.
    """
    from nrs_cosim.orchestrator.cli import summary_text, terminal_replay
    from nrs_cosim.orchestrator.cli.formats import expect_ending
    from nrs_cosim.orchestrator.cli.output_paths import expect_replaceable, make_folder
    from nrs_cosim.orchestrator.cli.progress import reading
    from nrs_cosim.orchestrator.replay.diff import compare
    from nrs_cosim.recordings.mcap.reader import Reader
    from nrs_cosim.recordings.schemas import about
    from nrs_cosim.recordings.units import unit_of_joints

    if picture:
        expect_ending("--picture", picture, ".png")
        draw = terminal_replay.drawing()
    with (
        reading(err) as follow,
        Reader(a, verify=verifying, watch=follow(a)) as one,
        Reader(b, verify=verifying, watch=follow(b)) as other,
    ):
        found = compare(one, other, terminal_replay.MOST_DRAWN if picture else 0)
        coordinate = unit_of_joints(about(one).run, about(other).run)
        for reader in (one, other):
            for damage in reader.damage:
                say("yellow", "damage", f"{reader.path}: {damage}")
    if picture:
        if why := found.why_not or "they are the same" * (found.compared != "messages"):
            raise InputError(f"--picture: nothing to draw: {why}")
        expect_replaceable(picture, "PNG picture", b"\x89PNG")
        make_folder(picture)
        draw(found, picture, coordinate)
    if as_json:
        print_json(found.as_json())
    else:
        summary_text.comparison(out, found)
        if found.compared == "stored digests":
            say("blue", "compared", _STORED)
        if found.why_not:
            say("yellow", "apart", found.why_not)
    raise typer.Exit(DONE if found.is_same else FAILED)
