"""`nrs fmu`: the robots' dynamics as FMUs, listed, looked into, checked and written."""

import re
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.numerals import decimal
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.cli.formats import expect_ending
from nrs_cosim.orchestrator.cli.options import (
    Compile,
    ScenarioPath,
    Set,
    changes_of,
    number,
    whole_number,
)
from nrs_cosim.orchestrator.exit_status import DONE, FAILED
from nrs_cosim.orchestrator.terminal import AsJson, err, out, print_json, say

if TYPE_CHECKING:
    from nrs_cosim.plant_fmu.archives.archive import Archive
    from nrs_cosim.plant_fmu.checking.findings import CheckTask

LEAST = 1e-6
"""Of a speed and a frequency that a robot may have, and the inverse of the largest."""
_STIFF_TOO = {"alone", "resumed"}
"""What a robot fails as well that is only costly to step: with links of grams, and damping."""

Fmi = Annotated[
    int,
    typer.Option(metavar="N", parser=whole_number("--fmi", 2, 3), help="The FMI version, 2 or 3."),
]


def _expect_fmu(output: Path) -> Path:
    expect_ending("-o", output, ".fmu")
    return output


FmuOutput = Annotated[
    Path,
    typer.Option(
        "-o",
        "--output",
        metavar="FILE.fmu",
        help="Where the FMU goes.",
        callback=_expect_fmu,
    ),
]

fmu = typer.Typer(
    name="fmu", add_completion=False, no_args_is_help=True, help="The robots' dynamics as FMUs."
)


@fmu.command("list")
def fmu_list() -> None:
    """List the bundled models."""
    from nrs_cosim.orchestrator.cli.tables import grid
    from nrs_cosim.plant_fmu.bundled.declaration import bundled_models, declaration

    grid(out, {name: declaration(name).description for name in bundled_models()}, 15)


@fmu.command("info")
def fmu_info(
    name: Annotated[str, typer.Argument(metavar="FMU", help="A bundled model, or an .fmu file.")],
    as_json: AsJson = False,
) -> None:
    """Describe what an FMU offers."""
    from nrs_cosim.orchestrator.cli import fmu_description
    from nrs_cosim.plant_fmu.archives.archive import look_up

    description = look_up(name, Path()).describe()
    if as_json:
        print_json(description)
    else:
        fmu_description.show_description(out, description)


@fmu.command("check")
def fmu_check(
    name: Annotated[str, typer.Argument(metavar="FMU", help="A bundled model, or an .fmu file.")],
    scenario: Annotated[
        Path | None,
        typer.Option(metavar="SCENARIO", help="Whose robot 1 has the FMU, as the scenario says."),
    ] = None,
    variables: Annotated[
        str | None,
        typer.Option(
            metavar='q="phi",qd="w"',
            help="What the FMU has for q, qd, tau …, as in a scenario's plant.variables.",
        ),
    ] = None,
    compiling: Compile = False,
    as_json: AsJson = False,
) -> None:
    """Check whether an FMU can be a robot: what it offers, and how it moves."""
    from nrs_cosim.orchestrator.cli import summary_text
    from nrs_cosim.orchestrator.cli.progress import stages
    from nrs_cosim.plant_fmu.archives.archive import find_archive, look_up
    from nrs_cosim.plant_fmu.archives.compilation import compiled
    from nrs_cosim.plant_fmu.checking.subprocess_check import check

    archive = compiled(look_up(name, Path())) if compiling else find_archive(name, Path())
    task = check_task(archive, scenario, variables)
    with stages(err) as begin:
        checked = check(task, tell=begin)
    if as_json:
        print_json(checked.as_json())
    else:
        summary_text.fmu_findings(out, checked)
    raise typer.Exit(DONE if checked.passes else FAILED)


@fmu.command("build")
def fmu_build(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A bundled model.")],
    output: FmuOutput,
    fmi: Fmi = 3,
    platforms: Annotated[
        list[str] | None,
        typer.Option(
            "--platform",
            metavar="NAME,NAME",
            help="Of linux64, win64, darwin64, and with FMI 3 aarch64-linux and aarch64-darwin; "
            "compiled by zig (the extra `compiler`), to the same bytes on any machine.",
        ),
    ] = None,
) -> None:
    """Write a bundled model as an FMU, for this machine or for those that are asked for."""
    from nrs_cosim.orchestrator.cli.output_paths import expect_replaceable
    from nrs_cosim.orchestrator.cli.progress import stages
    from nrs_cosim.plant_fmu.bundled.builder import write

    expect_replaceable(output, "FMU", b"PK")
    with stages(err) as begin:
        wanted = _platforms(platforms or [])
        windows = "win64" in wanted
        begin("compiling" + "; for Windows, the first time takes minutes" * windows)
        write(name, fmi, output, wanted)
    out.print(str(output), markup=False)


@fmu.command("compile")
def fmu_compile(
    name: Annotated[str, typer.Argument(metavar="FMU", help="An .fmu file with C sources.")],
    output: FmuOutput,
) -> None:
    """Write a copy of an FMU with a library for this machine, compiled from its C sources."""
    from nrs_cosim.orchestrator.cli.output_paths import expect_replaceable
    from nrs_cosim.orchestrator.cli.progress import stages
    from nrs_cosim.plant_fmu.archives.archive import read_archive
    from nrs_cosim.plant_fmu.archives.compilation import compiled
    from nrs_cosim.plant_fmu.bundled.builder import copy_out

    expect_replaceable(output, "FMU", b"PK")
    with stages(err) as begin:
        begin("compiling")
        built = compiled(read_archive(Path(name)))
        if output.exists() and output.samefile(built.path):
            raise InputError(f"{output}: is the FMU itself, which can run here as it is")
        copy_out(built.path, output)
    out.print(str(output), markup=False)


@fmu.command("agent")
def fmu_agent(
    scenario: ScenarioPath,
    robot: Annotated[
        int,
        typer.Option(metavar="N", parser=whole_number("--robot", 1), help="Whose agent."),
    ],
    output: FmuOutput,
    fmi: Fmi = 2,
    changes: Set = None,
) -> None:
    """Write the estimator agent of a robot alone as an FMU: samples in, its estimate out."""
    from nrs_cosim.orchestrator.cli.output_paths import expect_replaceable
    from nrs_cosim.orchestrator.cli.progress import stages
    from nrs_cosim.orchestrator.export.system import agent_of
    from nrs_cosim.orchestrator.scenario.file import read_scenario
    from nrs_cosim.plant_fmu.bundled.builder import copy_out

    experiment = read_scenario(scenario, changes_of(changes))
    if robot > experiment.n:
        raise InputError(f"--robot: expected 1 to {experiment.n}, got {robot}")
    expect_replaceable(output, "FMU", b"PK")
    with stages(err) as begin:
        begin("compiling")
        copy_out(agent_of(experiment, robot, fmi).path, output)
    out.print(str(output), markup=False)


@fmu.command("from-urdf")
def fmu_from_urdf(
    urdf: Annotated[Path, typer.Argument(metavar="URDF", help="A robot with a fixed base.")],
    output: FmuOutput,
    fmi: Fmi = 3,
    gravity: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="In m/s2, in the frame of the base link; 0,0,-9.80665 unless given.",
        ),
    ] = None,
    lock: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOINT[=VALUE]",
            help="Fix a joint, at so many rad or m or as near to 0 as its limits let it; often.",
        ),
    ] = None,
    base_link: Annotated[
        str,
        typer.Option(metavar="LINK", help="Fix this link, and leave out what is not above it."),
    ] = "",
    tip_link: Annotated[
        str,
        typer.Option(metavar="LINK", help="Fix all joints but those between the base and a link."),
    ] = "",
    friction: Annotated[
        float | None,
        typer.Option(
            metavar="SPEED",
            parser=number("--friction"),
            help="Have the file's dry friction, smoothed over so many rad/s or m/s.",
        ),
    ] = None,
    stops: Annotated[
        float | None,
        typer.Option(
            metavar="HZ",
            parser=number("--stops"),
            help="Have soft stops at the joints' limits, on which a joint swings as fast at most.",
        ),
    ] = None,
) -> None:
    """Write the rigid-body dynamics of a URDF's joints as an FMU, once it is checked."""
    from nrs_cosim.orchestrator.cli.output_paths import expect_replaceable
    from nrs_cosim.orchestrator.cli.progress import stages
    from nrs_cosim.plant_fmu.archives.archive import open_archive
    from nrs_cosim.plant_fmu.bundled.builder import copy_out
    from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
    from nrs_cosim.plant_fmu.bundled.urdf_fmu import GRAVITY, build_urdf
    from nrs_cosim.plant_fmu.bundled.urdf_selection import Selection
    from nrs_cosim.plant_fmu.checking.findings import CheckTask
    from nrs_cosim.plant_fmu.checking.subprocess_check import check_built

    pull = GRAVITY if gravity is None else _three_numbers("--gravity", gravity)
    for option, value in (("--friction", friction), ("--stops", stops)):
        if value is not None and not LEAST <= value <= 1 / LEAST:
            expected = f"expected {LEAST:g} to {1 / LEAST:g}"
            raise InputError(f"{option}: {expected}, got {value:g}")
    locked = dict(map(_locked, lock or ()))
    chosen = Selection(locked, base_link, tip_link, friction or 0.0, stops or 0.0)
    expect_replaceable(output, "FMU", b"PK")
    with stages(err) as begin:
        begin("reading")
        robot = read_urdf(urdf, chosen)
        for warning in robot.warnings:
            say("yellow", "warning", f"{urdf}: {warning}")
        built = build_urdf(robot, fmi, pull, begin)
        begin("checking")
        checked = check_built(CheckTask(open_archive(built, str(output))))
    wrong = False
    for finding in checked.findings:
        if finding.status == "fails" and finding.name not in _STIFF_TOO:
            wrong = True
            said = f"its FMU is not written, for {finding.name!r} does not hold: {finding.text}"
            say("red", "error", f"{urdf}: {said}")
        elif finding.status in {"fails", "unknown"}:
            held = "was not checked for" if finding.status == "unknown" else "does not pass"
            said = f"its FMU {held} {finding.name!r}: {finding.text}"
            say("yellow", "warning", f"{urdf}: {said}")
    if wrong:
        raise typer.Exit(FAILED)
    copy_out(built, output)
    out.print(str(output), markup=False)


def _locked(text: str) -> tuple[str, float | None]:
    """Return the joint of `JOINT` or `JOINT=VALUE`, and the value; a name may have a = in it."""
    name, equals, value = text.rpartition("=")
    if not equals:
        return text, None
    try:
        return name, decimal(value)
    except ValueError:
        raise InputError(f"--lock: expected JOINT or JOINT=VALUE, got {quoted(text)}") from None


def _platforms(texts: list[str]) -> list[str]:
    from nrs_cosim.bus.text import nearest
    from nrs_cosim.plant_fmu.bundled.compiler import PLATFORMS

    known = list(PLATFORMS)
    wanted = [name.strip() for text in texts for name in text.split(",")]
    for name in wanted:
        if name not in known:
            raise InputError(f"--platform: no platform {quoted(name)}{nearest(name, known)}")
    return wanted


def _three_numbers(option: str, text: str) -> tuple[float, float, float]:
    try:
        x, y, z = map(decimal, text.split(","))
    except ValueError:
        x = y = z = nan
    if not isfinite(x + y + z):
        raise InputError(f"{option}: expected three numbers like 0,0,-9.8, got {quoted(text)}")
    return x, y, z


def check_task(archive: "Archive", scenario: Path | None, variables: str | None) -> "CheckTask":
    """Return the check of an FMU, in the place of robot 1's where there is a scenario."""
    from nrs_cosim.orchestrator.engine.plants import Group
    from nrs_cosim.orchestrator.scenario.changes import Change, tables_with
    from nrs_cosim.orchestrator.scenario.conversion import names_of
    from nrs_cosim.orchestrator.scenario.file import parse_plant, read_scenario
    from nrs_cosim.plant_fmu.checking.findings import CheckTask

    table = re.sub(
        r"^\s*(variables\s*=)?\s*\{?|\}?\s*$", "", variables or ""
    )  # a line, or its inside
    changes = [Change.of("--variables", f"plant.variables={{{table}}}")] if variables else []
    if scenario is None:
        plant = {"plant": {"fmu": archive.label}}
        for change in changes:
            plant = tables_with(plant, change.values)
        return CheckTask(
            archive, names=names_of(parse_plant(plant["plant"], "--variables").variables)
        )
    experiment = read_scenario(scenario, changes)
    group = Group("plant", experiment.of_robot(1).plant, archive, [0])
    return CheckTask(archive, experiment.bodies([1])[0], group.names, group.driving)
