"""Tables keep their words whole on a terminal of 60 columns as of 120, and lose none of them."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from io import StringIO
from pathlib import Path
from uuid import uuid4

import pytest
from rich.console import Console
from rich.table import Column

from nrs_cosim.orchestrator.cli.tables import findings_table, table
from tests.command import nrs
from tests.guard import GUARD
from tests.scenarios import SHORT, write

WIDTHS = (60, 120)
COLUMNS = (Column("what"), Column("value", justify="right"), Column(), Column("paper"))
ROW = (r"a \[b]", "0.9", "[green]holds[/]", "159, unproven")


def console(width, *, terminal=True):
    return Console(file=StringIO(), force_terminal=terminal, width=width, soft_wrap=True)


def lines(screen):
    return re.sub(r"\x1b\[[0-9;]*m", "", screen.file.getvalue()).splitlines()


@pytest.mark.parametrize(
    ("width", "expected"),
    [
        (34, ["what   value         paper", "a [b]    0.9  holds  159, unproven"]),
        (31, ["what  value       paper", "a [b]   0.9 holds 159, unproven"]),
        (30, ["what   value         paper", "a [b]    0.9  holds  159,", " " * 21 + "unproven"]),
        (18, ["what   value", "a [b]    0.9", "  holds; paper:", "  159, unproven"]),
    ],
)
def test_columns_that_do_not_fit_move_together_then_fold_then_stand_below(width, expected):
    screen = console(width)
    table(screen, COLUMNS, [ROW])
    assert [line.rstrip() for line in lines(screen)] == expected


@pytest.mark.parametrize("width", [60, 120])
def test_a_long_text_in_the_last_column_goes_on_below_itself(width):
    joints = [f"left_{part}_joint" for part in ("shoulder_pitch", "elbow", "wrist_roll")] * 3
    screen = console(width)
    table(screen, (*COLUMNS[:3], Column("about")), [(*ROW[:3], " ".join(joints))])
    _, first, *more = (line.rstrip() for line in lines(screen))
    hangs = first.index("left")
    assert more
    assert all(line.rfind(" " * hangs) == 0 and len(line) <= width for line in more)
    assert " ".join((first[hangs:], *more)).split() == joints


def test_titles_are_folded_before_a_column_of_numbers_stands_below_its_row():
    columns = (
        Column("robot"),
        Column("largest |A - B|", justify="right"),
        Column("rms", justify="right"),
    )
    screen = console(30)
    table(screen, columns, [("1", "2.099e+04", "1.587e+03")])
    assert [line.rstrip() for line in lines(screen)] == [
        "         largest",
        "robot    |A - B|        rms",
        "1      2.099e+04  1.587e+03",
    ]


def test_in_a_pipe_all_columns_are_shown():
    screen = console(18, terminal=False)
    table(screen, COLUMNS, [ROW])
    assert lines(screen) == ["what   value         paper", "a [b]    0.9  holds  159, unproven"]


@pytest.mark.parametrize("width", [30, 60, 120])
def test_the_text_of_a_finding_is_indented_beside_or_below_its_name(width):
    screen = console(width)
    text = "a torque that is held, of order one in its step and in no other way " * 3
    findings_table(screen, [("M symmetric", "[green]holds[/]", text)], (14, 8))
    first, *more = lines(screen)
    assert first.startswith("  M symmetric   holds")
    assert all(len(line.rstrip()) <= width for line in (first, *more))
    hangs = 4 if width < 60 else 24
    assert more
    assert all(line.startswith(" " * hangs) for line in more)
    assert " ".join(" ".join((first, *more)).split()) == f"M symmetric holds {text.strip()}"


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    """Return a short run of the paper's example, whose bounds on tracking are unproven."""
    return write(tmp_path_factory.mktemp("terminal") / "s.toml", SHORT)


def screen_of(width, command):
    """Return what tmux shows of a command in a terminal of so many columns."""
    if not shutil.which("tmux"):
        pytest.skip("the system package tmux is not installed")
    tmux = ["tmux", "-L", f"nrs-{uuid4().hex}", "-f", "/dev/null"]  # tests run side by side
    done = " ".join([*tmux, "wait-for", "-S", "done"])
    program = f"{shlex.join(command)}; echo status $?; {done}; exec cat"
    outside = {k: v for k, v in os.environ.items() if k not in {"COLUMNS", "LINES"}}
    env = {**outside, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}

    def run(*words):
        result = subprocess.run(
            [*tmux, *words], env=env, check=True, capture_output=True, text=True, timeout=GUARD
        )
        return result.stdout

    run("new-session", "-d", "-x", str(width), "-y", "200", program)
    try:
        run("wait-for", "done")
        return run("capture-pane", "-p").rstrip().splitlines()
    finally:
        run("kill-server")


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("command", ["check", "run", "fmu check", "fmu info"])
def test_a_terminal_wraps_only_between_words(scenario, tmp_path, command, width):
    given = ["two_link_arm"] if "fmu" in command else [str(scenario)]
    words = [*command.split(), *given]
    if command == "run":
        words += ["-o", str(tmp_path / "t.mcap"), "--profile"]
    *shown, status = screen_of(width, ["nrs", *words])
    assert status == "status 0"
    piped = nrs(*words, *(["--force"] if command == "run" else [])).stdout
    said = {word for word in piped.split() if len(word) < width - 11 and not timed(word)}
    there = {word.rstrip(":;") for line in shown for word in line.split()}
    assert {word for word in said if word.rstrip(":;") not in there} == set()
    assert not [line for line in shown if "…" in line]


def timed(word):
    """Return whether it may be a time or a share of time, which no two runs have in common."""
    return re.fullmatch(r"[\d.]+", word)


def test_a_name_between_colons_is_no_emoji():
    screen = console(80, terminal=False)
    table(screen, [Column(":x:")], [["joint:x:1"]])
    findings_table(screen, [("valid", ":x:", "joint:x:1")], (8, 8))
    assert " ".join(lines(screen)).split() == [":x:", "joint:x:1", "valid", ":x:", "joint:x:1"]
