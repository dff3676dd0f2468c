"""`nrs report`: recordings as a page or as figures."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from nrs_cosim.orchestrator.terminal import err, out, say

if TYPE_CHECKING:
    from nrs_cosim.recordings.report.data import Story

Format = Literal["html", "png", "pdf", "svg"]
_BEGINS = {"html": b"<!doctype html", "png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}


def report(
    recordings: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="Recordings (MCAP); several lie over one another."),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Where the report goes; .html is a page, .pdf, .png and .svg are its figures.",
        ),
    ],
    form: Annotated[
        Format | None,
        typer.Option("--format", help="Of a file whose name does not say; html by default."),
    ] = None,
) -> None:
    """Draw recordings: a page with everything that moves, or figures for print."""
    from nrs_cosim.orchestrator.cli.formats import format_of
    from nrs_cosim.orchestrator.cli.output_paths import expect_replaceable
    from nrs_cosim.orchestrator.cli.progress import reading
    from nrs_cosim.orchestrator.report.subject import story_of
    from nrs_cosim.recordings.errors import UncreatableError
    from nrs_cosim.recordings.mcap.reader import Reader
    from nrs_cosim.recordings.report.page import page

    kind = format_of(output, form, tuple(_BEGINS))
    with ExitStack() as stack:
        stories, follow = [], stack.enter_context(reading(err))
        for path in recordings:
            reader = stack.enter_context(Reader(path, watch=follow(path)))
            reader.expect_ticks("draw")
            stories.append(story_of(reader))
            for damage in reader.damage:
                say("yellow", "damage", f"{path}: {damage}")
    try:
        expect_replaceable(output, f"report ({kind})", _BEGINS[kind])
        output.parent.mkdir(parents=True, exist_ok=True)
        part = output.with_name(output.name + ".part")
        if kind == "html":
            part.write_text(page(stories), "utf-8")
        else:
            _print(stories, part, kind)
        part.replace(output)
    except OSError as error:
        raise UncreatableError(f"{output}: cannot be written: {error.strerror}") from None
    out.print(str(output), markup=False)


def _print(stories: "list[Story]", path: Path, kind: str) -> None:
    from nrs_cosim.bus.errors import MissingExtraError

    try:
        from nrs_cosim.recordings.report.print import write_figures
    except ImportError:
        raise MissingExtraError(f"{kind}: figures need matplotlib", "report") from None
    write_figures(stories, path, kind)
