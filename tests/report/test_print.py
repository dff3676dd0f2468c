"""Figures on paper are written, and something is on them."""

import re

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image
from typer.testing import CliRunner

from docs.figures import draw
from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.cli.main import app
from nrs_cosim.recordings.report.curves import Figure
from nrs_cosim.recordings.report.print import _sheet, distance_figure, write_figures
from nrs_cosim.recordings.report.study_figures import (
    StudyMap,
    write_radius_map,
    write_study_figures,
)
from tests.cases import cases

nrs = CliRunner()


def inked(path):
    """Return the share of pixels that are not white, and how many colours there are."""
    pixels = (imread(path)[..., :3] * 255).astype(np.uint8)
    coloured = pixels[(pixels < 250).any(axis=2)]
    return len(coloured) / pixels[..., 0].size, len(np.unique(coloured, axis=0))


BEGINS = {"html": b"<!doctype html", "png": b"\x89PNG", "pdf": b"%PDF-", "svg": b"<?xml"}


@pytest.mark.parametrize("form", cases([*BEGINS], [*BEGINS][:1]))
def test_the_file_extension_sets_the_report_format(paper, tmp_path, form):
    out = tmp_path / f"report.{form.upper()}"
    more = ["--format", form] if form == "svg" else []  # said twice, it is the same
    result = nrs.invoke(app, ["report", str(paper), "-o", str(out), *more])
    assert result.exit_code == 0, result.output
    assert out.read_bytes().lower().startswith(BEGINS[form].lower())


@pytest.mark.parametrize(
    ("name", "form", "shown"),
    [
        ("a.png", "pdf", "--format pdf: -o {} ends in .png; leave one of them out"),
        ("a.html", "pdf", "ends in .html"),
        ("a.pdf", "html", "ends in .pdf"),
        ("a.mcap", "pdf", "ends in .mcap"),
        ("a.docx", None, "expected a name that ends in .html, .png, .pdf, .svg, or --format"),
    ],
)
def test_a_format_that_contradicts_a_name_is_refused_before_anything_is_read(
    tmp_path, name, form, shown
):
    out = tmp_path / name
    more = ["--format", form] if form else []
    result = nrs.invoke(app, ["report", str(tmp_path / "none.mcap"), "-o", str(out), *more])
    assert isinstance(result.exception, InputError)
    assert shown.format(out) in str(result.exception)
    assert not out.exists()


def test_without_extension_a_report_is_a_page_or_the_given_format(paper, tmp_path):
    for more, begin in (([], "html"), (["--format", "pdf"], "pdf")):
        out = tmp_path / begin
        result = nrs.invoke(app, ["report", str(paper), "-o", str(out), *more])
        assert result.exit_code == 0, result.output
        assert out.read_bytes().startswith(BEGINS[begin])


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (["run", "s.toml", "-o", "a.html"], "is the name of a page, and a recording would be w"),
        (["resume", "a.mcap", "-o", "a.csv"], "is the name of a table, and a recording would"),
        (["replay", "a.mcap", "--algorithm", "alpha=1", "-o", "b.PNG"], "is the name of a pic"),
        (["recover", "a.mcap", "-o", "a.toml"], "is the name of a scenario, and a recording"),
        (["scene", "a.mcap", "-o", "a.pdf"], "is the name of a PDF, and a recording"),
        (["fmu", "from-urdf", "a.urdf", "-o", "b.urdf"], "is the name of a URDF, and an FMU"),
        (["fmu", "agent", "s.toml", "--robot", "1", "-o", "a.mcap"], "and an FMU would be"),
        (["export", "a.mcap", "-o", "a.parquet"], "and tables go into a folder"),
        (["diff", "a.mcap", "b.mcap", "--picture", "a.pdf"], "and a picture would be written"),
    ],
)
def test_a_report_is_not_named_as_another_kind_of_file(arguments, shown):
    result = nrs.invoke(app, arguments)
    assert isinstance(result.exception, InputError)
    assert shown in str(result.exception)


@pytest.mark.parametrize("name", cases(["paper", "lossy"], ["lossy"]))
def test_a_png_shows_every_figure(request, tmp_path, name):
    recording, out = request.getfixturevalue(name), tmp_path / "figures.png"
    result = nrs.invoke(app, ["report", str(recording), "-o", str(out), "--format", "png"])
    assert result.exit_code == 0, result.output
    share, colours = inked(out)
    assert 0.02 < share < 0.5
    assert colours > 100
    pixels = imread(out)[..., :3]
    bands = np.array_split(pixels, 3 if name == "paper" else 4)
    assert all((band < 0.9).any(axis=2).mean() > 0.01 for band in bands)


def test_a_pdf_has_a_page_for_each_figure(paper, tmp_path):
    out = tmp_path / "figures.pdf"
    result = nrs.invoke(app, ["report", str(paper), "-o", str(out), "--format", "pdf"])
    assert result.exit_code == 0, result.output
    written = out.read_bytes()
    assert written.startswith(b"%PDF-")
    assert written.count(b"/Type /Page ") == 3
    assert len(written) > 50_000


def _write_study(path):
    ends, none = np.array([0.1, 0.9]), np.zeros((0, 2))
    drawn = StudyMap("α over β", "α", "β", ends, ends, ends, ends, ends > 1, none, none)
    write_study_figures([drawn], [], path, "pdf")


@pytest.mark.parametrize(
    "write",
    [
        _write_study,
        lambda path: write_radius_map(
            ("α", "β"), (np.arange(3),) * 2, np.eye(3), None, path, "pdf"
        ),
        lambda path: write_figures([Figure("one", "ε of robot 1", "", ())], [], path, "pdf"),
    ],
    ids=["study", "map", "report"],
)
def test_the_fonts_of_a_pdf_are_truetype_as_journals_ask(tmp_path, write):
    write(tmp_path / "a.pdf")
    fonts = re.findall(rb"<<([^<>]*/Type /Font [^<>]*)", (tmp_path / "a.pdf").read_bytes())
    kinds = [re.search(rb"/Subtype /(\w+)", font)[1] for font in fonts]
    assert {*kinds} == {b"Type0", b"CIDFontType2"}


def test_the_documents_figure_is_drawn_by_the_same_code(paper, tmp_path):
    draw(paper, tmp_path / "figure.png")
    assert inked(tmp_path / "figure.png")[0] > 0.02


@pytest.mark.parametrize("form", cases(["png", "svg", "pdf"], ["png"]))
def test_each_figure_has_a_file_of_its_own_on_demand(recorded, tmp_path, form):
    path = recorded("short", {"run.duration": 1.0})
    arguments = ["report", str(path), "-o", str(tmp_path / f"f.{form}"), "--separate"]
    result = nrs.invoke(app, arguments)
    assert result.exit_code == 0, result.output
    names = [f"f-{name}.{form}" for name in ("estimates", "tracking", "envelopes")]
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(names)
    for name in names:
        assert (tmp_path / name).read_bytes().startswith(BEGINS[form])
        if form == "png":
            with Image.open(tmp_path / name) as picture:
                assert picture.info["dpi"] == pytest.approx((300, 300), abs=0.1)
                assert picture.width == 8 * 300


def test_figures_of_a_page_are_not_separate(tmp_path):
    out = tmp_path / "a.html"
    result = nrs.invoke(app, ["report", "none.mcap", "-o", str(out), "--separate"])
    assert isinstance(result.exception, InputError)
    assert "is a page; give a .png, .svg or .pdf" in str(result.exception)


@pytest.mark.parametrize("most", [1.2, 3.0, 8.0, 30.0, 110.0, 1e6])
def test_a_logarithmic_axis_has_two_ticks_at_least(most):
    apart = {(1, "position"): (np.arange(2.0), np.array([0.9, 0.9 * most]))}
    (ax,) = _sheet([distance_figure(apart, "rad")], []).axes
    low, high = ax.get_ylim()
    ticks = zip(ax.get_yticks(), ax.get_yticklabels(), strict=True)
    shown = {at: label.get_text() for at, label in ticks if low <= at <= high}
    assert len(shown) >= 2
    if most < 100:
        assert [float(text) for text in shown.values()] == pytest.approx([*shown])


def test_the_last_panel_of_each_column_says_what_time_it_is():
    apart = {(1, name): (np.arange(2.0), np.ones(2)) for name in ("position", "velocity", "effort")}
    axes = _sheet([distance_figure(apart, "")], []).axes
    assert [ax.get_xlabel() for ax in axes if ax.axison] == ["", *["simulated time (s)"] * 2]


@pytest.mark.parametrize(
    ("coordinate", "units"),
    [
        ("rad", ["rad", "rad/s", "N m"]),
        ("m", ["m", "m/s", "N"]),
        ("", []),
        ("rad and m", ["rad and m", "rad/s and m/s", "N m and N"]),
    ],
)
def test_distances_have_the_units_of_their_quantities(coordinate, units):
    names = ["position", "reference_velocity", "effort", "precision"]
    apart = {(1, name): (np.arange(3.0), np.ones(3)) for name in names}
    labels = [panel.label for panel in distance_figure(apart, coordinate).panels]
    shown = [f" ({unit})" for unit in units] or [""] * 3
    assert labels == [
        f"|A − B| of {name}{unit}" for name, unit in zip(names, [*shown, ""], strict=True)
    ]
