"""Arguments and options that several commands share."""

from collections.abc import Callable
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.numerals import decimal, whole
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.cli.formats import expect_ending

if TYPE_CHECKING:
    from nrs_cosim.orchestrator.scenario.changes import Change
    from nrs_cosim.recordings.mcap.reader import Reader

LONGEST = 2**63 / 1e9
"""s; what the clock can count in ns."""

ScenarioPath = Annotated[
    Path,
    typer.Argument(metavar="SCENARIO", help="A scenario file (TOML); - for standard input."),
]
RecordingPath = Annotated[Path, typer.Argument(metavar="FILE", help="A recording (MCAP).")]


def number(option: str) -> Callable[[str | float], float]:
    """Return what reads an option's text as a finite number."""

    def read(text: str | float) -> float:
        try:
            found = decimal(str(text))
        except ValueError:
            found = inf
        if not isfinite(found):
            raise InputError(f"{option}: expected a number, got {quoted(text)}")
        return found

    return read


def moment(option: str) -> Callable[[str | float], float]:
    """Return what reads an option's text as a simulated time, s."""

    def read(text: str | float) -> float:
        found = number(option)(text)
        if not 0 <= found < LONGEST:
            raise InputError(f"{option}: expected 0 to {LONGEST:g} s, got {quoted(text)}")
        return found

    return read


def whole_number(option: str, least: int, most: float = inf) -> Callable[[str | int], int]:
    """Return what reads an option's text as a whole number from one to another."""

    def read(text: str | int) -> int:
        try:
            found = whole(str(text))
        except ValueError:
            found = least - 1
        if not least <= found <= most:
            upto = f" to {most:g}" if most < inf else " or more"
            raise InputError(
                f"{option}: expected a whole number, {least}{upto}, got {quoted(text)}"
            )
        return found

    return read


def _expect_recording(output: Path | None) -> Path | None:
    if output is not None:
        expect_ending("-o", output, ".mcap")
    return output


def _expect_scenario(output: Path | None) -> Path | None:
    if output is not None:
        expect_ending("-o", output, ".toml")
    return output


Output = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        metavar="FILE.mcap",
        help="Where the recording goes.",
        callback=_expect_recording,
    ),
]
NewRecording = Annotated[
    Path,
    typer.Option(
        "-o",
        "--output",
        metavar="NEW.mcap",
        help="The new recording.",
        callback=_expect_recording,
    ),
]
NewScenario = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        metavar="NEW.toml",
        help="Where the changed scenario goes; in the folder of the files that it names.",
        callback=_expect_scenario,
    ),
]
Force = Annotated[
    bool, typer.Option("--force", help="Replace a recording that is there, once this is complete.")
]
AllowFmus = Annotated[
    bool,
    typer.Option(
        "--allow-fmus", help="Run FMUs that the recording holds (--embed-fmus): native code."
    ),
]
Compile = Annotated[
    bool,
    typer.Option(
        "--compile",
        help="Compile FMUs that have C sources and no library for this machine: native code.",
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="algorithm.alpha=0.8,run.seed=2",
        help="Change keys of the scenario; values are TOML, and {} empties a table. "
        "robots=2,KEY=VALUE changes robot 2 alone. May be given again.",
    ),
]


def changes_of(texts: list[str] | None) -> "list[Change]":
    """Return what `--set` changes; without any nothing is loaded that edits TOML."""
    if not texts:
        return []
    from nrs_cosim.orchestrator.scenario.changes import Change  # noqa: PLC0415, it loads tomlkit

    return [Change.of("--set", text) for text in texts]


Compressed = Annotated[
    Literal["zstd", "lz4", "none"],
    typer.Option("--compression", help="Of the recording's chunks."),
]

_PANEL = "Beyond this machine"

Listen = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ENDPOINT",
        rich_help_panel=_PANEL,
        help="Where workers meet, such as tls/0.0.0.0:7447; may be given again.",
    ),
]
Connect = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ENDPOINT",
        rich_help_panel=_PANEL,
        help="Where to meet, such as tls/lab.example:7447; may be given again.",
    ),
]
InsecureTcp = Annotated[
    bool,
    typer.Option(
        "--insecure-tcp",
        rich_help_panel=_PANEL,
        help="Allow plain TCP, which anyone who reaches the port may read and write.",
    ),
]
TlsCa = Annotated[
    Path | None,
    typer.Option(
        "--tls-ca",
        metavar="FILE.pem",
        rich_help_panel=_PANEL,
        help="Certificate of the authority that all workers of a run share.",
    ),
]
TlsCertificate = Annotated[
    Path | None,
    typer.Option(
        "--tls-certificate",
        metavar="FILE.pem",
        rich_help_panel=_PANEL,
        help="Own certificate; its common name is the worker's name.",
    ),
]
TlsKey = Annotated[
    Path | None,
    typer.Option(
        "--tls-key",
        metavar="FILE.pem",
        rich_help_panel=_PANEL,
        help="Private key of the certificate, without a passphrase.",
    ),
]
Workers = Annotated[
    str | None,
    typer.Option(
        metavar="N|auto",
        help="Spread the robots over N processes of this machine; auto: as many as are worth it.",
    ),
]
Threads = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        parser=whole_number("--threads", 1),
        help="Step bundled FMUs, and others where `plant.threads` lets it, with N threads of each "
        "process; by default as many as are worth it.",
    ),
]
ThreadsOfWorker = Annotated[
    int,
    typer.Option(
        metavar="N",
        parser=whole_number("--threads", 1),
        help="Step bundled FMUs, and others where `plant.threads` lets it, with N threads.",
    ),
]
Expect = Annotated[
    int,
    typer.Option(
        metavar="N",
        parser=whole_number("--expect", 1),
        rich_help_panel=_PANEL,
        help="How many workers share the robots, where they do not name their robots.",
    ),
]
WAIT = 300.0
"""s"""
Wait = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        parser=number("--wait"),
        rich_help_panel=_PANEL,
        show_default=f"{WAIT:g}",
        help="How long to wait for one another, at the start or after a link was lost.",
    ),
]
Deadline = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        parser=number("--deadline"),
        help="End the run after so long without a message; by default the scenario's bus.deadline.",
    ),
]
NoRestart = Annotated[bool, typer.Option("--no-restart", help="End the run when a worker is lost.")]
ShowProfile = Annotated[bool, typer.Option("--profile", help="Show where the time went.")]
Realtime = Annotated[
    float | None,
    typer.Option(
        metavar="X",
        parser=number("--realtime"),
        help="Let simulated time pass at most X times as fast as wall time.",
    ),
]
ShowLive = Annotated[
    bool, typer.Option("--live", help="Serve a page of the run, on this machine, as it goes on.")
]
Epoch = Annotated[
    int,
    typer.Option(
        metavar="SECONDS",
        parser=whole_number("--epoch", 0, 2**31 - 1),
        help="When t = 0 is, s since 1970; ROS takes a clock at 0 for one that stands.",
    ),
]


def epoch_ns_of(epoch: int, reader: "Reader") -> int:
    """Return an epoch in ns; `InputError` where a recording has times that ROS has no stamp for."""
    from nrs_cosim.bus.clock import NS_PER_S  # noqa: PLC0415, as the next: NumPy comes with it
    from nrs_cosim.recordings.ros2.cdr import LATEST_NS  # noqa: PLC0415

    if epoch * NS_PER_S + (reader.end_ns or 0) >= LATEST_NS:
        raise InputError(
            f"--epoch {epoch}: the recording would end after the last stamp of ROS, in 2038"
        )
    return epoch * NS_PER_S


ShowFoxglove = Annotated[
    bool,
    typer.Option(
        "--foxglove",
        help="Serve it to Foxglove, on this machine: ws://127.0.0.1, to watch robots and plots.",
    ),
]
Port = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        parser=whole_number("--port", 0, 65535),
        help="The port to serve at; any free one unless given.",
    ),
]
Stay = Annotated[
    bool,
    typer.Option("--stay", help="With --live, --foxglove: serve it until Ctrl-C after the run."),
]

OfRobots = Annotated[
    str | None, typer.Option("--robots", metavar="1-3,7", help="Which robots; all unless given.")
]
OfJoints = Annotated[
    str | None,
    typer.Option(
        "--joints", metavar="1-3,NAME", help="Which joints, by number or name; all unless given."
    ),
]
Since = Annotated[
    float | None,
    typer.Option(
        "--from",
        metavar="T",
        parser=moment("--from"),
        help="Begin with messages of this simulated time, s.",
    ),
]
Until = Annotated[
    float | None,
    typer.Option(
        "--until",
        metavar="T",
        parser=moment("--until"),
        help="End before messages of this simulated time, s.",
    ),
]
ReportFile = Annotated[
    Path,
    typer.Option(
        "-o",
        "--output",
        metavar="FILE",
        help="Where the report goes; .html is a page, .pdf, .png and .svg are its figures.",
    ),
]
