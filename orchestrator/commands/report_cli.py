"""`nrs report`: recordings as a page or as figures."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from orchestrator.terminal import out, say

if TYPE_CHECKING:
    from recordings.report.story import Story

Format = Literal["html", "png", "pdf"]
_BEGINS = {"html": b"<!doctype html", "png": b"\x89PNG", "pdf": b"%PDF"}


def report(
    recordings: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="Recordings (MCAP); several lie over one another."),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="PAGE", help="Where the report goes.")
    ],
    form: Annotated[
        Format, typer.Option("--format", help="A page that needs no network, or its figures.")
    ] = "html",
) -> None:
    """Draw recordings: a page with everything that moves, or figures for print."""
    from orchestrator.commands.places import expect_replaceable
    from orchestrator.reports.reporting import story_of
    from recordings.errors import UncreatableError
    from recordings.reading import Reader
    from recordings.report.page import page

    with ExitStack() as stack:
        stories = []
        for path in recordings:
            reader = stack.enter_context(Reader(path))
            stories.append(story_of(reader))
            for damage in reader.damage:
                say("yellow", "damage", f"{path}: {damage}")
    try:
        expect_replaceable(output, f"report ({form})", _BEGINS[form])
        output.parent.mkdir(parents=True, exist_ok=True)
        part = output.with_name(output.name + ".part")
        if form == "html":
            part.write_text(page(stories), "utf-8")
        else:
            _print(stories, part, form)
        part.replace(output)
    except OSError as error:
        raise UncreatableError(f"{output}: cannot be written: {error.strerror}") from None
    out.print(str(output), markup=False)


def _print(stories: "list[Story]", path: Path, form: Literal["png", "pdf"]) -> None:
    from recordings.errors import MissingExtraError

    try:
        from recordings.report.printing import write_figures
    except ImportError:
        raise MissingExtraError(
            f"--format {form}: figures need matplotlib, which is not installed: "
            "pip install '.[report]' in nrs-cosim's sources"
        ) from None
    write_figures(stories, path, form)
