"""An algorithm of another package, with a gain beside α and β, is as good as a bundled one.

Its law is Δε = α dε, Δυ = β dυ + γ dε: for γ = 0 it is `dcea1`, to the last bit.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nrs_cosim.recordings.mcap.reader import Reader
from tests.estimator_agents.paper import ONE, D
from tests.scenarios import SHORT, write

NRS = Path(sys.executable).with_name("nrs")
MODULE = '''"""Three gains."""

from dataclasses import dataclass

import numpy as np

import nrs_cosim as nrs
from nrs_cosim.estimator_agents.condition import Condition


@dataclass(frozen=True)
class ThreeGains(nrs.Algorithm):
    """Positions push velocities too."""

    alpha: float
    beta: float
    gamma: float = nrs.parameter("push of positions on velocities", 0.2, unit="1/s", least=0)

    def __post_init__(self):
        if self.gamma > self.alpha + self.beta:
            raise ValueError("gamma may be alpha + beta at most")

    def jump(self, estimate, disagreement):
        push = self.beta * disagreement.velocity + self.gamma * disagreement.position
        position = estimate.position + self.alpha * disagreement.position
        return nrs.Estimate(position, estimate.velocity + push)

    def modes(self, spectrum, h):
        a, b, c = (gain * (1 - spectrum) for gain in (self.alpha, self.beta, self.gamma))
        middle = 1 - (a + b + h * c) / 2
        root = np.sqrt(middle**2 - (1 - a) * (1 - b))
        return np.concatenate([middle + root, middle - root])

    def conditions(self, spectrum, h):
        return [Condition("gamma", "ours", self.gamma, 5.0)]
'''
THEIRS = {"algorithm": {"name": "three_gains", "alpha": 0.9, "beta": 0.8}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the package as an installer leaves it, and a scenario of it."""
    path = tmp_path_factory.mktemp("three")
    (path / "three_gains.py").write_text(MODULE, "utf-8")
    about = path / "three_gains-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: three_gains\nVersion: 1.0\n")
    entry = "three_gains = three_gains:ThreeGains"
    (about / "entry_points.txt").write_text(f"[nrs.algorithms]\n{entry}\n")
    write(path / "s.toml", SHORT, THEIRS)
    return path


@pytest.fixture(scope="module")
def command(folder):
    """Return a call of the command, in a process that finds the package."""
    paths = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")]))

    def call(*arguments, status=0):
        done = subprocess.run(
            [NRS, *arguments],
            check=False,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": paths},
            capture_output=True,
            text=True,
        )
        assert done.returncode == status, done.stderr
        return done.stderr if status else done.stdout

    return call


def digest(path):
    with Reader(path) as reader:
        assert reader.status == "completed"
        return reader.digest


@pytest.fixture(scope="module")
def recording(command, folder):
    command("run", "s.toml", "-o", "one.mcap", "--set", "algorithm.gamma=0.3")
    return folder / "one.mcap"


def test_three_workers_have_the_digest_of_one(command, folder, recording):
    command("run", "s.toml", "-o", "3.mcap", "--set", "algorithm.gamma=0.3", "--workers", "3")
    assert digest(folder / "3.mcap") == digest(recording)


def test_a_what_if_with_another_gain_equals_a_fresh_run(command, folder, recording):
    command("replay", recording, "--algorithm", "gamma=0.1,missing=drop", "-o", "if.mcap")
    command("run", "s.toml", "-o", "0.1.mcap", "--set", "algorithm.gamma=0.1")
    assert digest(folder / "if.mcap") == digest(folder / "0.1.mcap") != digest(recording)


def test_a_third_gain_of_zero_gives_the_bits_of_dcea1(command, folder):
    command("run", "s.toml", "-o", "0.mcap", "--set", "algorithm.gamma=0")
    command("run", "s.toml", "-o", "ours.mcap", "--set", "algorithm.name=dcea1")
    assert digest(folder / "0.mcap") == digest(folder / "ours.mcap")


@pytest.mark.parametrize(("options", "gamma"), [((), 0.2), (("--set", "algorithm.gamma=0.3"), 0.3)])
def test_check_has_it_by_name_and_in_its_spectral_radius(command, options, gamma):
    result = json.loads(command("check", "s.toml", "--json", *options))
    assert result["parameters"] == {"alpha": 0.9, "beta": 0.8, "gamma": gamma}
    assert [c["value"] for c in result["conditions"] if c["name"] == "gamma"] == [gamma]
    L, P, h = ONE - D, ONE - 0.8 * (ONE - D), 0.1
    A = np.block([[ONE - 0.9 * L - h * gamma * L, h * P], [-gamma * L, P]])
    radius = max(abs(np.linalg.eigvals(A)))
    assert result["spectral_radius"] == pytest.approx(radius, rel=1e-6)
    text = command("check", "s.toml", *options)
    assert f"three_gains (alpha = 0.9, beta = 0.8, gamma = {gamma})" in text


def test_info_has_it_by_name(command, recording):
    result = json.loads(command("info", recording, "--json"))
    assert result["algorithm"] == {
        "name": "three_gains",
        "parameters": {"alpha": 0.9, "beta": 0.8, "gamma": 0.3},
    }
    assert "three_gains (alpha = 0.9, beta = 0.8, gamma = 0.3)" in command("info", recording)


def test_the_schema_has_it_with_type_default_unit_bound_and_meaning(command):
    schema = json.loads(command("schema"))
    table = schema["$defs"]["Algorithm_three_gains"]
    gamma = table["properties"]["gamma"]
    assert {key: value for key, value in gamma.items() if key != "title"} == {
        "type": "number",
        "default": 0.2,
        "unit": "1/s",
        "minimum": 0,
        "description": "push of positions on velocities",
    }
    assert table["required"] == ["name", "alpha", "beta"]
    assert table["description"] == "Positions push velocities too."
    mapping = schema["properties"]["algorithm"]["discriminator"]["mapping"]
    assert mapping["three_gains"] == "#/$defs/Algorithm_three_gains"


@pytest.mark.parametrize(
    ("change", "faults"),
    [
        ({"gama": 0.3}, ["gama: unknown key; did you mean 'gamma'?"]),
        (
            {"alpha": None, "beta": None, "alhpa": 0.9, "gamma": -1},
            [
                "beta: missing, it has no default",
                "gamma: expected greater than or equal to 0, got -1",
                "alhpa: unknown key; did you mean 'alpha'?",
            ],
        ),
        (
            {"beta": "0.8", "gamma": float("inf")},
            [
                "beta: expected a valid number, got '0.8'",
                "gamma: expected a finite number, got inf",
            ],
        ),
        (
            {"gamma": [0.3] * 6},
            ["gamma: expected a valid number, got [0.3, 0.3, 0.3, 0.3, 0.3, 0.3]"],
        ),
    ],
)
def test_all_that_is_wrong_with_its_table_is_one_message(command, folder, change, faults):
    changes = {f"algorithm.{key}": value for key, value in change.items()}
    write(folder / "wrong.toml", SHORT, THEIRS, changes)
    errors = command("check", "wrong.toml", status=2)
    assert errors.splitlines() == [
        f"{'error: ' if i == 0 else ''}wrong.toml: algorithm.{fault}"
        for i, fault in enumerate(faults)
    ]


def test_parameters_that_do_not_go_together_are_a_line_with_the_place(command, folder):
    errors = command("check", "s.toml", "--set", "algorithm.gamma=2", status=2)
    line = MODULE.splitlines().index(
        '            raise ValueError("gamma may be alpha + beta at most")'
    )
    assert errors.replace("\n", "") == (
        "error: s.toml: algorithm.name: three_gains(alpha, beta, gamma): ValueError: gamma may be "
        f"alpha + beta at most, at {folder / 'three_gains.py'}:{line + 1}"
    )


def test_one_robot_has_no_parameters_of_its_own(command):
    errors = command("check", "s.toml", "--set", "robots=2,algorithm.gamma=0.1", status=2)
    assert errors.replace("\n", " ").strip() == (
        "error: s.toml: robots[0].algorithm: unknown key; the algorithm and its parameters are "
        "those of all robots; give them in [algorithm]"
    )


def test_another_algorithm_takes_over_the_parameters_that_it_has_too(command):
    result = json.loads(command("check", "s.toml", "--json", "--set", "algorithm.name=dcea2"))
    assert result["parameters"] == {"alpha": 0.9, "beta": 0.8}
    errors = command("check", "s.toml", "--set", "algorithm={name='dcea2',gamma=1}", status=2)
    assert "algorithm.gamma: unknown key" in errors
