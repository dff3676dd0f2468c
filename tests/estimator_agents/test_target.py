"""Both kinds of target keep one contract, and a spline is what its samples came from."""

import numpy as np
import pytest

from nrs_cosim.estimator_agents.target import Sampled, Target
from tests.estimator_agents.paper import HARMONIC, target

GRID = np.linspace(0, 7, 200_001)
UNEVEN = np.sort(np.concatenate([[0, 7], np.random.default_rng(3).uniform(0, 7, 60)]))
ROUGH = np.random.default_rng(4).normal(size=(62, 2))


@pytest.fixture(params=["harmonic", "smooth", "rough", "two", "three"])
def moving(request) -> Target:
    """Each kind of target, on two axes from 0 to 7 s."""
    if request.param == "harmonic":
        return HARMONIC
    if request.param == "smooth":
        return Sampled.of(UNEVEN, HARMONIC.at(UNEVEN).position)
    few = {"rough": 62, "two": 2, "three": 3}[request.param]
    times = UNEVEN if few == 62 else np.linspace(0, 7, few)
    return Sampled.of(times, ROUGH[:few])


class TestEveryTarget:
    """What a run and the theory ask of a target."""

    def test_times_of_any_shape_add_an_axis(self, moving):
        for shape in ((), (5,), (2, 3)):
            t = np.linspace(0, 7, int(np.prod(shape))).reshape(shape)
            there = moving.at(t)
            assert there.position.shape == there.velocity.shape == (*shape, 2)
            for index in np.ndindex(shape):
                alone = moving.at(float(t[index]))
                np.testing.assert_allclose(alone.position, there.position[index], rtol=1e-15)
                np.testing.assert_allclose(alone.velocity, there.velocity[index], rtol=1e-15)

    def test_velocity_is_the_slope_of_the_position(self, moving):
        motion = moving.at(GRID)
        slope = (motion.position[2:] - motion.position[:-2]) / (GRID[2:] - GRID[:-2])[:, None]
        gamma_1, gamma_2 = moving.bounds()
        step = GRID[1]
        error = np.abs(slope - motion.velocity[1:-1]).max()
        assert error <= gamma_2 * step / 2 + 1e-9 * gamma_1

    def test_no_velocity_or_acceleration_is_beyond_the_bounds(self, moving):
        velocity = moving.at(GRID).velocity
        acceleration = np.diff(velocity, axis=0) / np.diff(GRID)[:, None]
        gamma_1, gamma_2 = moving.bounds()
        assert np.abs(velocity).max() <= gamma_1 * (1 + 1e-12)
        assert np.abs(acceleration).max() <= gamma_2 * (1 + 1e-6) + 1e-9


def test_bounds_of_a_spline_are_reached():
    for samples in (ROUGH, HARMONIC.at(UNEVEN).position):
        sampled = Sampled.of(UNEVEN, samples)
        fine = np.union1d(GRID, UNEVEN)
        gamma_1, gamma_2 = sampled.bounds()
        assert np.abs(sampled.cubics.at(fine, 1)).max() == pytest.approx(gamma_1, rel=1e-6)
        assert np.abs(sampled.cubics.at(fine, 2)).max() == pytest.approx(gamma_2, rel=1e-12)


def test_bounds_of_a_cubic_in_closed_form():
    t = np.array([0.0, 1.0, 1.5, 3.0])  # not-a-knot: four samples of t³ − 3 t² give it back
    sampled = Sampled.of(t, (t**3 - 3 * t**2)[:, None])
    assert sampled.bounds() == pytest.approx((9.0, 12.0))
    inner = Sampled.of(t - 1, -(t**3 - 3 * t**2)[:, None])
    np.testing.assert_allclose(inner.at(0.0).velocity, [3.0])
    short = Sampled.of(t[:3], (t**3 - 3 * t**2)[:3, None])  # the parabola through three of them
    assert short.bounds() == pytest.approx((3.0, 1.0))


def test_the_largest_velocity_within_a_piece_is_found():
    """υ = 3 t² − 6 t + 1 is −2 at t = 1, inside of the one piece from 0 to 1.9."""
    t = np.array([0.0, 0.6, 1.3, 1.9])
    sampled = Sampled.of(t, (t**3 - 3 * t**2 + t)[:, None])
    assert sampled.bounds() == pytest.approx((2.0, 6.0))


def test_the_acceleration_of_a_spline_is_continuous():
    sampled = Sampled.of(UNEVEN, ROUGH)
    before, after = (sampled.cubics.at(UNEVEN[1:-1] + side, 2) for side in (-1e-9, 1e-9))
    np.testing.assert_allclose(before, after, atol=1e-5 * sampled.bounds()[1])


def test_dense_samples_of_the_papers_target_are_the_papers_target():
    """A cubic spline is off by at most 5/384 h⁴ sup|ε_0⁗|, and more at the ends."""
    t = np.arange(0, 7.05, 0.1)
    sampled = Sampled.of(t, HARMONIC.at(t).position)
    for at in (0.0, 0.05, 3.33, 7.0):
        position, velocity = target(at)
        np.testing.assert_allclose(sampled.at(at).position, position, atol=1e-5)
        np.testing.assert_allclose(sampled.at(at).velocity, velocity, atol=5e-4)
    assert sampled.bounds() == pytest.approx((3.0, 1.0), rel=1e-2)


def test_beyond_its_samples_a_target_is_nan():
    assert np.all(np.isnan(Sampled.of([0.0, 1.0], [[0.0], [1.0]]).at(1.5).position))


@pytest.mark.parametrize("m", [1, 2, 3])
def test_norm_bounds_of_samples_are_those_of_a_dense_look_and_none_is_beyond(m):
    rng = np.random.default_rng(m)
    for _ in range(50):
        times = np.cumsum(rng.uniform(0.1, 2.0, 8))
        target = Sampled.of(times, rng.normal(size=(8, m)))
        dense = np.linspace(times[0], times[-1], 20_001)
        speed = np.linalg.norm(target.at(dense).velocity, axis=-1).max()
        pull = np.linalg.norm(target.acceleration(dense), axis=-1).max()
        bounds = target.norm_bounds()
        assert speed <= bounds[0] * (1 + 1e-12)
        assert pull <= bounds[1] * (1 + 1e-12)
        assert bounds == pytest.approx((speed, pull), rel=0.03)
