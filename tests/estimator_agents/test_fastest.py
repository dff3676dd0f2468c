"""The fastest gains and the best pins, against grids, draws and all sets."""

from itertools import combinations

import numpy as np
import pytest

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.theory.fastest import (
    best_pins,
    fastest_alone,
    fastest_together,
    least,
)
from nrs_cosim.estimator_agents.theory.spectrum import spectral_radius, spectrum_of


def digraph(rng, n):
    adjacency = np.where(rng.random((n, n)) < 0.4, rng.uniform(0.1, 3, (n, n)), 0)
    np.fill_diagonal(adjacency, 0)
    for i in range(1, n):
        adjacency[i, rng.integers(0, i)] = 1
    return Topology.of(adjacency, np.eye(n)[0])


def test_no_gain_of_a_grid_is_faster_than_the_fastest():
    rng = np.random.default_rng(3)
    gains = np.linspace(0.01, 2, 400)
    for _ in range(300):
        z = 1 - spectrum_of(digraph(rng, int(rng.integers(1, 7))))
        grid = np.abs(1 - gains[:, None] * z).max(axis=1).min()
        ours = np.abs(1 - fastest_alone(1 - z) * z).max()
        assert ours <= grid + 1e-12
        assert ours >= grid - 0.005 * np.abs(z).max()


def test_no_gains_of_a_grid_are_faster_than_the_fastest_together():
    """Of 300 digraphs, half of them with complex eigenvalues, in grids of 60 by 60."""
    rng, shares, complex_ones = np.random.default_rng(6), np.geomspace(1 / 8, 8, 60), 0
    for _ in range(300):
        spectrum = spectrum_of(digraph(rng, int(rng.integers(1, 8))))
        complex_ones += np.abs(spectrum.imag).max() > 1e-6
        alpha, beta = fastest_together(spectrum, 0.1)
        found = spectral_radius(SecondOrder(alpha, beta).modes(spectrum, 0.1))
        # Two eigenvalues that meet are found to the root of what numbers are rounded to.
        first = np.abs(1 - beta * (1 - spectrum)).max()
        assert found == pytest.approx(np.sqrt(first), abs=1e-7)
        A, B = (mesh[..., None] for mesh in np.meshgrid(0.1 * alpha * shares, beta * shares))
        away = 1 - np.unique(np.round(spectrum, 12))
        half = 1 - (A + B) * away / 2
        root = np.sqrt(half**2 - 1 + B * away)
        others = np.maximum(abs(half + root), abs(half - root)).max(axis=-1)
        assert others.min() >= found - 1e-7
    assert complex_ones > 100


def test_at_a_given_beta_no_alpha_is_faster():
    rng = np.random.default_rng(7)
    for _ in range(300):
        spectrum = spectrum_of(digraph(rng, int(rng.integers(2, 8))))
        alpha, beta = fastest_together(spectrum, 0.1, 1.0)
        found = spectral_radius(SecondOrder(alpha, beta).modes(spectrum, 0.1))
        assert found == pytest.approx(np.sqrt(np.abs(spectrum).max()), abs=1e-7)
        for share in (0.5, 0.9, 0.99, 1.01, 1.1, 2):
            other = spectral_radius(SecondOrder(share * alpha, beta).modes(spectrum, 0.1))
            assert other >= found - 1e-7


@pytest.mark.parametrize("seed", range(2))
def test_no_gains_that_are_drawn_are_faster_than_the_search_finds(seed):
    rng = np.random.default_rng(seed)
    h, spectrum = 0.1, spectrum_of(digraph(rng, 5))

    def radius(gains):
        return spectral_radius(SecondOrder(*gains).modes(spectrum, h))

    found = least(radius, np.array([1e-3, 1e-2]), np.array([20 / h, 4.0]))
    drawn = np.exp(rng.uniform(np.log([0.1, 0.1]), np.log([20 / h, 3]), (3000, 2)))
    near = found * np.exp(0.05 * rng.normal(size=(3000, 2)))
    assert radius(found) <= min(map(radius, np.concatenate([drawn, near]))) + 1e-4
    assert radius(found) <= radius(fastest_together(spectrum, h)) + 1e-3


def test_a_robot_alone_is_deadbeat():
    def radius(gains):
        return spectral_radius(SecondOrder(*gains).modes(np.zeros(1, complex), 0.1))

    found = least(radius, np.array([1e-3, 1e-2]), np.array([200.0, 4.0]))
    assert found == pytest.approx([10, 1], rel=0.02)
    assert radius(found) < 0.15  # it is 0 at (10, 1), and rises as a root beside it


def test_the_best_pins_of_small_digraphs_are_the_best_of_all_sets():
    rng, exact = np.random.default_rng(5), 0
    for _ in range(60):
        n, count = int(rng.integers(3, 7)), int(rng.integers(1, 3))
        adjacency = np.where(rng.random((n, n)) < 0.5, rng.uniform(0.1, 3, (n, n)), 0)
        np.fill_diagonal(adjacency, 0)

        def cost(robots, adjacency=adjacency, n=n):
            topology = Topology.of(adjacency, np.isin(np.arange(1, n + 1), robots).astype(float))
            left = int((topology.steps() < 0).sum())
            return (left, 0.0) if left else (0, float(np.abs(spectrum_of(topology)).max()))

        chosen, best = best_pins(n, count, cost)
        sets = [cost(robots) for robots in combinations(range(1, n + 1), count)]
        assert best is not None
        assert cost(best) == min(sets)
        exact += cost(chosen) == min(sets)
    assert exact >= 50
