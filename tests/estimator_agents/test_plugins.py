"""Algorithms of a package that pip has installed: what is wrong with one is one clear line."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from nrs_cosim.bus.errors import Cause
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.scenarios import write

NRS = Path(sys.executable).with_name("nrs")
PROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "laws"
version = "1.0"

[project.entry-points."nrs.algorithms"]
rooted = "laws:Rooted"
narrow = "laws:Narrow"
empty = "laws:Empty"

[tool.hatch.build.targets.wheel]
only-include = ["laws.py"]
"""
LAWS = '''
from dataclasses import dataclass

import numpy as np

from nrs_cosim import Algorithm, Estimate, parameter
from nrs_cosim.estimator_agents.condition import Condition


@dataclass(frozen=True)
class Rooted(Algorithm):
    """Of a negative disagreement it has the root: not a number."""

    alpha: float = parameter("gain on the positions", above=0)

    def jump(self, estimate, disagreement):
        step = self.alpha * np.sqrt(disagreement.position)
        return Estimate(estimate.position + step, estimate.velocity)


@dataclass(frozen=True)
class Narrow(Algorithm):
    """No gain is within its condition's bound."""

    alpha: float = parameter("gain on the positions", above=0)

    def jump(self, estimate, disagreement):
        velocity = estimate.velocity + self.alpha * disagreement.velocity
        return Estimate(estimate.position + self.alpha * disagreement.position, velocity)

    def conditions(self, spectrum, h):
        return [Condition("alpha", "Lemma 1", self.alpha, -1.0)]


@dataclass(frozen=True)
class Empty(Narrow):
    """No gain is within its own bounds."""

    alpha: float = parameter("gain on the positions", above=1, below=1)
'''


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder into which pip has installed the package."""
    folder = tmp_path_factory.mktemp("plugins")
    (folder / "laws").mkdir()
    (folder / "laws/pyproject.toml").write_text(PROJECT, "utf-8")
    (folder / "laws/laws.py").write_text(LAWS, "utf-8")
    alone = ["--no-index", "--no-build-isolation", "--no-deps", "--disable-pip-version-check"]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "-q", *alone, "--target", "site", "./laws"],
        cwd=folder, check=True,
    )  # fmt: skip
    return folder / "site"


@pytest.fixture
def run(site, tmp_path):
    """Return a call of the command on a scenario with one of the algorithms."""

    def call(command: str, algorithm: str, *more: str) -> subprocess.CompletedProcess[str]:
        chosen = {"algorithm": {"name": algorithm, "alpha": 0.9}}
        write(tmp_path / "s.toml", chosen, {"run.duration": 2.0})
        return subprocess.run(
            [NRS, command, "s.toml", *more],
            cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(site)},
            capture_output=True, text=True, check=False,
        )  # fmt: skip

    return call


LAYOUTS = [(), ("--workers", "2"), ("--workers", "6")]


@pytest.mark.parametrize("layout", cases(LAYOUTS, LAYOUTS[:2]), ids=str)
def test_one_that_returns_no_numbers_is_named_with_robot_and_tick(run, site, tmp_path, layout):
    done = run("run", "rooted", "-o", "s.mcap", *layout)
    line = "algorithm rooted: jump returned a position of nan for robot 1 at tick 1"
    of_jump = LAWS.splitlines().index("    def jump(self, estimate, disagreement):") + 1
    line += f", at {site / 'laws.py'}:{of_jump}"
    assert done.returncode == 1
    assert done.stderr.replace("\n", "") == f"failed: {line}"
    with Reader(tmp_path / "s.mcap") as reader:
        assert (reader.status, reader.reason, reader.damage) == ("failed", line, [])
        assert reader.ending.cause == Cause("algorithm", 1, 10**8, 1, "position")


def test_one_that_no_gain_is_right_for_is_named_as_it_is_run(run):
    line = "algorithm narrow: no alpha above 0 is within the bound of Lemma 1, -1; got 0.9\n"
    strict = run("check", "narrow", "--strict")
    assert strict.returncode == 1
    (violated, *_) = strict.stderr.splitlines()
    assert violated == "strict: alpha (Lemma 1) is violated: 0.9, expected < -1"
    done = run("run", "narrow", "-o", "s.mcap")
    assert (done.returncode, done.stderr) == (0, f"warning: {line}")


def test_one_whose_own_bounds_leave_no_gain_is_named_with_its_place(run, site):
    place = next(i for i, line in enumerate(LAWS.splitlines(), 1) if "above=1, below=1" in line)
    for command in (("check",), ("run", "-o", "s.mcap")):
        done = run(command[0], "empty", *command[1:])
        assert done.returncode == 2
        assert re.sub(r"\s+", " ", done.stderr) == (
            "error: algorithm.name: empty: Empty.alpha: there is no number greater than 1 "
            f"and less than 1, at {site / 'laws.py'}:{place} "
        )
