"""What is done with a recording: `info`, `export`, `recover`, `scene`."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from nrs_cosim.bus.errors import InputError, MissingExtraError
from nrs_cosim.orchestrator.cli.options import (
    NewRecording,
    OfJoints,
    OfRobots,
    RecordingPath,
    Since,
    Until,
)
from nrs_cosim.orchestrator.terminal import AsJson, err, out, print_json, say

if TYPE_CHECKING:
    from nrs_cosim.recordings.export.selection import Selected
    from nrs_cosim.recordings.mcap.reader import Reader

    Write = Callable[[Reader, Selected], list[Path]]


def info(
    recording: RecordingPath,
    as_json: AsJson = False,
    verifying: Annotated[
        bool,
        typer.Option(
            "--verify",
            help="Compute digest, errors and theory anew; do not take them as stored.",
        ),
    ] = False,
) -> None:
    """Summarise a recording, also one that was cut or never closed.

    What a run stored at its end is taken where every checksum of the file agrees.
    """
    from nrs_cosim.orchestrator.analysis.results import Result, wrong_theory
    from nrs_cosim.orchestrator.cli.comparison_text import theory_comparison
    from nrs_cosim.orchestrator.cli.progress import reading
    from nrs_cosim.orchestrator.cli.tables import grid
    from nrs_cosim.orchestrator.engine.link_summary import wrong_links
    from nrs_cosim.orchestrator.engine.summary import experiment_of, wrong_measurement
    from nrs_cosim.recordings.mcap.reader import Reader

    with (
        reading(err) as follow,
        Reader(recording, verify=verifying, watch=follow(recording)) as reader,
    ):
        result = Result.of(reader, experiment := experiment_of(reader))
        wrong = (
            wrong_measurement(reader, result.measured),
            wrong_links(reader, experiment, result.described["links"]),
            wrong_theory(reader, experiment, result.theory),
        )
        reader.damage += filter(None, wrong)
    if as_json:
        print_json(result.as_json())
        return
    grid(out, result.lines())
    theory_comparison(out, result.theory)
    for damage in reader.damage:
        say("yellow", "damage", damage)


_BY_ENDING: dict[str, Literal["nc", "ssp"]] = {".nc": "nc", ".ssp": "ssp"}
"""What a recording is exported to as one file; the rest are tables in a folder."""


def export(
    recording: RecordingPath,
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR|FILE.nc|FILE.ssp",
            help="Where the tables, or the file, go.",
        ),
    ],
    form: Annotated[
        Literal["csv", "parquet", "mat", "nc", "ssp"] | None,
        typer.Option(
            "--format",
            "--to",
            help="mat is MATLAB's; nc is netCDF-4; parquet and nc need the extra `analysis`; ssp "
            "is a system of FMUs. By default what -o ends in, .nc or .ssp; else csv.",
        ),
    ] = None,
    robots: OfRobots = None,
    joints: OfJoints = None,
    since: Since = None,
    until: Until = None,
) -> None:
    """Write a recording's samples, states and link events as tables, or its run as a system.

    A system (SSP 1.0) has an FMU for each robot and one for the target, for other engines to run,
    and what they must come to; it is of the whole run.
    """
    from nrs_cosim.bus.clock import NS_PER_S
    from nrs_cosim.orchestrator.cli.progress import reading
    from nrs_cosim.orchestrator.scenario.robot_ids import parse_joints, parse_robots
    from nrs_cosim.recordings.export.selection import Selected
    from nrs_cosim.recordings.mcap.reader import Reader
    from nrs_cosim.recordings.schemas import about

    by_name = None if output.is_dir() else _BY_ENDING.get(output.suffix.lower())
    kind = form or by_name or "csv"
    asked = {"--robots": robots, "--joints": joints, "--from": since, "--until": until}
    if kind == "ssp":
        if given := [option for option, value in asked.items() if value is not None]:
            raise InputError(f"{given[0]}: a system is of the whole run; leave it out")
        _export_system(recording, output)
        return
    write = _netcdf(output) if kind == "nc" else _tables(output, kind)
    with reading(err) as follow, Reader(recording, watch=follow(recording)) as reader:
        reader.expect_ticks("export")
        run = about(reader).run
        names = [[joint.name for joint in group.joints] for group in run.plants]
        selection = Selected(
            None if robots is None else parse_robots(robots, "--robots", run.robots),
            None if joints is None else parse_joints(joints, "--joints", run.joints, names),
            *(None if t is None else round(t * NS_PER_S) for t in (since, until)),
        )
        written = write(reader, selection)
    for path in written:
        out.print(str(path), markup=False)
    for damage in reader.damage:
        say("yellow", "damage", damage)


def _tables(output: Path, form: Literal["csv", "parquet", "mat"]) -> "Write":
    from nrs_cosim.orchestrator.cli.formats import expect_folder_name
    from nrs_cosim.orchestrator.cli.output_paths import expect_folder
    from nrs_cosim.recordings.export.formats import export, older_tables

    expect_folder_name("-o", output)
    expect_folder(output)

    def write(reader: "Reader", selection: "Selected") -> list[Path]:
        older = older_tables(output, form)
        written = export(reader, output, form, selection)
        for path in older:
            if not path.exists():
                say("yellow", "removed", f"{path}, of another recording: this one has no such rows")
        return written

    return write


def _netcdf(output: Path) -> "Write":
    from nrs_cosim.orchestrator.cli.formats import expect_ending
    from nrs_cosim.orchestrator.cli.output_paths import expect_replaceable, make_folder

    try:
        from nrs_cosim.recordings.export.netcdf import write_netcdf
    except ImportError:
        raise MissingExtraError("--to nc: needs h5netcdf", "analysis") from None
    expect_ending("-o", output, ".nc")
    expect_replaceable(output, "netCDF", b"\x89HDF")

    def write(reader: "Reader", selection: "Selected") -> list[Path]:
        make_folder(output)
        write_netcdf(reader, output, selection)
        return [output]

    return write


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
        system = system_of(experiment, reader.ticks)  # samples may not have what answers are of
        table = answers(reader, experiment)
        for damage in reader.damage:
            say("yellow", "damage", f"{damage}; the system is of {reader.ticks} ticks")
    with stages(err) as begin:
        begin("building FMUs")
        packed = ssp_bytes(system, table)
    make_folder(output)
    try:
        output.write_bytes(packed)
    except OSError as error:
        raise InputError(f"{output}: cannot be written: {error.strerror}") from None
    out.print(str(output), markup=False)


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


def scene(
    recording: RecordingPath,
    output: NewRecording,
) -> None:
    """Add the robots to a copy of a recording, in 3D, for Foxglove, and a layout beside it."""
    from nrs_cosim.orchestrator.cli.output_paths import expect_replaceable, make_folder
    from nrs_cosim.orchestrator.cli.progress import reading
    from nrs_cosim.orchestrator.engine.summary import experiment_of
    from nrs_cosim.recordings.mcap.reader import Reader
    from nrs_cosim.recordings.robots.placed import shown_robots

    try:
        from nrs_cosim.recordings.export.scene import write_scene
        from nrs_cosim.recordings.export.scene_layout import scene_layout
    except ImportError:
        raise MissingExtraError("a scene needs foxglove-schemas-protobuf", "scene") from None
    layout = output.with_suffix(".layout.json")
    with reading(err) as follow, Reader(recording, watch=follow(recording)) as reader:
        reader.expect_ticks("show")
        experiment, shown = experiment_of(reader), shown_robots(reader)
        make_folder(output)
        expect_replaceable(layout, "layout", b'{"configById"')
        write_scene(reader, output, shown, experiment.target_at)
        reach = max(abs(robot.y) + robot.description.reach for robot in shown) or 20.0
        events = any(topic.endswith("/link_event") for topic in reader.topics.values())
        made = scene_layout(range(1, experiment.n + 1), reach, events=events)
        layout.write_text(json.dumps(made) + "\n", "utf-8")
        for damage in reader.damage:
            say("yellow", "damage", damage)
    out.print(str(output), markup=False)
    say("blue", "layout", f"{layout}: import it in Foxglove, and it shows all at once")
