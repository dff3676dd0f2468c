"""`nrs replay` and `nrs diff`: what a recording says when it is run again, or beside another."""

from contextlib import suppress
from pathlib import Path
from queue import Empty, Queue
from typing import Annotated

import typer

from bus.errors import InputError
from bus.network.endpoints import Endpoints
from bus.network.zenoh_bus import ZenohBus
from orchestrator.commands import showing
from orchestrator.commands.options import Connect, Listen, RecordingPath
from orchestrator.commands.places import expect_another, expect_replaceable
from orchestrator.commands.run_cli import Output, perform
from orchestrator.replays.comparing import QUANTITIES, Comparison, compare
from orchestrator.replays.publishing import publish
from orchestrator.replays.verifying import verify
from orchestrator.replays.what_if import Change, changed, parent, run_again
from orchestrator.runs.summary import scenario_of
from orchestrator.scenario.clock import NS_PER_S
from orchestrator.terminal import AsJson, out, print_json, say
from recordings.errors import MissingExtraError, UncreatableError
from recordings.reading import Reader

FAILED = 1
LISTENER = "tcp/127.0.0.1:7447"


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
    speed: Annotated[
        float | None,
        typer.Option(metavar="X", min=1e-6, help="Simulated over wall time; 1 unless given."),
    ] = None,
    unpaced: Annotated[
        bool, typer.Option("--as-fast-as-possible", help="With --publish: do not pace it.")
    ] = False,
    since: Annotated[float | None, typer.Option("--from", metavar="T", help="s")] = None,
    until: Annotated[float | None, typer.Option("--to", metavar="T", help="s, excluded")] = None,
    listen: Listen = None,
    connect: Connect = None,
    wait: Annotated[
        float, typer.Option(metavar="SECONDS", help="How long to wait for somebody who listens.")
    ] = 60.0,
    plant: Annotated[
        list[str] | None,
        typer.Option(
            metavar="robots=3,plant.fmu=other.fmu",
            help="What if plants had been others: run them again; may be given again.",
        ),
    ] = None,
    algorithm: Annotated[
        list[str] | None,
        typer.Option(metavar="beta=0.9", help="What if the algorithm had been another."),
    ] = None,
    output: Output = None,
) -> None:
    """Run a recording again: to verify it, to hear it, or to ask what if."""
    asked = [verifying, publishing, bool(plant or algorithm)]
    if sum(asked) != 1:
        raise InputError(
            "nrs replay: give one of --verify, --publish, or changes by --plant and --algorithm"
        )
    with Reader(recording) as reader:
        if verifying:
            _verify(reader, plants=not agents_only)
        elif publishing:
            endpoints = Endpoints(
                listen=tuple(listen or (() if connect else (LISTENER,))),
                connect=tuple(connect or ()),
            )
            pace = None if unpaced else speed or 1.0
            _publish(reader, endpoints, pace, (since, until), wait)
        else:
            _what_if(reader, plant or [], algorithm or [], output)


def diff(
    a: Annotated[Path, typer.Argument(metavar="A", help="A recording (MCAP).")],
    b: Annotated[Path, typer.Argument(metavar="B", help="Another.")],
    as_json: AsJson = False,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Draw how far apart they are, over time."),
    ] = None,
) -> None:
    """Say what is not the same in two recordings; exit status 1 when anything is not."""
    with Reader(a) as one, Reader(b) as other:
        found = compare(one, other)
    if picture:
        expect_replaceable(picture, "PNG picture", b"\x89PNG")
        _draw(found, picture)
    if as_json:
        print_json(found.as_json())
    else:
        showing.comparison(out, found)
    raise typer.Exit(0 if found.is_same else FAILED)


def _draw(found: Comparison, picture: Path) -> None:
    try:
        from recordings.report.apart import write_distances  # noqa: PLC0415, needs an extra
    except ImportError:
        raise MissingExtraError(
            "--picture: needs matplotlib, which is not installed: pip install 'nrs-cosim[report]'"
        ) from None
    try:
        write_distances(found.times, found.apart, QUANTITIES, picture)
    except OSError as error:
        raise UncreatableError(f"{picture}: cannot be written: {error.strerror}") from None


def _verify(reader: Reader, *, plants: bool) -> None:
    for damage in reader.damage:
        say("yellow", "damage", damage)
    verdict = verify(reader, scenario_of(reader), plants=plants)
    what = "agents and plants" if plants else "agents"
    if verdict.difference:
        say("red", "differs", verdict.difference.between("the recording", "the replay"))
        raise typer.Exit(FAILED)
    out.print(
        f"identical: {what} say the same {verdict.messages} messages again, to the last bit, "
        f"in ticks 0 to {verdict.ticks}"
    )


def _publish(
    reader: Reader,
    endpoints: Endpoints,
    speed: float | None,
    between: tuple[float | None, float | None],
    wait: float,
) -> None:
    start_ns, end_ns = (None if t is None else round(t * NS_PER_S) for t in between)
    last = reader.end_ns or 0
    if (start_ns or 0) > last or (end_ns is not None and end_ns <= (start_ns or 0)):
        raise InputError(
            f"--from {between[0]} --to {between[1]}: nothing of the recording, which ends at "
            f"{last / NS_PER_S:g} s, lies there"
        )
    topic = reader.channels[0].topic

    def ready(bus: ZenohBus) -> None:
        where = ", ".join(endpoints.listen or endpoints.connect)
        say("blue", "bus", f"nrs/{bus.run_id}/** at {where}; waiting for somebody who listens")
        if not bus.wait_for_listener(topic, wait):
            raise InputError(f"--wait: nobody listened to nrs/{bus.run_id}/{topic} in {wait:g} s")

    nothing: Queue[None] = Queue()

    def pause(seconds: float) -> None:
        with suppress(Empty):
            nothing.get(timeout=seconds)

    count = publish(
        reader, endpoints, speed=speed, start_ns=start_ns, end_ns=end_ns, ready=ready, wait=pause
    )
    out.print(f"{count} messages were put")


def _what_if(reader: Reader, plant: list[str], algorithm: list[str], output: Path | None) -> None:
    if reader.status != "completed" or reader.damage:
        raise InputError(f"{reader.path}: is {reader.status}: let `nrs resume` complete it first")
    expect_another(output, Path(reader.path))
    plants = [Change.of("--plant", text) for text in plant]
    algorithms = [Change.of("--algorithm", text) for text in algorithm]
    file = changed(scenario_of(reader), plants, algorithms)
    every = tuple(range(1, file.scenario.n + 1))
    robots = {robot for change in plants for robot in change.robots or every}
    man = None if algorithms else run_again(reader, file, sorted(robots))
    perform(file, output, man, metadata=parent(reader, [*plants, *algorithms]))
