"""ρ is of the links that a scenario has in each place where a user meets it, as are warnings."""

from itertools import product
from math import isnan

import numpy as np
import pytest
from typer.testing import CliRunner

import nrs_cosim as nrs
from nrs_cosim.orchestrator.analysis.check_warnings import warnings_of
from nrs_cosim.orchestrator.cli.main import app
from nrs_cosim.orchestrator.cli.theory_text import convergence_rows
from tests.cases import cases
from tests.estimator_agents.paper import ADJACENCY
from tests.scenarios import SCENARIOS

SLOW = {"run.sampling_period": 0.4, "run.output_step": 0.4, "run.duration": 20.0}
"""The paper's example 3 a: Theorem 3 allows 0.4938 s."""
DIVERGE = "over these links the estimates diverge: their error grows by a factor of "
SQUARES = "in mean square, over these links, the estimates diverge: their error grows by a factor"


WEIGHTS = np.hstack([ADJACENCY, [[0], [0], [1], [0], [0], [0]]])
FLOW, GAIN = np.array([[1, 0.4], [0, 1]]), np.array([[0, 0], [1.1, 0.9]])


def late_radius(delay):
    """Return ρ of the second-order DCEA over links all late alike, of its augmented matrix."""
    D = ADJACENCY / WEIGHTS.sum(axis=1)[:, None]
    whole = np.eye(12 * (delay + 1), k=-12)
    whole[:12] = 0
    whole[:12, :12] += np.kron(FLOW @ (np.eye(2) - GAIN), np.eye(6))
    whole[:12, -12:] += np.kron(FLOW @ GAIN, D)
    return abs(np.linalg.eigvals(whole)).max()


def lossy_radius(loss):
    """Return ρ(E[A ⊗ A])^½ of agents that drop, robot by robot over all that may be lost."""
    means, squares = [], []
    for i, weights in enumerate(WEIGHTS):
        own, sources = np.eye(6)[i], np.flatnonzero(weights)
        mean, square = np.zeros((2, 12)), np.zeros((2, 2, 12, 12))
        for arrived in product([0, 1], repeat=len(sources)):
            row = np.zeros(7)
            row[sources] = weights[sources] * arrived
            jump = np.kron(np.eye(2), own)
            if any(arrived):
                jump += np.kron(GAIN, row[:6] / row.sum() - own)
            A, chance = FLOW @ jump, np.prod(np.where(arrived, 1 - loss, loss))
            mean += chance * A
            square += chance * np.einsum("ac,bd->abcd", A, A)
        means.append(mean)
        squares.append(square)
    blocks = [
        [squares[i] if i == j else np.einsum("ac,bd->abcd", means[i], means[j]) for j in range(6)]
        for i in range(6)
    ]
    # (robot, robot, part, part, from, from): states are by part and robot.
    whole = np.array(blocks).transpose(2, 0, 3, 1, 4, 5).reshape(144, 144)
    return abs(np.linalg.eigvals(whole)).max() ** 0.5


@pytest.mark.parametrize(
    ("faults", "missing", "convergence", "name", "radius", "warning"),
    [
        ({}, "drop", "converges", "spectral radius", late_radius(0), None),
        ({"delay": 1}, "drop", "diverges", "spectral radius", late_radius(1), DIVERGE),
        ({"delay": 2}, "hold", "diverges", "spectral radius", late_radius(2), DIVERGE),
        ({"outages": [[0.1, 0.3]]}, "hold", "converges", "spectral radius", late_radius(0), None),
        ({"loss": 0.5}, "drop", "unknown", "mean-square radius", lossy_radius(0.5), SQUARES),
        ({"delay": {"uniform": [0, 2]}}, "drop", "unknown", None, None, "that the estimates conv"),
        ({"outages": [[0.1, 90.0]]}, "hold", "unknown", None, None, "whether the estimates conver"),
        *cases(
            [({"loss": 0.2}, "drop", "converges", "mean-square radius", lossy_radius(0.2), None)],
            [],
        ),
    ],
)
def test_the_radius_is_of_the_links_wherever_it_is_said(
    faults, missing, convergence, name, radius, warning
):
    links = {"faults.links": [faults]} if faults else {}
    changes = SLOW | links | {"algorithm.missing": missing}
    theory = nrs.check(nrs.Scenario.load(SCENARIOS / "paper_example_3a.toml").replace(changes))
    checked = theory._checked
    found = theory.as_json()
    assert theory.convergence == found["convergence"] == checked.convergence == convergence
    assert repr(theory).startswith(f"Theory({convergence}")
    row = convergence_rows(checked)["rho"]
    if radius is None:
        assert isnan(theory.spectral_radius)
        assert found["spectral_radius"] is None
        assert "mean-square" not in repr(theory) + row
    else:
        assert theory.spectral_radius == pytest.approx(
            radius, rel=1e-3 if "loss" in faults else 1e-9
        )
        assert found["spectral_radius"] == theory.spectral_radius
        assert theory.spectral_radius_bounds == pytest.approx((radius, radius), rel=1e-9)
        assert f"{name} {theory.spectral_radius:.6g}" in repr(theory)
        assert row.startswith(f"{name} {theory.spectral_radius:.6f} ")
    assert theory.spectral_radius_without_faults == pytest.approx(late_radius(0), rel=1e-9)
    assert found["spectral_radius_without_faults"] == theory.spectral_radius_without_faults
    assert [line.startswith(warning) for line in theory.warnings] == [True] * bool(warning)
    assert theory.warnings == warnings_of(checked)
    assert (found["settling_time"] is None) == bool(faults)


def test_a_run_warns_of_links_over_which_the_estimates_diverge_before_it_starts(tmp_path):
    late = ("--set", "run.sampling_period=0.4", "--set", "faults.links.0.delay=1")
    short = ("--set", "run.output_step=0.4", "--set", "run.duration=0.8")
    path, file = str(tmp_path / "a.mcap"), str(SCENARIOS / "paper_example_3a.toml")
    done = CliRunner().invoke(app, ["run", file, *late, *short, "-o", path])
    assert " ".join(done.stderr.split()).count(DIVERGE + "1.011777") == 1
