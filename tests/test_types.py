"""One look of mypy, strictly: at the tree, and at a user's programs, of which one is right."""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
WRONG = [
    ("nrs.Scenario.load(3)", "arg-type"),
    ("nrs.check('paper.toml')", "arg-type"),
    ("nrs.check(paper).bounds[0].lowest", "attr-defined"),
    ("nrs.run(paper, wokers=2)", "call-arg"),
    ("nrs.run(paper).digest.upper()", "union-attr"),
    ("nrs.resume('a.mcap', changes=['run.duration'])", "arg-type"),
    ("nrs.Recording('a.mcap').times('outputs')", "arg-type"),
    ("nrs.Recording('a.mcap').target(0.0).shape", "attr-defined"),
    ("nrs.compare('a.mcap', 3)", "arg-type"),
    ("nrs.replay.verify('a.mcap').same", "attr-defined"),
    ("nrs.errors.InputErr", "attr-defined"),
    ("nrs.Estimate(1, 2)", "arg-type"),
    ("nrs.nothing", "attr-defined"),
]


def test_the_tree_is_typed_and_a_users_type_checker_finds_what_is_wrong(tmp_path):
    script = (ROOT / "tests/user_script.py").read_text("utf-8")
    lines = ["import nrs_cosim as nrs", "paper = nrs.Scenario.load('paper.toml')"]
    (tmp_path / "script.py").write_text(script, "utf-8")
    (tmp_path / "wrong.py").write_text(
        "\n".join([*lines, *(line for line, _ in WRONG), ""]), "utf-8"
    )
    printed = subprocess.run(
        [sys.executable, "-m", "mypy", "-p", "nrs_cosim", "-m", "script", "-m", "wrong"],
        cwd=ROOT, env={**os.environ, "MYPYPATH": str(tmp_path)},
        capture_output=True, text=True, check=False,
    ).stdout  # fmt: skip
    assert int(re.findall(r"checked (\d+) source files", printed)[-1]) > 400
    errors = [line for line in printed.splitlines() if ": error: " in line]
    found = [re.fullmatch(r"\S*/wrong\.py:(\d+): .* \[([a-z-]+)\]", line) for line in errors]
    assert all(found), printed
    assert {int(line[1]): line[2] for line in found} == {
        number: code for number, (_, code) in enumerate(WRONG, 3)
    }
