"""Pages for those who learn: what they show is run and true, and the site has no warning."""

import os
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from docs import gallery
from docs.pages import pictures, tried
from tests.printed import masked

ROOT = Path(__file__).parents[1]
TUTORIALS = sorted((ROOT / "docs/tutorials").glob("*.md"))
PAGES = [ROOT / "README.md", ROOT / "docs/results.md", ROOT / "docs/studies.md", *TUTORIALS]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_what_a_page_shows_is_so(page, tmp_path):
    done = list(tried(page, tmp_path))
    assert len(done) >= 2
    for part, new in done:
        if part.span != (0, 0):
            assert masked(new).splitlines() == masked(part.shown).splitlines(), part.text
    for name in pictures(page):
        drawn, shown = (matplotlib.image.imread(f / name) for f in (tmp_path, page.parent))
        assert drawn.shape == shown.shape, name
        assert np.abs(drawn - shown).mean() < 0.02, name


def test_the_site_is_built_without_a_warning_and_without_a_network(tmp_path):
    nowhere = dict.fromkeys(("http_proxy", "https_proxy", "all_proxy"), "http://127.0.0.1:9")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", tmp_path / "cache",
         ROOT / "docs", tmp_path / "site"],
        env={**os.environ, **nowhere}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    for page in (tmp_path / "site").rglob("*.html"):
        loaded = re.findall(
            r'(?:src|rel="stylesheet"[^>]*href)="(https?:[^"]+)"', page.read_text("utf-8")
        )
        assert not loaded, page.name
    index = (tmp_path / "site/genindex.html").read_text("utf-8")
    assert 'href="_static/site.css' in index
    assert "genindextable" in index  # of which the sheet makes one column on a phone
    names = (tmp_path / "site/python.html").read_text("utf-8")
    assert all(f'id="nrs_cosim.{name}"' in names for name in ("Scenario", "run", "Algorithm"))


def test_the_messages_that_are_explained_are_those_of_the_code():
    text = (ROOT / "docs/troubleshooting.md").read_text("utf-8")
    explained = re.findall(r"^- `([^`]+)`:", text, re.MULTILINE)
    folders = ("bus", "estimator_agents", "orchestrator", "plant_fmu", "recordings")
    code = "".join(
        path.read_text("utf-8") for folder in folders for path in (ROOT / folder).rglob("*.py")
    )
    joined = re.sub(r'"\s*f?"', "", code)
    assert len(explained) >= 12
    assert [words for words in explained if words not in joined] == []


def test_the_gallery_has_every_scenario_with_its_picture():
    assert (ROOT / "docs/gallery.md").read_text("utf-8") == gallery.page(), "see make gallery"
    shown = {path.stem for path in (ROOT / "docs/gallery").glob("*.png")}
    assert shown == {path.stem for path in gallery.SCENARIOS.glob("*.toml")}
