"""A value of 5,000 characters makes no message of 5,000 characters, wherever it stands."""

import pytest

from tests.command import nrs
from tests.scenarios import write

LONG = "k" * 5000
PLACES = {
    "a key": {f"run.{LONG}": 1},
    "a number": {"run.seed": LONG},
    "a control character": {"run.seed": f"\x1b[31m{LONG}"},
    "a name": {"algorithm.name": LONG},
    "a file": {"plant.fmu": f"{LONG}.fmu"},
}


@pytest.mark.parametrize("place", PLACES)
def test_a_message_on_a_scenario_is_short(tmp_path, place):
    path = write(tmp_path / "s.toml", PLACES[place])
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
