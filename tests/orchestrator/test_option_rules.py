"""An option that means nothing beside the others is an error, of each command alike."""

import pytest

from nrs_cosim.orchestrator.cli.main import command
from nrs_cosim.orchestrator.cli.option_rules import rules_of
from tests.command import nrs

REPLAY = ("replay", "no.mcap")


def commands(group=None, path=()):
    for name, found in (group or command()).commands.items():
        if hasattr(found, "commands"):
            yield from commands(found, (*path, name))
        else:
            yield (*path, name), found


ALL = dict(commands())


@pytest.mark.parametrize("path", ALL, ids=" ".join)
def test_rules_are_about_options_that_the_command_has(path):
    known = {name for parameter in ALL[path].params for name in parameter.opts}
    rules = rules_of(ALL[path])
    named = {*rules.requires, *(owner for owners in rules.requires.values() for owner in owners)}
    groups = (*rules.excludes, *rules.one_of)
    assert named | {name for group in groups for name in group} <= known


GOALS = "--fastest, --period, --jitter, --pin or --accuracy"
WAYS = "--verify, --publish, --foxglove or --plant/--algorithm"
VALUES = {
    "--from": "1",
    "--until": "2",
    "--speed": "2",
    "--wait": "3",
    "-o": "x.mcap",
    "--port": "0",
}
PLAYING = ("--speed", "--from", "--until")
PUBLISHING = ("--as-fast-as-possible", "--wait", "--insecure-tcp")


def with_value(option):
    return (option, VALUES[option]) if option in VALUES else (option,)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        *(
            ((*REPLAY, "--verify", *with_value(option)), f"{option} requires --publish")
            for option in PUBLISHING
        ),
        *(
            (
                (*REPLAY, "--verify", *with_value(option)),
                f"{option} requires --publish or --foxglove",
            )
            for option in PLAYING
        ),
        ((*REPLAY, "--publish", "--port", "0"), "--port requires --foxglove"),
        ((*REPLAY, "--foxglove", "--ros2"), "--ros2 requires --publish"),
        ((*REPLAY, "--publish", "--domain", "1"), "--domain requires --ros2"),
        ((*REPLAY, "--publish", "--epoch", "1"), "--epoch requires --ros2"),
        *(
            ((*REPLAY, mode, *with_value(option)), f"{option} requires --plant or --algorithm")
            for mode in ("--verify", "--publish")
            for option in ("-o", "--force")
        ),
        ((*REPLAY, "--verify", "--output", "x.mcap"), "-o requires --plant or --algorithm"),
        ((*REPLAY, "--algorithm", "beta=1.0", "--agents-only"), "--agents-only requires --verify"),
        ((*REPLAY, "--agents-only"), "--agents-only requires --verify"),
        (
            (*REPLAY, "--publish", "--as-fast-as-possible", "--speed", "2"),
            "--speed and --as-fast-as-possible exclude one another; leave one of them out",
        ),
        (("design", "no.toml", "--share", "0.5"), "--share requires --accuracy"),
        (
            ("design", "no.toml", "--fastest", "--period"),
            f"expected exactly one of {GOALS}, got --fastest, --period",
        ),
        (("design", "no.toml"), f"expected exactly one of {GOALS}, got none of them"),
        (
            (*REPLAY, "--algorithm", "beta=1.0", "--plant", "robots=1", "--publish"),
            f"expected exactly one of {WAYS}, got --publish, --plant, --algorithm",
        ),
        (REPLAY, f"expected exactly one of {WAYS}, got none of them"),
        (("run", "no.toml", "--stay"), "--stay requires --live or --foxglove"),
        (("run", "no.toml", "--port", "0"), "--port requires --live or --foxglove"),
        (
            ("run", "no.toml", "--live", "--foxglove"),
            "--live and --foxglove exclude one another; leave one of them out",
        ),
        (("run", "no.toml", "--expect", "1"), "--expect requires --listen or --connect"),
        (
            ("resume", "no.mcap", "--no-restart"),
            "--no-restart requires --workers, --listen or --connect",
        ),
        (
            ("run", "no.toml", "--json", "--profile"),
            "--profile and --json exclude one another; leave one of them out",
        ),
    ],
    ids=lambda given: " ".join(given) if isinstance(given, tuple) else "",
)
def test_an_option_without_its_required_option_exits_2(arguments, message):
    done = nrs(*arguments)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"error: {message}\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("fmu", "build", "two_link_arm", "-o", "a.fmu", "--fmi", "1"),
            "--fmi: expected a whole number, 2 to 3, got '1'",
        ),
        (
            ("fmu", "from-urdf", "a.urdf", "-o", "a.fmu", "--fmi", "3.0"),
            "--fmi: expected a whole number, 2 to 3, got '3.0'",
        ),
        (
            ("design", "a.toml", "--accuracy", "0,5", "1"),
            "--accuracy: expected a number, got '0,5'",
        ),
        (
            ("design", "a.toml", "--accuracy", "1", "-2"),
            "--accuracy: expected two numbers above 0, got -2",
        ),
        (
            ("design", "a.toml", "--accuracy", "0.1", "-o", "b.toml"),
            "--accuracy: expected POSITION VELOCITY, got '0.1' '-o'",
        ),
        (("run", "a.toml", "-o", "--force"), "-o: expected FILE.mcap, got '--force'"),
        (("design", "a.toml", "--pin", "--json"), "--pin: expected K, got '--json'"),
        (
            ("export", "a.mcap", "-o", "a", "--format", "json"),
            "--format: expected csv, parquet, mat, nc or ssp, got 'json'",
        ),
        (
            ("run", "a.toml", "--compression", "it's"),
            '--compression: expected zstd, lz4 or none, got "it\'s"',
        ),
        (
            ("--log-level", "loud", "info", "a.mcap"),
            "--log-level: expected debug, info, warning or error, got 'loud'",
        ),
    ],
    ids=lambda given: " ".join(given) if isinstance(given, tuple) else "",
)
def test_a_wrong_option_value_is_refused_with_what_is_expected(arguments, message):
    done = nrs(*arguments)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"error: {message}\n")
