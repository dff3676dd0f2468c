"""What a terminal of any width shows: lines end between words, options speak plainly."""

import re
from io import StringIO

import pytest
from rich.console import Console
from typer.testing import CliRunner

from nrs_cosim.orchestrator.cli import summary_text
from nrs_cosim.orchestrator.cli.main import app
from nrs_cosim.orchestrator.cli.tables import grid
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import lines
from nrs_cosim.orchestrator.replay.diff import Comparison
from nrs_cosim.orchestrator.terminal import prose
from tests.command import nrs
from tests.scenarios import SHORT, paper

WORDS = "robots that hear nobody keep their estimates for ever and ever until the run is at its end"


def console(*, terminal, width=40):
    return Console(file=StringIO(), force_terminal=terminal, width=width, soft_wrap=True)


def plain(screen):
    return re.sub(r"\x1b\[[0-9;]*m", "", screen.file.getvalue())


@pytest.mark.parametrize("width", [40, 60, 120])
def test_summary_lines_wrap_between_words_and_are_indented(width):
    screen = console(terminal=True, width=width)
    grid(screen, {"driven": WORDS, "digest": "0" * 64})
    first, *more = plain(screen).splitlines()
    text = [line for line in (first, *more) if "0" not in line]
    assert first.startswith("driven     robots")
    assert all(len(line) <= width for line in (first, *more))
    assert all(line.startswith(" " * 11) for line in text[1:])
    assert " ".join(" ".join(text).split()) == f"driven {WORDS}"


def test_sentences_wrap_between_words_only_on_a_terminal():
    for terminal in (True, False):
        screen = console(terminal=terminal)
        prose(screen, WORDS)
        described = plain(screen).splitlines()
        assert len(described) == (3 if terminal else 1)
        assert " ".join(line.strip() for line in described) == WORDS


def test_a_text_difference_is_shown_without_a_table():
    screen = console(terminal=False)
    first = type("First", (), {"between": lambda *_: "tick 1: text"})()
    summary_text.comparison(screen, Comparison({"run.seed": (1, 2)}, first, "messages"))
    assert plain(screen).splitlines() == ["run.seed: 1 -> 2", "first tick 1: text"]


def described(*plants):
    """Return the summary's line on how plants are driven, and that on robots."""
    about = {
        "algorithm": {"name": "dcea1", "parameters": {}},
        "assets": {},
        "plants": [
            {
                "fmu": fmu,
                "fmi_version": "3.0",
                "drive": "d",
                "robots": [i],
                "why": why,
                "joints": [],
            }
            for i, (fmu, why) in enumerate(plants, 1)
        ],
        **dict.fromkeys(("parent", "target", "samples", "links", "byzantine", "saturation"), None),
        **dict.fromkeys(("name", "status", "reason", "digest", "file", "messages"), "x"),
        **dict.fromkeys(("robots", "joints", "ticks", "ticks_planned", "duration"), 2),
    }
    errors = type(
        "E",
        (),
        dict.fromkeys(
            ("position_estimate", "velocity_estimate", "position_tracking", "velocity_tracking"),
            0.0,
        ),
    )
    return lines(about, errors)["driven"]


def test_a_mixed_fleet_lists_how_each_fmu_is_driven():
    assert described(("a", "held"), ("b", "held"), ("c", "exact")) == "a, b: held; c: exact"
    assert described(("a", "held"), ("b", "held")) == "held"


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--from", "nan", "a number"),
        ("--from", "-1", "0 to 9.22337e+09 s"),
        ("--until", "1e300", "0 to 9.22337e+09 s"),
        ("--until", "infinity", "a number"),
        ("--speed", "1_0", "a number"),
        ("--speed", "١", "a number"),
        ("--wait", "x", "a number"),
    ],
)
def test_a_numeric_option_takes_only_decimal_numbers(option, value, expected):
    done = nrs("replay", "a.mcap", "--publish", option, value)
    assert (done.returncode, done.stderr) == (
        2,
        f"error: {option}: expected {expected}, got '{value}'\n",
    )


@pytest.mark.parametrize("value", ["0", "65536", "8_0", "1.5"])
def test_a_port_that_is_not_a_whole_number_is_refused(value):
    least = 1 if value == "0" else 0
    option = "--expect" if least else "--port"
    done = nrs("run", "s.toml", "--live", option, value)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {option}: expected a whole number, {least}")


@pytest.mark.parametrize("command", ["run", "replay", "report", "check", "fmu", "export"])
def test_help_names_no_types_of_python(command):
    shown = CliRunner().invoke(app, [command, "--help"]).output
    assert not re.search(r"<(bool|path|list|str|float|int)", shown)
    assert "--help" in shown


def test_missing_output_folders_are_created(tmp_path, recorded):
    for command in ("recover", "scene"):
        new = tmp_path / command / "deep" / "new.mcap"
        done = nrs(command, recorded, "-o", new)
        assert done.returncode == 0, done.stderr
        assert new.exists()
    (tmp_path / "file").touch()
    done = nrs("recover", recorded, "-o", tmp_path / "file" / "new.mcap")
    assert done.returncode == 2
    assert "is a file and not a folder" in done.stderr


def test_a_recording_given_for_a_scenario_is_refused_and_vice_versa(tmp_path, recorded):
    done = nrs("run", recorded)
    assert (done.returncode, done.stderr) == (
        2,
        f"error: {recorded}: is a recording (MCAP), not a scenario; `nrs info` reads it\n",
    )
    scenario = tmp_path / "s.toml"
    scenario.write_text("[run]\n", "utf-8")
    done = nrs("info", scenario)
    described = (
        f"error: {scenario}: is a scenario (TOML), not a recording; `nrs check` reads scenarios\n"
    )
    assert (done.returncode, done.stderr) == (2, described)


@pytest.fixture
def recorded(tmp_path):
    """Return a short recording."""
    return run(paper(SHORT), tmp_path / "run.mcap").path
