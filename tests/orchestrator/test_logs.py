"""What is logged: with time, level and logger, on standard error, and only where asked for."""

import re
import subprocess
import sys

from tests.scenarios import SHORT, write

LINE = re.compile(
    r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3} (INFO|WARNING) (nrs_cosim[\w.]+)\[\d+\]: (.*)"
)


def run(tmp_path, *options):
    """Run a second of the paper's example on two workers, in a process of its own."""
    scenario = write(tmp_path / "short.toml", SHORT)
    command = [sys.executable, "-m", "nrs_cosim", *options, "run", scenario, "--workers", "2"]
    done = subprocess.run(
        [*command, "-o", tmp_path / "run.mcap", "--force"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done


def test_nothing_is_logged_by_default(tmp_path):
    assert run(tmp_path).stderr == ""


def test_workers_are_logged_with_time_level_and_place(tmp_path):
    done = run(tmp_path, "--log-level", "info")
    lines = [LINE.fullmatch(line) for line in done.stderr.splitlines()]
    assert all(lines), done.stderr
    result = [line[3] for line in lines]
    cluster = "nrs_cosim.orchestrator.cluster"
    loggers = {line[2] for line in lines}
    assert loggers == {f"{cluster}.coordinator", f"{cluster}.worker_client"}
    for worker, robots in (("local-1", "robots 1-3"), ("local-2", "robots 4-6")):
        assert f"{worker} joined with {robots}" in result
        assert f"{worker} is done at tick 10" in result
        assert f"{worker}: joined short with {robots}" in result
    assert "digest" in done.stdout


def test_an_unknown_log_level_is_named(tmp_path):
    command = [sys.executable, "-m", "nrs_cosim", "--log-level", "loud", "schema"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "--log-level: expected debug, info, warning or error, got 'loud'" in done.stderr
