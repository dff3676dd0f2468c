"""A report as a file, a page or figures for print: no other file is replaced, and none is half."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from nrs_cosim.bus.errors import InputError, MissingExtraError
from nrs_cosim.orchestrator.cli.output_paths import expect_replaceable
from nrs_cosim.orchestrator.study.radius_map import RadiusMap
from nrs_cosim.orchestrator.study.store import StudyStore
from nrs_cosim.recordings.errors import UncreatableError
from nrs_cosim.recordings.report.data import Story
from nrs_cosim.recordings.report.figures import groups
from nrs_cosim.recordings.report.page import page

BEGINS = {"html": b"<!doctype html", "png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}


def write_report(
    stories: Sequence[Story], output: Path, kind: str, *, separate: bool = False
) -> list[Path]:
    """Write recordings in a format, and return its files; each figure may have one of its own.

    `InputError` where a file cannot be made or replaced.
    """
    if kind == "html":
        _write_whole(output, kind, lambda part: part.write_text(page(stories), "utf-8"))
        return [output]
    try:
        from nrs_cosim.recordings.report.print import (  # noqa: PLC0415 (an extra)
            drawn_of,
            write_figures,
        )
    except ImportError:
        raise MissingExtraError(f"{kind}: figures need matplotlib", "report") from None
    drawn, legend, written = drawn_of(stories), groups(stories), []
    for some in [[figure] for figure in drawn] if separate else [drawn]:
        name = f"{output.stem}-{some[0].name}{output.suffix}" if separate else output.name
        one = output.with_name(name)
        _write_whole(one, kind, partial(write_figures, some, legend, form=kind))
        written.append(one)
    return written


def write_study(store: StudyStore, output: Path, kind: str) -> None:
    """Write a study in a format; `InputError` as of recordings, or where no study is there."""
    try:
        from nrs_cosim.orchestrator.study.report import StudyReport  # noqa: PLC0415 (an extra)
    except ImportError:
        raise MissingExtraError(f"{kind}: figures need matplotlib", "report") from None
    made = StudyReport(store)
    _write_whole(output, kind, partial(made.write, form=kind, origin=output))


def write_radius_map(made: RadiusMap, output: Path, kind: str) -> None:
    """Write a map of ρ in a format; `InputError` as above, or where an axis has no numbers."""
    try:
        from nrs_cosim.recordings.report import study_figures  # noqa: PLC0415 (an extra)
    except ImportError:
        raise MissingExtraError(f"{kind}: figures need matplotlib", "report") from None
    keys = made.axes[0].keys[0], made.axes[1].keys[0]
    x, y = made.values()
    for key, values in zip(keys, (x, y), strict=True):
        if not all(type(value) in {int, float} for value in values) or values != sorted(values):
            raise InputError(f"--figure: {key}: a figure is of numbers that grow")
    numbers = np.array(x, float), np.array(y, float)
    growth = None if made.growth is None else (made.growth[0] + made.growth[1]) / 2
    write = partial(study_figures.write_radius_map, keys, numbers, made.upper, growth, form=kind)
    _write_whole(output, kind, write)


def _write_whole(output: Path, kind: str, write: Callable[[Path], object]) -> None:
    """Write a file beside where it is to be, and then put it in its place."""
    try:
        expect_replaceable(output, f"report ({kind})", BEGINS[kind])
        output.parent.mkdir(parents=True, exist_ok=True)
        part = output.with_name(output.name + ".part")
        write(part)
        part.replace(output)
    except OSError as error:
        raise UncreatableError(f"{output}: cannot be written: {error.strerror}") from None
