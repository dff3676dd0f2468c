"""The command `nrs`: every error is shown here once, and decides the exit status.

0 done; 1 the run failed, with who and when; 2 the input is bad, with the field and the value;
130 interrupted, with the recording closed and valid.
"""

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib.metadata import version as installed
from math import isfinite, nan
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Literal

import numpy as np
import typer
from rich.markup import escape

from bus.errors import CosimError, InputError
from orchestrator import showing
from orchestrator.checking import check as check_scenario
from orchestrator.clock import seconds
from orchestrator.errors import Interrupted
from orchestrator.places import place_for
from orchestrator.plants import group_by_archive, open_fleet
from orchestrator.running import run as run_scenario
from orchestrator.scenario import json_schema
from orchestrator.scenario_file import read_scenario
from orchestrator.setting import bodies, clock_of
from orchestrator.summary import describe, lines, measure
from plant_fmu.archives.archive import find_archive
from plant_fmu.bundled.building import write as write_fmu
from plant_fmu.bundled.declaration import bundled_models, declaration
from plant_fmu.bundled.urdf import read_urdf
from plant_fmu.bundled.urdf_fmu import GRAVITY, write_urdf
from recordings.export import export_csv
from recordings.reading import Reader

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
EXIT = {"completed": DONE, "failed": FAILED, "interrupted": INTERRUPTED}

app = typer.Typer(
    name="nrs",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
fmu = typer.Typer(no_args_is_help=True, help="The robots' dynamics as FMUs.")
app.add_typer(fmu, name="fmu")

out = showing.Terminal(soft_wrap=True, highlight=False, emoji=False)
err = showing.Terminal(soft_wrap=True, highlight=False, emoji=False, stderr=True)

ScenarioPath = Annotated[Path, typer.Argument(metavar="SCENARIO", help="A scenario file (TOML).")]
RecordingPath = Annotated[Path, typer.Argument(metavar="FILE", help="A recording (MCAP).")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def _print_version(asked: bool) -> None:
    if asked:
        out.print(f"nrs-cosim {installed('nrs-cosim')}")
        raise typer.Exit


@app.callback()
def nrs(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version, help="Print the version."
        ),
    ] = False,
) -> None:
    """Co-simulate networked robots under sampled interaction."""


@app.command()
def run(
    scenario: ScenarioPath,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE.mcap", help="Where the recording goes."),
    ] = None,
    compression: Annotated[
        Literal["zstd", "lz4", "none"], typer.Option(help="Of the recording's chunks.")
    ] = "zstd",
) -> None:
    """Run a scenario and record all that was said."""
    file = read_scenario(scenario)
    for warning in check_scenario(file.scenario).warnings():
        _say("yellow", "warning", warning)
    clock = clock_of(file.scenario)
    with (
        place_for(output, file.name) as path,
        _signals() as stopped,
        showing.progress(err, clock) as show,
    ):

        def watch(time_ns: int) -> None:
            show(seconds(time_ns))
            if stopped():
                raise Interrupted

        outcome = run_scenario(file, path, compression=compression, watch=watch)
    with Reader(path) as reader:
        told = lines(describe(reader), measure(reader))
    simulated, took = seconds(clock.t(outcome.ticks)), outcome.wall_seconds
    told["ticks"] += f" in {took:.2f} s, {simulated / took:.3g} x real time"
    showing.summary(out, told)
    if outcome.status == "failed":
        _say("red", "failed", outcome.reason)
    raise typer.Exit(EXIT[outcome.status])


@app.command()
def info(recording: RecordingPath, as_json: AsJson = False) -> None:
    """Say what a recording holds; also of one that was cut or never closed."""
    with Reader(recording) as reader:
        told = describe(reader)
        if as_json:
            _print_json(told)
        else:
            showing.summary(out, lines(told, measure(reader)))
            for damage in reader.damage:
                _say("yellow", "damage", damage)


@app.command()
def export(
    recording: RecordingPath,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Where the tables go.")
    ],
) -> None:
    """Write a recording's samples and states as CSV tables."""
    with Reader(recording) as reader:
        for path in export_csv(reader, output):
            out.print(str(path), markup=False)
        for damage in reader.damage:
            _say("yellow", "damage", damage)


@app.command()
def check(scenario: ScenarioPath, as_json: AsJson = False) -> None:
    """Say what the theory promises for a scenario, and whether its plants can be opened."""
    file = read_scenario(scenario)
    checked = check_scenario(file.scenario)
    with ExitStack() as stack:
        groups = group_by_archive(file.scenario, file.folder)
        open_fleet(stack, groups, bodies(file.scenario))
    if as_json:
        _print_json(checked.as_json())
    else:
        showing.check(out, checked)


@app.command()
def schema() -> None:
    """Print the JSON schema of scenario files, for editors."""
    _print_json(json_schema())


@fmu.command("list")
def fmu_list() -> None:
    """List the bundled models."""
    for name in bundled_models():
        out.print(f"{name:<16}{declaration(name).description}", markup=False)


@fmu.command("info")
def fmu_info(
    name: Annotated[str, typer.Argument(metavar="FMU", help="A bundled model, or an .fmu file.")],
    as_json: AsJson = False,
) -> None:
    """Say what an FMU offers."""
    told = find_archive(name, Path()).told()
    if as_json:
        _print_json(told)
    else:
        showing.archive(out, told)


@fmu.command("build")
def fmu_build(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A bundled model.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE.fmu", help="Where the FMU goes.")
    ],
    fmi: Annotated[int, typer.Option(help="The FMI version, 2 or 3.")] = 3,
) -> None:
    """Write a bundled model as an FMU."""
    write_fmu(name, fmi, output)
    out.print(str(output), markup=False)


@fmu.command("from-urdf")
def fmu_from_urdf(
    urdf: Annotated[Path, typer.Argument(metavar="URDF", help="A robot with a fixed base.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE.fmu", help="Where the FMU goes.")
    ],
    fmi: Annotated[int, typer.Option(help="The FMI version, 2 or 3.")] = 3,
    gravity: Annotated[
        str, typer.Option(metavar="X,Y,Z", help="In m/s2, in the frame of the base link.")
    ] = ",".join(map("{:g}".format, GRAVITY)),
) -> None:
    """Write the rigid-body dynamics of a URDF's joints as an FMU."""
    robot = read_urdf(urdf)
    for warning in robot.warnings():
        _say("yellow", "warning", f"{urdf}: {warning}")
    write_urdf(robot, fmi, _three_numbers("--gravity", gravity), output)
    out.print(str(output), markup=False)


def main() -> None:
    """Run the command line and exit with its status."""
    np.seterr(all="ignore")  # what is not finite is looked for and named, not warned of
    try:
        app()
    except OSError as error:
        _say("red", "error", str(error))
        raise SystemExit(FAILED) from None
    except CosimError as error:
        _say("red", "error", str(error))
        raise SystemExit(BAD_INPUT if isinstance(error, InputError) else FAILED) from None


@contextmanager
def _signals() -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C or SIGTERM into a question with the answer yes; the second ends all."""
    stopped = False

    def stop(number: int, _frame: FrameType | None) -> None:
        nonlocal stopped
        stopped = True
        signal.signal(number, signal.default_int_handler)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _three_numbers(option: str, text: str) -> tuple[float, float, float]:
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        x = y = z = nan
    if not isfinite(x + y + z):
        raise InputError(f"{option}: expected three numbers like 0,0,-9.8, got {text!r}")
    return x, y, z


def _say(colour: str, kind: str, text: str) -> None:
    err.print(f"[{colour}]{kind}:[/] {escape(text)}")


def _print_json(value: Any) -> None:
    out.print(json.dumps(value, indent=2), markup=False)
