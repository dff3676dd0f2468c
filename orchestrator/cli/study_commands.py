"""`nrs sweep` and `nrs study`: many runs of a scenario, and what is made of their rows."""

from pathlib import Path
from typing import Annotated

import typer

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.cli.option_groups import TlsOptions, with_groups
from nrs_cosim.orchestrator.cli.option_rules import OptionRules, required_by
from nrs_cosim.orchestrator.cli.options import (
    Force,
    Output,
    ReportFile,
    Set,
    changes_of,
    number,
    whole_number,
)
from nrs_cosim.orchestrator.terminal import AsJson, err, out, print_json

study = typer.Typer(
    name="study",
    add_completion=False,
    no_args_is_help=True,
    help="Studies: many runs of one scenario.",
)

StudyPath = Annotated[Path, typer.Argument(metavar="DIR", help="A study's folder.")]


def _shard(text: str | tuple[int, int]) -> tuple[int, int]:
    """Read `i/N`."""
    if isinstance(text, tuple):
        return text
    part, _, parts = text.partition("/")
    if not (part.isdecimal() and parts.isdecimal() and 1 <= int(part) <= int(parts)):
        raise InputError(f"--shard: expected i/N with i from 1 to N, got {quoted(text)}")
    return int(part), int(parts)


@OptionRules(
    {
        **required_by(("--refine",), "--width"),
        **required_by(("--dask",), "--tls-ca", "--tls-certificate", "--tls-key"),
    },
    (("--jobs", "--dask"), ("--refine", "--shard")),
)
@with_groups
def sweep(
    scenarios: Annotated[
        list[Path], typer.Argument(metavar="SCENARIO...", help="Scenario files (TOML).")
    ],
    *,
    over: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUES",
            help="An axis: KEY=LOW:HIGH:N evenly, log:LOW:HIGH:N, or values with commas between; "
            "LOW:HIGH with --draw. Keys with a semicolon between go together. May be given again.",
        ),
    ] = None,
    seeds: Annotated[
        str | None,
        typer.Option(metavar="N | 1,5,9", help="Seeds of each point: 1 to N, or these."),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="The study's folder.")
    ],
    draw: Annotated[
        str | None,
        typer.Option(
            metavar="lhs:N | sobol:N",
            help="Draw N points from all ranges LOW:HIGH; :SEED may follow.",
        ),
    ] = None,
    where: Annotated[
        str | None,
        typer.Option(
            metavar="CONDITION",
            help="Run points alone at which it holds: keys of the axes compared, such as "
            "'algorithm.alpha < 1 or run.sampling_period < 0.2'.",
        ),
    ] = None,
    changes: Set = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            parser=whole_number("--jobs", 0),
            help="Processes that run points; by default all processors, 0 for none but this.",
        ),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="A Dask scheduler whose workers run the points."),
    ] = None,
    keep: Annotated[
        str,
        typer.Option(metavar="none | failed | all | every:N", help="Which recordings are kept."),
    ] = "failed",
    timeout: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            parser=number("--timeout"),
            help="End points that take longer, of wall time.",
        ),
    ] = None,
    retry: Annotated[
        bool, typer.Option("--retry", help="Run points again that failed, crashed or were late.")
    ] = False,
    refine: Annotated[
        str | None,
        typer.Option(
            metavar="boundary | KEY",
            help="Then run values between two of which one converges: on each axis of numbers, or "
            "on that of KEY.",
        ),
    ] = None,
    width: Annotated[
        float | None,
        typer.Option(
            metavar="WIDTH",
            parser=number("--width"),
            help="How close these two come; by default a hundredth of the axis.",
        ),
    ] = None,
    shard: Annotated[
        str | None,
        typer.Option(metavar="i/N", help="Run the i-th of N parts, for batch systems."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say how many points, how long and how large.")
    ] = False,
    tls: TlsOptions,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print a line of JSON for each point that is done.")
    ] = False,
) -> None:
    """Run scenarios over axes and seeds; the same command again does what is missing."""
    from nrs_cosim.orchestrator.cli.terminal_study import SweepOptions, perform_sweep

    for option, value in (("--timeout", timeout), ("--width", width)):
        if value is not None and not value > 0:
            raise InputError(f"{option}: expected more than 0, got {value:g}")
    perform_sweep(
        SweepOptions(
            scenarios,
            over or [],
            seeds,
            output,
            draw,
            where,
            changes_of(changes),
            jobs,
            dask,
            tls,
            keep,
            timeout,
            retry,
            refine,
            width,
            _shard(shard or "1/1"),
            as_json,
        ),
        dry_run=dry_run,
    )


@study.command("info")
def study_info(folder: StudyPath, as_json: AsJson = False) -> None:
    """Summarise a study: its axes, statuses and failures."""
    from nrs_cosim.orchestrator.cli.terminal_study import show_study, study_summary

    found = study_summary(folder)
    if as_json:
        print_json(found)
    else:
        show_study(out, found)


@study.command("report")
def study_report(
    folder: StudyPath,
    output: ReportFile,
) -> None:
    """Draw a study: maps with theory's boundary, slices, failures."""
    from nrs_cosim.orchestrator.cli.formats import format_of
    from nrs_cosim.orchestrator.cli.progress import stages
    from nrs_cosim.orchestrator.cli.report_files import BEGINS, write_study
    from nrs_cosim.orchestrator.study.store import StudyStore

    kind = format_of(output, None, tuple(BEGINS))
    with stages(err) as begin:
        begin("drawing")
        write_study(StudyStore(folder), output, kind)
    out.print(str(output), markup=False)


@study.command("run")
def study_run(
    folder: StudyPath,
    key: Annotated[str, typer.Argument(metavar="KEY", help="A row's key, or how it begins.")],
    output: Output = None,
    force: Force = False,
) -> None:
    """Run a point of a study again, with a recording."""
    from nrs_cosim.orchestrator.cli.terminal_run import perform
    from nrs_cosim.orchestrator.study.store import StudyStore
    from nrs_cosim.orchestrator.study.study import experiment_at

    perform(experiment_at(StudyStore(folder), key), output, None, force=force)


@study.command("merge")
def study_merge(
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="Studies of the same scenarios.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="The study that gets their rows.")
    ],
) -> None:
    """Put the rows of a study's parts into one."""
    from nrs_cosim.orchestrator.cli.terminal_study import merge_studies

    merge_studies(output, folders)
