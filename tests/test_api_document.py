"""What docs/api.md and the docstrings show of the door for Python is run, and true."""

import doctest
import importlib
import inspect
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib.image import imread

import nrs_cosim as nrs

ROOT = Path(__file__).parents[1]
DOCUMENT = (ROOT / "docs/api.md").read_text("utf-8")
_, *PARTS = re.split(r"^## (.*)\n", DOCUMENT, flags=re.MULTILINE)
PROGRAMS = {
    heading: found
    for heading, text in zip(PARTS[::2], PARTS[1::2], strict=True)
    if (found := re.search(r"```python\n(.*?)```(?:\s*```\n(.*?)```)?", text, re.DOTALL))
}
"""Programs and what they print, by the heading that they stand under."""


@pytest.fixture
def folder(tmp_path):
    """Return a folder that has `scenarios`, as the document says."""
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    return tmp_path


def printed(program: str, folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder, env={**os.environ, "MPLBACKEND": "agg"}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


TWENTY = "Twenty gains and their steady-state error"
"""It has a test of its own."""


@pytest.mark.parametrize("heading", [heading for heading in PROGRAMS if heading != TWENTY])
def test_a_program_of_the_document_is_true(folder, heading):
    program, expected = PROGRAMS[heading].groups()
    assert printed(program, folder) == (expected or "")
    assert len(PROGRAMS) == DOCUMENT.count("```python") == 5


def test_ten_lines_draw_the_steady_state_error_that_the_theory_has(folder):
    program = PROGRAMS[TWENTY][1]
    assert len([line for line in program.splitlines() if line]) <= 10
    shown = "print([line.get_xydata()[0].tolist() for line in plt.gca().lines])"
    points = json.loads(printed(f"{program}\n{shown}", folder))
    assert len(points) == 20
    paper = nrs.Scenario.load(ROOT / "scenarios/paper_first_order.toml")
    for alpha, error in points:
        bound = nrs.check(paper.replace({"algorithm.alpha": alpha})).bounds[0].steady_state
        assert 0.999 * bound < error < bound * (1 + 1e-3)
    picture = imread(folder / "gains.png")
    assert (picture[..., :3].min(axis=-1) < 0.5).mean() > 0.01


CALLS = [
    *(nrs.run, nrs.resume, nrs.check, nrs.compare, nrs.replay.verify, nrs.replay.what_if),
    *(nrs.Scenario, nrs.Scenario.replace, nrs.Recording, nrs.sweep, nrs.Study),
    *(
        getattr(nrs.Recording, name)
        for name in dir(nrs.Recording)
        if callable(getattr(nrs.Recording, name)) and not name.startswith("_") and name != "close"
    ),
    *(
        getattr(nrs.Study, name)
        for name in dir(nrs.Study)
        if callable(getattr(nrs.Study, name)) and not name.startswith("_")
    ),
]


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.__qualname__)
def test_every_call_has_its_arguments_errors_and_an_example_in_its_docstring(call):
    given = [name for name in inspect.signature(call).parameters if name != "self"]
    text = inspect.getdoc(call)
    assert {"Raises:", "Example:"} <= set(text.splitlines())
    shared = "as for the rest" in text or "as the rest" in text
    of = text.partition("Args:")[2].partition("Raises:")[0]
    assert shared or [name for name in given if f"{name}: " not in of] == []


@pytest.mark.parametrize(
    "module",
    [
        "api.scenario",
        "api.run",
        "api.theory",
        "api.replay",
        "api.recording",
        "api.study",
        "api.sweep",
        "recordings.recording",
    ],
)
def test_the_examples_in_the_docstrings_run(module, monkeypatch):
    monkeypatch.chdir(ROOT)
    failed, tried = doctest.testmod(importlib.import_module(f"nrs_cosim.{module}"))
    assert tried > 0
    assert failed == 0
