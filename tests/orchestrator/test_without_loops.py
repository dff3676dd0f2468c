"""What is said of `sliding`, whose jump is not linear, beside its own simulation."""

import numpy as np
import pytest

from nrs_cosim.orchestrator.analysis.bounds import bounds, ultimate_bounds
from tests.cases import cases
from tests.scenarios import paper

TREE = [[0, 0, 0], [1, 0, 0], [1, 1, 0]], [1, 0, 1]


def sliding(alpha, adjacency, pinning):
    return {
        "network": {"adjacency": adjacency, "pinning": pinning},
        "algorithm": {"name": "sliding", "alpha": alpha, "beta": 0.3},
        "initial": {},
    }


@pytest.mark.parametrize(
    ("adjacency", "pinning", "velocity", "position"),
    [
        (*TREE, 3 * 0.4, 3 * 0.3 + 0.1 * 0.4 * (1 + 2 + 3)),
        ([[0, 0, 0], [1, 0, 0], [1, 0, 0]], [1, 1, 0], 2 * 0.4, 2 * 0.3 + 0.1 * 0.4 * (1 + 2)),
        ([[0, 1, 0], [1, 0, 0], [1, 0, 0]], [1, 0, 0], None, None),
    ],
)
def test_sliding_has_the_bounds_of_the_longest_path(adjacency, pinning, velocity, position):
    given = sliding(0.3, adjacency, pinning)
    ultimate = ultimate_bounds(paper(given))
    rows = bounds(ultimate)
    assert rows[0].worst_case == (position and pytest.approx(position))
    assert rows[1].worst_case == (velocity and pytest.approx(velocity))
    assert (ultimate.tracking.worst_case is None) == (position is None)
    assert ultimate_bounds(paper(given, {"faults.links": [{"loss": 0.1}]})).worst_case is None


def test_positions_have_no_bound_where_a_step_is_shorter_than_velocities_move_them():
    ultimate = ultimate_bounds(paper(sliding(0.1, *TREE)))
    assert [row.worst_case for row in bounds(ultimate)[:2]] == [None, pytest.approx(1.2)]
    assert ultimate.why_not


def test_no_target_takes_sliding_estimates_beyond_the_bound():
    """Targets that turn at will, at sampling times and halfway; one that leads robots astray."""
    rng, runs, h, gamma_2 = np.random.default_rng(41), cases(20_000, 500), 0.1, 1.0
    weights = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [1, 1, 1, 0]], float)
    weights /= weights.sum(axis=1, keepdims=True)
    found = bounds(ultimate_bounds(paper(sliding(0.3, *TREE))))
    x, v, p, s = np.zeros((3, runs)), np.zeros((3, runs)), np.zeros(runs), np.zeros(runs)
    most, held = np.zeros(2), np.zeros(runs)
    for _ in range(400):
        every = np.concatenate([p[None], x]), np.concatenate([s[None], v])
        x = x + 0.3 * np.sign(weights @ every[0] - x)
        v = v + 0.3 * np.sign(weights @ every[1] - v)
        for _ in range(2):
            held = np.where(rng.random(runs) < 0.4, gamma_2 * rng.integers(-1, 2, runs), held)
            held = np.where(np.abs(s + held * h / 2) > 3.0, 0.0, held)
            x, p, s = x + v * h / 2, p + s * h / 2 + held * h * h / 8, s + held * h / 2
            most = np.maximum(most, [np.abs(x - p).max(), np.abs(v - s).max()])
    assert most[0] <= found[0].worst_case
    assert most[1] <= found[1].worst_case
    assert most[1] > found[1].worst_case / 3
