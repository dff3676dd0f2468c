"""What an algorithm says of its modes is held against its own jump."""

import numpy as np
import pytest

from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.installed import load_algorithm
from nrs_cosim.estimator_agents.theory.declared_modes import expect_modes
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.orchestrator.scenario.tables import algorithms
from tests.command import nrs
from tests.scenarios import SCENARIOS

PAPER = SCENARIOS / "paper_first_order.toml"


class Sunny(FirstOrder):
    """Says that its errors fall faster than they do."""

    def modes(self, spectrum, h):
        return 0.5 * super().modes(spectrum, h)


class Short(FirstOrder):
    """Says one mode of two."""

    def modes(self, spectrum, h):
        return super().modes(spectrum, h)[:1]


class Silent(FirstOrder):
    """Says nothing."""

    def modes(self, spectrum, h):
        return super().modes(spectrum, h)[:0]


class Saturating(FirstOrder):
    """Jumps by so much at most, and speaks of modes all the same."""

    def jump(self, estimate, received):
        after = super().jump(estimate, received)
        return Estimate(np.clip(after.position, -1.0, 1.0), after.velocity)


class Endless(SecondOrder):
    """Says what is no number."""

    def modes(self, spectrum, h):
        return super().modes(spectrum, h) * np.inf


class Rounded(FirstOrder):
    """Computes its modes as well as a computer can."""

    def modes(self, spectrum, h):
        return super().modes(spectrum, h) * (1 + 1e-12)


@pytest.mark.parametrize("gains", [(1e6, 1e6), (0.9, 1.1), (1 + 1e-6, 1 - 1e-6)])
def test_rounding_is_not_a_contradiction_of_declared_modes(gains):
    expect_modes(Rounded(*gains), 0.1)


@pytest.mark.parametrize("name", ["dcea1", "dcea2", "impulsive", "pd_like", "sliding"])
@pytest.mark.parametrize("gains", [(0.9, 1.1), (0.1, 1e-3), (1e6, 1e-6), (1.0, 1.0)])
@pytest.mark.parametrize("h", [1e-4, 0.1, 10.0])
def test_the_declared_modes_of_bundled_algorithms_are_those_of_their_jump(name, gains, h):
    alpha, beta = gains
    expect_modes(
        load_algorithm(name, {"alpha": alpha, "beta": 1.0 if name == "pd_like" else beta}), h
    )


@pytest.mark.parametrize("kind", [Sunny, Short, Endless])
def test_declared_modes_that_contradict_the_jump_are_an_error(kind):
    with pytest.raises(AlgorithmError, match=r"modes of s = 0 at h = 0.1 s are .*, but its jump"):
        expect_modes(kind(0.9, 0.8), 0.1)


def test_a_nonlinear_algorithm_has_no_modes():
    with pytest.raises(AlgorithmError, match="its jump is not linear, so that it has no modes"):
        expect_modes(Saturating(0.9, 0.8), 0.1)


def test_an_algorithm_without_declared_modes_is_accepted():
    expect_modes(Silent(0.9, 0.8), 0.1)


@pytest.mark.parametrize("command", [("check",), ("run", "-o", "run.mcap")])
def test_commands_report_wrong_modes_before_a_run(monkeypatch, tmp_path, command):
    monkeypatch.setattr(algorithms, "load_algorithm", lambda _name, given: Sunny(**given))
    assert read_scenario(PAPER).scenario.n == 6
    done = nrs(command[0], PAPER, *command[1:], cwd=tmp_path)
    assert done.returncode == 2
    assert "modes of s = 0 at h = 0.1 s are 0.05 and -0.05, but its jump has" in done.stderr
    assert "Traceback" not in done.stderr
    assert not [*tmp_path.iterdir()]
