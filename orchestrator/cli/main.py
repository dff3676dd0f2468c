"""The command `nrs`: every error is shown here once, and decides the exit status.

0 done; 1 the run failed, with who and when; 2 the input is bad, with the field and the value;
130 interrupted, with the recording closed and valid.

The modules `main` and `*_commands` declare commands and their options; what one does is loaded when
it is called, for a user waits for all that is loaded.
"""

import gc
import logging
from contextlib import ExitStack
from errno import ENAMETOOLONG
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from nrs_cosim.bus.errors import CosimError, InputError, MissingExtraError
from nrs_cosim.orchestrator.cli import replay_commands, run_commands
from nrs_cosim.orchestrator.cli.convert_commands import convert
from nrs_cosim.orchestrator.cli.design_commands import design
from nrs_cosim.orchestrator.cli.fmu_commands import fmu
from nrs_cosim.orchestrator.cli.group import Commands
from nrs_cosim.orchestrator.cli.option_groups import TlsOptions, with_groups
from nrs_cosim.orchestrator.cli.option_rules import OptionRules
from nrs_cosim.orchestrator.cli.options import (
    Compile,
    Listen,
    NewRecording,
    NewScenario,
    RecordingPath,
    ScenarioPath,
    Set,
    changes_of,
)
from nrs_cosim.orchestrator.cli.report_commands import report
from nrs_cosim.orchestrator.cli.study_commands import study, sweep
from nrs_cosim.orchestrator.exit_status import BAD_INPUT, DONE, FAILED
from nrs_cosim.orchestrator.logs import Level, log_to_standard_error
from nrs_cosim.orchestrator.terminal import AsJson, Warnings, err, out, print_json, say

COLLECTED = 100_000
"""New objects between searches for garbage: what is loaded stays, and is not searched each time."""

app = typer.Typer(
    name="nrs",
    cls=Commands,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},  # of every command below as well
    pretty_exceptions_enable=False,
)
app.add_typer(fmu, name="fmu")
app.add_typer(study, name="study")


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version as installed

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
    log_level: Annotated[
        Level | None,
        typer.Option(
            help="Log workers, their coordinator and the live page to standard error, with times."
        ),
    ] = None,
) -> None:
    """Co-simulate networked robots under sampled interaction."""
    import numpy as np

    if log_level:
        log_to_standard_error(log_level)

    np.seterr(all="ignore")  # what is not finite is looked for and named, not warned of


app.command()(run_commands.run)
app.command()(run_commands.resume)
app.command()(run_commands.worker)
app.command()(replay_commands.replay)
app.command()(replay_commands.diff)
app.command()(report)
app.command()(convert)
app.command()(design)
app.command()(sweep)


@app.command()
def info(recording: RecordingPath, as_json: AsJson = False) -> None:
    """Summarise a recording, also one that was cut or never closed."""
    from nrs_cosim.orchestrator.analysis.results import Result
    from nrs_cosim.orchestrator.cli import summary_text
    from nrs_cosim.orchestrator.cli.progress import reading
    from nrs_cosim.orchestrator.cli.tables import grid
    from nrs_cosim.orchestrator.engine.summary import experiment_of
    from nrs_cosim.recordings.mcap.reader import Reader

    with reading(err) as follow, Reader(recording, watch=follow(recording)) as reader:
        result = Result.of(reader, experiment_of(reader))
    if as_json:
        print_json(result.as_json())
        return
    grid(out, result.lines())
    summary_text.theory_comparison(out, result.theory)
    for damage in reader.damage:
        say("yellow", "damage", damage)


@app.command()
def export(
    recording: RecordingPath,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="DIR|FILE.ssp", help="Where the tables, or the system, go."
        ),
    ],
    form: Annotated[
        Literal["csv", "parquet", "mat", "ssp"],
        typer.Option(
            "--format",
            "--to",
            help="mat is MATLAB's; parquet needs the extra `analysis`; ssp is a system of FMUs.",
        ),
    ] = "csv",
) -> None:
    """Write a recording's samples, states and link events as tables, or its run as a system.

    A system (SSP 1.0) has an FMU for each robot and one for the target, for other engines to run,
    and what they must come to.
    """
    if form == "ssp":
        _export_system(recording, output)
    else:
        _export_tables(recording, output, form)


def _export_tables(recording: Path, output: Path, form: Literal["csv", "parquet", "mat"]) -> None:
    from nrs_cosim.orchestrator.cli.formats import expect_folder_name
    from nrs_cosim.orchestrator.cli.output_paths import expect_folder
    from nrs_cosim.orchestrator.cli.progress import reading
    from nrs_cosim.recordings.export.formats import export as tables
    from nrs_cosim.recordings.mcap.reader import Reader

    expect_folder_name("-o", output)
    expect_folder(output)
    with reading(err) as follow, Reader(recording, watch=follow(recording)) as reader:
        written = tables(reader, output, form)
    for path in written:
        out.print(str(path), markup=False)
    for damage in reader.damage:
        say("yellow", "damage", damage)


def _export_system(recording: Path, output: Path) -> None:
    from nrs_cosim.orchestrator.cli.formats import expect_ending
    from nrs_cosim.orchestrator.cli.output_paths import expect_replaceable, make_folder
    from nrs_cosim.orchestrator.cli.progress import reading, stages
    from nrs_cosim.orchestrator.engine.summary import experiment_of
    from nrs_cosim.orchestrator.export.answers import answers
    from nrs_cosim.orchestrator.export.package import ssp_bytes
    from nrs_cosim.orchestrator.export.system import system_of
    from nrs_cosim.recordings.mcap.reader import Reader

    expect_ending("-o", output, ".ssp")
    expect_replaceable(output, "SSP", b"PK")
    with reading(err) as follow, Reader(recording, watch=follow(recording)) as reader:
        reader.expect_ticks("export")
        experiment = experiment_of(reader)
        table, ticks = answers(reader, experiment), reader.ticks
    with stages(err) as begin:
        begin("building FMUs")
        packed = ssp_bytes(system_of(experiment, ticks), table)
    make_folder(output)
    try:
        output.write_bytes(packed)
    except OSError as error:
        raise InputError(f"{output}: cannot be written: {error.strerror}") from None
    out.print(str(output), markup=False)


@app.command()
def recover(
    recording: RecordingPath,
    output: NewRecording,
) -> None:
    """Write a valid recording of all that a damaged one still holds, and report what is missing."""
    from nrs_cosim.orchestrator.cli.output_paths import make_folder
    from nrs_cosim.orchestrator.cli.progress import reading
    from nrs_cosim.orchestrator.cli.tables import grid
    from nrs_cosim.orchestrator.engine.summary import describe, experiment_of, lines, measure
    from nrs_cosim.recordings.mcap.copy import recover as whole
    from nrs_cosim.recordings.mcap.reader import Reader

    with (
        reading(err) as follow,
        Reader(recording, verify=True, watch=follow(recording)) as reader,
    ):
        experiment = experiment_of(reader)  # or nothing could be done with what is recovered
        make_folder(output)
        whole(reader, output)
        for damage in reader.damage:
            say("yellow", "damage", damage)
    with reading(err) as follow, Reader(output, watch=follow(output)) as reader:
        rows = lines(describe(reader, experiment), measure(reader, experiment))
    grid(out, rows)


@app.command()
def scene(
    recording: RecordingPath,
    output: NewRecording,
) -> None:
    """Add the robots whose URDF is known to a copy of a recording, in 3D, for Foxglove."""
    from nrs_cosim.orchestrator.cli.output_paths import make_folder
    from nrs_cosim.orchestrator.cli.progress import reading
    from nrs_cosim.recordings.mcap.reader import Reader
    from nrs_cosim.recordings.robots.placed import placed_robots
    from nrs_cosim.recordings.schemas import expect_joints, recorded_types

    try:
        from nrs_cosim.recordings.export.scene import write_scene
    except ImportError:
        raise MissingExtraError("a scene needs foxglove-schemas-protobuf", "scene") from None
    with reading(err) as follow, Reader(recording, watch=follow(recording)) as reader:
        reader.expect_ticks("show")
        expect_joints(reader, recorded_types(reader))
        placed = placed_robots(reader)
        if not placed:
            raise InputError(f"{recording}: has a URDF of no robot, so their looks are unknown")
        make_folder(output)
        write_scene(reader, output, placed)
        for damage in reader.damage:
            say("yellow", "damage", damage)
    out.print(str(output), markup=False)
    say("blue", "scene", "open it in Foxglove: a 3D panel shows /scene and /tf in the frame world")


@app.command()
@OptionRules(
    {
        "--worst-target": ("--output",),
        "--output": ("--worst-target",),
        "--figure": ("--over",),
    },
    [("--over", other) for other in ("--worst-target", "--strict", "--compile")],
)
def check(
    scenario: ScenarioPath,
    as_json: AsJson = False,
    changes: Set = None,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="Exit with status 1 when a condition or convergence is violated or unknown.",
        ),
    ] = False,
    worst_target: Annotated[
        bool,
        typer.Option(
            "--worst-target",
            help="Write the scenario with the target, within gamma_1 and gamma_2, that attains the "
            "worst case.",
        ),
    ] = False,
    output: NewScenario = None,
    compiling: Compile = False,
    over: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUES",
            help="An axis of a map of the spectral radius, as of nrs sweep; two are given, and no "
            "plant is opened.",
        ),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the map: .png, .pdf or .svg.")
    ] = None,
) -> None:
    """Show what theory proves of a scenario, and whether its plants can be opened."""
    if over:
        from nrs_cosim.orchestrator.cli.map_text import show_map

        show_map(scenario, changes_of(changes), over, figure, as_json)
        return
    from nrs_cosim.orchestrator.analysis.bounds import bounds, ultimate_bounds
    from nrs_cosim.orchestrator.analysis.conclusion import theory_json
    from nrs_cosim.orchestrator.analysis.conditions import check as theory_of
    from nrs_cosim.orchestrator.analysis.plant_samples import Sampling
    from nrs_cosim.orchestrator.cli import summary_text
    from nrs_cosim.orchestrator.cli.progress import stages
    from nrs_cosim.orchestrator.cli.theory_text import unmet as unmet_of
    from nrs_cosim.orchestrator.engine.plants import (
        group_by_archive,
        naming_field,
        open_fleet,
        with_compiled_fmus,
    )
    from nrs_cosim.orchestrator.engine.units import mixed_units
    from nrs_cosim.orchestrator.scenario.file import read_scenario, scenario_name

    experiment = read_scenario(scenario, changes_of(changes))
    with stages(err) as begin:
        begin("opening the plants")
        with naming_field(scenario_name(scenario)), ExitStack() as stack:
            if compiling:
                experiment = with_compiled_fmus(experiment)
            groups = group_by_archive(experiment)
            open_fleet(stack, groups, experiment.bodies())
            if mixed := mixed_units(experiment):
                say("yellow", "warning", mixed)
        find = Sampling(experiment)
        begin("whether the estimates converge")
        checked = theory_of(experiment, find)
        begin("bounds of the steady state")
        ultimate = ultimate_bounds(experiment, checked.rho, find)
        for part in ultimate.stiff:
            say("yellow", "warning", part.sentence())
        if worst_target and output:
            from nrs_cosim.orchestrator.analysis.worst_scenario import worst_target_changes
            from nrs_cosim.orchestrator.cli.scenario_files import changed_text, write_scenario

            begin("the worst target")
            changed = worst_target_changes(experiment, ultimate)
            write_scenario(output, experiment, changed_text(experiment, changed, "--worst-target"))
    if as_json:
        print_json(theory_json(checked, ultimate))
    else:
        summary_text.theory_table(out, checked, ultimate, bounds(ultimate))
    _end_strictly(unmet_of(checked, ultimate) if strict else [])


def _end_strictly(unmet: list[str]) -> None:
    """Exit with status 1 where something is violated or unknown, and say what."""
    for line in unmet:
        say("red", "strict", line)
    raise typer.Exit(FAILED if unmet else DONE)


@app.command()
@with_groups
def doctor(*, listen: Listen = None, tls: TlsOptions, as_json: AsJson = False) -> None:
    """Test all that a run needs of this machine, and report what to do where something fails."""
    from nrs_cosim.orchestrator.cli import summary_text
    from nrs_cosim.orchestrator.cli.doctor import diagnose
    from nrs_cosim.orchestrator.cli.progress import stages

    with stages(err) as begin:
        made = diagnose(listen or [], tls.certificates(), begin)
    if as_json:
        print_json(made.as_json())
    else:
        summary_text.diagnosis(out, made)
    raise typer.Exit(DONE if made.fit else FAILED)


@app.command()
@OptionRules({"--messages": ("--output",), "--output": ("--messages",)})
def schema(
    messages: Annotated[
        bool,
        typer.Option("--messages", help="Write the .proto files of the messages of a run instead."),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Where the .proto files go."),
    ] = None,
) -> None:
    """Print the JSON schema of scenario files, for editors."""
    if messages and output:
        from nrs_cosim.orchestrator.cli.message_files import write_messages

        for path in write_messages(output):
            out.print(str(path), markup=False)
        return
    from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema

    print_json(json_schema())


@cache  # a command line in this process is followed by others
def command() -> Any:
    """Return all commands, with their options."""
    return typer.main.get_command(app)


def main() -> None:
    """Run the command line and exit with its status."""
    gc.set_threshold(COLLECTED)
    logging.getLogger("nrs").handlers = [Warnings(logging.WARNING)]
    try:
        command()()
    except OSError as error:
        say("red", "error", str(error))
        raise SystemExit(BAD_INPUT if error.errno == ENAMETOOLONG else FAILED) from None
    except (RuntimeError, MemoryError) as error:
        if isinstance(error, RuntimeError) and str(error) != "can't start new thread":
            raise
        said = str(error) or "out of memory"
        say("red", "error", f"{said}: raise the limit: `ulimit -u`, `ulimit -v`, or a container's")
        raise SystemExit(FAILED) from None
    except CosimError as error:
        say("red", "error", str(error))
        raise SystemExit(BAD_INPUT if isinstance(error, InputError) else FAILED) from None
