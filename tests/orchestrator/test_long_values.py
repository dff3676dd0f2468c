"""A value of 5,000 characters makes no message of 5,000 characters, wherever it stands."""

import re
from pathlib import Path

import pytest

from tests.command import nrs

LONG = "k" * 5000
SCENARIO = Path("scenarios/paper_first_order.toml").read_text()
PLACES = {
    "a key": (r"^seed = .*", f"{LONG} = 1"),
    "a number": (r"^seed = .*", f'seed = "{LONG}"'),
    "a control character": (r"^seed = .*", rf'seed = "\\\\u001b[31m{LONG}"'),
    "a name": (r'^name = ".*', f'name = "{LONG}"'),
    "a file": (r"^fmu = .*", f'fmu = "{LONG}.fmu"'),
}


@pytest.mark.parametrize("place", PLACES)
def test_a_message_on_a_scenario_is_short(tmp_path, place):
    path = tmp_path / "s.toml"
    path.write_text(re.sub(*PLACES[place], SCENARIO, count=1, flags=re.MULTILINE))
    done = nrs("check", path)
    assert done.returncode == 2
    assert len(done.stderr) < 3 * len(str(path)) + 300
    assert " … " in done.stderr
    assert "\x1b" not in done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        [LONG],
        [f"--{LONG}"],
        ["run", f"--{LONG}"],
        ["run", LONG],
        ["info", LONG],
        ["fmu", "info", LONG],
        ["fmu", "check", f"{LONG}.fmu"],
        ["run", "s.toml", "--wait", LONG],
        ["run", "s.toml", "--compression", LONG],
    ],
    ids=lambda arguments: " ".join(word[:12] for word in arguments),
)
def test_a_message_on_the_command_line_is_short(arguments):
    done = nrs(*arguments)
    assert done.returncode == 2
    assert 0 < len(done.stderr) < 1500
    assert done.stderr.count("k") < 200
