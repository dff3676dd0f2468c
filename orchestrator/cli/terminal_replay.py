"""What is done with a recording: it is verified, put back on the bus, changed, or drawn apart."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from queue import Empty, Queue

import typer

from nrs_cosim.bus.clock import NS_PER_S
from nrs_cosim.bus.errors import InputError, MissingExtraError
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.plurals import count_of
from nrs_cosim.orchestrator.analysis.results import wrong_at_end
from nrs_cosim.orchestrator.cli.output_paths import expect_another
from nrs_cosim.orchestrator.cli.progress import reading
from nrs_cosim.orchestrator.cli.terminal_run import perform
from nrs_cosim.orchestrator.engine.attachments import with_allowed_fmus
from nrs_cosim.orchestrator.engine.plants import with_compiled_fmus
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.exit_status import FAILED
from nrs_cosim.orchestrator.replay.diff import Comparison
from nrs_cosim.orchestrator.replay.publish import as_recorded, as_ros2
from nrs_cosim.orchestrator.replay.verify import Verification, verify
from nrs_cosim.orchestrator.replay.what_if import changed_run
from nrs_cosim.orchestrator.report.foxglove import Foxglove
from nrs_cosim.orchestrator.scenario.changes import Change
from nrs_cosim.orchestrator.terminal import err, out, prose, say
from nrs_cosim.recordings.errors import UncreatableError, UnreadableError
from nrs_cosim.recordings.mcap.container import DamageError
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.schemas import about

MOST_DRAWN = 24
"""Robots of which distances are drawn."""


def drawing() -> Callable[[Comparison, Path, str], None]:
    try:
        from nrs_cosim.recordings.report.print import write_distances  # noqa: PLC0415, needs an extra
    except ImportError:
        raise MissingExtraError("--picture: needs matplotlib", "report") from None

    def draw(found: Comparison, picture: Path, coordinate: str) -> None:
        try:
            write_distances(found.apart, picture, coordinate)
        except OSError as error:
            raise UncreatableError(f"{picture}: cannot be written: {error.strerror}") from None

    return draw


def verify_again(
    recording: Path, *, plants: bool, allow_fmus: bool, compiling: bool = False
) -> None:
    def verified(*, judged: bool) -> tuple[Verification, Mapping[str, str]]:
        with (
            reading(err) as follow,
            Reader(recording, verify=judged, watch=follow(recording)) as reader,
        ):
            for damage in reader.damage:
                say("yellow", "damage", damage)
            known = len(reader.damage)
            experiment = experiment_of(reader)
            if allow_fmus:
                experiment = with_allowed_fmus(experiment)
            if compiling:
                experiment = with_compiled_fmus(experiment)
            found = verify(reader, experiment, plants=plants)
            if found.status == "identical" and not found.by_libraries:
                found = replace(found, at_end=wrong_at_end(reader, experiment))
        for damage in reader.damage[known:]:
            say("yellow", "damage", damage)
        return found, about(reader).versions

    try:
        verification, versions = verified(judged=False)
    except UnreadableError as error:
        if not isinstance(error.__cause__, DamageError):
            raise
        # A chunk is not as a run writes them, though all checksums agree: the others are verified.
        verification, versions = verified(judged=True)
    if verification.difference:
        say("red", "differs", verification.difference.between("the recording", "the replay"))
        if verification.by_libraries:
            say("yellow", "libraries", _libraries(versions))
        raise typer.Exit(FAILED)
    if verification.at_end:
        say("red", "differs", verification.at_end)
        raise typer.Exit(FAILED)
    same = _compared(verification, plants)
    if verification.status == "identical":
        prose(out, f"identical: {same}")
        return
    lacks = {
        None: "how many the run had beside these is not known",
        0: "",
    }.get(verification.missing, f"{verification.missing} that the run had are not here")
    unseen = (
        f"{verification.unseen} that are here could not be looked at" if verification.unseen else ""
    )
    seen = same if verification.ticks >= 0 else "no message could be looked at: tick 0 is not here"
    say("red", "unverified", "; ".join(filter(None, (seen, unseen, lacks))))
    raise typer.Exit(FAILED)


def _libraries(recorded: Mapping[str, str]) -> str:
    """Say what a recording rests on that was made with libraries' mathematics."""
    with_what = ", ".join(
        f"{name} {recorded[name]}" for name in ("numpy", "scipy", "platform") if name in recorded
    )
    return (
        f"the recording was made when sin, cos and draws were those of libraries ({with_what}): "
        "they were computed by those here, which on another processor or of another version may "
        "differ in last bits, and so may what follows from them"
    )


def _compared(verification: Verification, plants: bool) -> str:
    """Say what was computed again and is the same, and what was taken from the recording."""
    who, taken = "agents and plants", ""
    count = count_of(verification.checkpoints, "checkpoint")
    beside = f", beside {count} of the plants" if verification.checkpoints else ""
    libraries = "; sin, cos and draws are those of libraries, as when it was recorded"
    of_libraries = libraries if verification.by_libraries else ""
    if not plants:
        who = "agents"
        taken = (
            " (positions, velocities and efforts in them are taken from the recording, for the "
            "plants did not run)"
        )
    return (
        f"{who}, run again, give the same {verification.messages} messages{taken}, to the last "
        f"bit, in ticks 0 to {verification.ticks}{beside}{of_libraries}"
    )


def _range(
    reader: Reader, between: tuple[float | None, float | None], purpose: str
) -> tuple[int | None, int | None]:
    """Return times in ns; `InputError` where nothing of a recording lies between them.

    What is missing of it is said before it is played.
    """
    reader.expect_ticks(purpose)
    for damage in reader.damage:
        say("yellow", "damage", damage)
    start_ns, end_ns = (None if t is None else round(t * NS_PER_S) for t in between)
    last = reader.end_ns or 0
    if (start_ns or 0) > last or (end_ns is not None and end_ns <= (start_ns or 0)):
        given = zip(("--from", "--until"), between, strict=True)
        raise InputError(
            f"{' '.join(f'{option} {t:g}' for option, t in given if t is not None)}: nothing of "
            f"the recording, which ends at {last / NS_PER_S:g} s, lies there"
        )
    return start_ns, end_ns


def serve(
    reader: Reader, port: int, speed: float, between: tuple[float | None, float | None]
) -> None:
    """Play a recording to who listens by Foxglove's protocol, until Ctrl-C."""
    start_ns, end_ns = _range(reader, between, "replay")
    last = reader.end_ns or 0
    with Foxglove(port) as server:
        until = last if end_ns is None else min(end_ns - 1, last)
        server.replay(Path(reader.path), start_ns or 0, until, speed)
        say("blue", "replay", "it plays when somebody listens, and stays until Ctrl-C")
        server.wait()
    if server.has_failed:
        raise typer.Exit(FAILED)


def put_back(
    reader: Reader,
    endpoints: Endpoints,
    speed: float | None,
    between: tuple[float | None, float | None],
    wait: float,
    ros2: tuple[int, int] | None = None,
) -> None:
    """Put a recording on the bus; as ROS 2 where a domain and an epoch (ns) are given."""
    start_ns, end_ns = _range(reader, between, "publish")
    nothing: Queue[None] = Queue()

    def pause(seconds: float) -> None:
        with suppress(Empty):
            nothing.get(timeout=seconds)

    if ros2:
        opened = as_ros2(reader, endpoints, start_ns, end_ns, domain=ros2[0], epoch_ns=ros2[1])
    else:
        opened = as_recorded(reader, endpoints, start_ns, end_ns)
    with opened as publication:
        where = ", ".join(endpoints.listen or endpoints.connect)
        say("blue", "bus", f"{publication.pattern} at {where}; waiting for a subscriber")
        if not publication.wait_for_listener(wait):
            raise InputError(f"--wait: no subscriber to {publication.pattern} in {wait:g} s")
        count = publication.publish(speed, pause)
    out.print(f"{count} messages were published")


def what_if(
    reader: Reader,
    plant: list[str],
    algorithm: list[str],
    output: Path | None,
    force: bool,
    allow_fmus: bool,
    compiling: bool = False,
) -> None:
    expect_another(output, Path(reader.path))
    plants = [Change.of("--plant", text) for text in plant]
    algorithms = [Change.of("--algorithm", text) for text in algorithm]
    file, launch, metadata = changed_run(
        reader, plants, algorithms, allow_fmus=allow_fmus, compiling=compiling
    )
    perform(file, output, launch, metadata=metadata, force=force)
