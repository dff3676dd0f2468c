"""Figures on paper are written, and something is on them."""

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from docs.figures import draw
from orchestrator.commands.cli import app

nrs = CliRunner()


def inked(path):
    """Return the share of pixels that are not white, and how many colours there are."""
    pixels = (imread(path)[..., :3] * 255).astype(np.uint8)
    coloured = pixels[(pixels < 250).any(axis=2)]
    return len(coloured) / pixels[..., 0].size, len(np.unique(coloured, axis=0))


@pytest.mark.parametrize("name", ["paper", "lossy"])
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


def test_a_recording_without_a_tick_has_a_sheet(empty, tmp_path):
    out = tmp_path / "figures.png"
    result = nrs.invoke(app, ["report", str(empty), "-o", str(out), "--format", "png"])
    assert result.exit_code == 0, result.output
    assert inked(out)[0] > 0


def test_the_documents_figure_is_drawn_by_the_same_code(paper, tmp_path):
    draw(paper, tmp_path / "figure.png")
    assert inked(tmp_path / "figure.png")[0] > 0.02
