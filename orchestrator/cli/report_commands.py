"""`nrs report`: recordings as a page or as figures."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Literal

import typer

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.cli.options import ReportFile
from nrs_cosim.orchestrator.terminal import err, out, say

Format = Literal["html", "png", "pdf", "svg"]


def report(
    recordings: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="Recordings (MCAP); several lie over one another."),
    ],
    output: ReportFile,
    form: Annotated[
        Format | None,
        typer.Option("--format", help="Of a file whose name has no known ending; html by default."),
    ] = None,
    separate: Annotated[
        bool,
        typer.Option(
            "--separate",
            help="Each figure in a file of its own, FILE-estimates.png and so on; not of a page.",
        ),
    ] = False,
) -> None:
    """Draw recordings: an interactive page, or figures for print."""
    from nrs_cosim.orchestrator.cli.formats import format_of
    from nrs_cosim.orchestrator.cli.progress import reading, stages
    from nrs_cosim.orchestrator.cli.report_files import BEGINS, write_report
    from nrs_cosim.orchestrator.report.subject import story_of
    from nrs_cosim.recordings.mcap.reader import Reader

    kind = format_of(output, form, tuple(BEGINS))
    if separate and kind == "html":
        raise InputError(f"--separate: -o {output} is a page; give a .png, .svg or .pdf")
    with ExitStack() as stack:
        stories, follow = [], stack.enter_context(reading(err))
        for path in recordings:
            reader = stack.enter_context(Reader(path, watch=follow(path)))
            reader.expect_ticks("draw")
            stories.append(story_of(reader))
            if why := stories[-1].subject.no_theory:
                say("yellow", "theory", f"{path}: none is drawn: {why}")
            for damage in reader.damage:
                say("yellow", "damage", f"{path}: {damage}")
    with stages(err) as begin:
        begin("drawing")
        written = write_report(stories, output, kind, separate=separate)
    for path in written:
        out.print(str(path), markup=False)
