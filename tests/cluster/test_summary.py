"""What a user of workers on this machine is told, and what is refused."""

import re

import pytest

from tests.cluster.local_workers import lossy
from tests.command import nrs

pytestmark = pytest.mark.usefixtures("nothing_is_left")


@pytest.fixture
def toml(tmp_path):
    path = tmp_path / "lossy.toml"
    path.write_text(lossy({"run.duration": 3.0}).text, "utf-8")
    return path


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--workers", "0"], "--workers: expected auto or 1 to 6, a robot each at least, got '0'"),
        (["--workers", "7"], "--workers: expected auto or 1 to 6, a robot each at least, got '7'"),
        (["--workers", "٢"], "--workers: expected auto or 1 to 6, a robot each at least, got '٢'"),
        (
            ["--workers", "many"],
            "--workers: expected auto or 1 to 6, a robot each at least, got 'many'",
        ),
        (
            ["--workers", "2", "--listen", "tcp/127.0.0.1:7447"],
            "--workers 2: starts workers here, --listen waits for others",
        ),
        (
            ["--listen", "tcp/127.0.0.1:7447", "--threads", "2"],
            "--threads 2: is of workers on this machine; give it to each `nrs worker`",
        ),
        (["--deadline", "0"], "--deadline: expected more than 0 s, got 0"),
        (["--workers", "2", "--wait", "nan"], "--wait: expected a number, got 'nan'"),
        (["--wait", "9"], "--wait requires --workers, --listen or --connect"),
        (
            ["--no-restart"],
            "--no-restart requires --workers, --listen or --connect",
        ),
        (["--tls-key", "x"], "--tls-key requires --listen or --connect"),
        (["--insecure-tcp"], "--insecure-tcp requires --listen or --connect"),
    ],
)
def test_bad_options_exit_2(toml, tmp_path, options, message):
    done = nrs("run", toml, "-o", tmp_path / "n.mcap", *options)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"error: {message}\n"
    assert not (tmp_path / "n.mcap").exists()


def lines_of(printed):
    summary, _, table = printed.partition("\n\n")
    return dict(line.split(None, 1) for line in summary.splitlines()), table.splitlines()


@pytest.mark.parametrize("workers", [1, 3])
def test_profile_shows_where_the_time_went(toml, tmp_path, workers):
    """Shares of the wall time, on average over workers; with --profile, seconds of each process."""
    done = nrs("run", toml, "-o", tmp_path / "n.mcap", "--workers", workers, "--profile")
    assert done.returncode == 0, done.stderr
    result, (title, *rows) = lines_of(done.stdout)
    assert result.keys().isdisjoint({"rejected", "restarts"})
    wall = float(re.search(r" in ([\d.]+) s,", result["ticks"])[1])
    whose = "," if workers == 1 else " of a worker's on average;"
    shares = rf"(\d+) % plants, (\d+) % bus, (\d+) % waiting{whose} (\d+) % recording"
    assert 0 <= sum(map(int, re.fullmatch(shares, result["time"]).groups())) <= 200
    assert title.split()[4:] == ["plants", "bus", "recording", "waiting", "other"]
    names = ["here"] if workers == 1 else ["local-1", "local-2", "local-3", "orchestrator"]
    *rows, path = rows if workers == 1 else (*rows, "")
    assert path.startswith("ticks are done by" if workers == 1 else "")
    assert [row.split()[0] for row in rows] == names
    for row in rows:
        assert sum(map(float, row.split()[1:])) == pytest.approx(wall, abs=0.02)
