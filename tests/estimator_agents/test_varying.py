"""Bounds on joint spectral radii, against those that the literature gives in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import comb

from nrs_cosim.estimator_agents.theory.varying import JointRadius, joint_spectral_radius

GOLDEN = (1 + 5**0.5) / 2


def found(*matrices: object) -> JointRadius:
    bounds = joint_spectral_radius([np.asarray(matrix, float) for matrix in matrices])
    assert bounds is not None
    return bounds


def daubechies(count: int) -> list[np.ndarray]:
    """Return T_0 and T_1 of the wavelet with `count` vanishing moments, its factors taken out."""
    in_y = [comb(count - 1 + k, k) for k in range(count)]
    pairs = (np.roots([1, -(2 - 4 * y), 1]) for y in np.roots(in_y[::-1]))
    mask = np.poly([pair[np.argmin(np.abs(pair))] for pair in pairs]).real
    mask *= 2 / mask.sum()
    rows = np.arange(count - 1)
    at = 2 * rows[:, None] - rows
    return [np.where((at + e >= 0) & (at + e < count), mask[(at + e) % count], 0) for e in (0, 1)]


def test_the_pair_of_shears_has_the_golden_ratio() -> None:
    bounds = found([[1, 1], [0, 1]], [[1, 0], [1, 1]])
    assert bounds.lower == pytest.approx(GOLDEN, rel=1e-12)
    assert bounds.upper == pytest.approx(GOLDEN, rel=1e-12)
    assert sorted(bounds.order) == [0, 1]


@pytest.mark.parametrize(("moments", "exponent"), [(3, 1.0878), (4, 1.6179)])
def test_wavelets_are_as_smooth_as_daubechies_and_lagarias_have_it(
    moments: int, exponent: float
) -> None:
    """SIAM Journal on Mathematical Analysis 23 (1992): the Hölder exponent is N − log2 ρ̂."""
    bounds = joint_spectral_radius(daubechies(moments))
    assert bounds is not None
    assert moments - np.log2(bounds.lower) == pytest.approx(exponent, abs=5e-5)
    assert bounds.upper <= bounds.lower * 1.0011


def test_two_nilpotent_matrices_may_have_a_growing_product() -> None:
    bounds = found([[0, 2], [0, 0]], [[0, 0], [3, 0]])
    assert bounds.lower == pytest.approx(6**0.5, rel=1e-12)
    assert bounds.upper == pytest.approx(6**0.5, rel=2e-3)


def test_of_one_matrix_the_joint_radius_is_its_spectral_radius() -> None:
    for size in (1.0, 100.0):
        bounds = found([[0.5, size], [-0.1 / size, 0.4]])
        radius = np.abs(np.linalg.eigvals([[0.5, size], [-0.1 / size, 0.4]])).max()
        assert bounds.lower == pytest.approx(radius, rel=1e-9)
        assert bounds.upper == pytest.approx(radius, rel=1.1e-3)


def test_of_a_block_triangular_form_the_largest_block_counts() -> None:
    shears = np.array([[[1, 1], [0, 1]], [[1, 0], [1, 1]]]) / 2
    mixed = np.zeros((2, 3, 3))
    mixed[:, :2, :2] = shears
    mixed[:, :2, 2] = 1e6
    mixed[:, 2, 2] = 0.3, -0.9
    swap = [2, 0, 1]
    bounds = joint_spectral_radius(list(mixed[:, swap][:, :, swap]))
    assert bounds is not None
    assert bounds.lower == pytest.approx(0.9, rel=1e-12)
    assert bounds.order == (1,)
    assert bounds.upper == pytest.approx(0.9, rel=1.1e-3)


def test_complex_scalars_have_the_radius_of_their_moduli() -> None:
    bounds = joint_spectral_radius([np.array([[0.3 + 0.4j]]), np.array([[-0.2j]])])
    assert bounds is not None
    assert bounds.lower == pytest.approx(0.5, rel=1e-9)
    assert bounds.upper == pytest.approx(0.5, rel=1.1e-3)


def test_rounding_gives_vanishing_products_no_lower_bound() -> None:
    """Strictly triangular, but not in their rows' order: every product of four is zero."""
    rng = np.random.default_rng(5)
    turn, _ = np.linalg.qr(rng.normal(size=(4, 4)))
    nilpotent = [turn @ np.triu(rng.normal(size=(4, 4)), 1) @ turn.T for _ in range(2)]
    bounds = joint_spectral_radius(nilpotent)
    assert bounds is not None
    assert bounds.lower < 1e-2


def test_blocks_that_are_too_large_are_undecided() -> None:
    rng = np.random.default_rng(6)
    assert joint_spectral_radius([rng.normal(size=(50, 50))]) is None
    large = joint_spectral_radius([np.triu(rng.normal(size=(50, 50)))])
    assert large is not None


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 4), st.integers(1, 3))
def test_orders_lie_between_the_bounds_of_the_joint_radius(seed: int, p: int, q: int) -> None:
    """All products of up to five, by brute force; and the order that is named attains its bound."""
    matrices = np.random.default_rng(seed).normal(size=(q, p, p))
    bounds = joint_spectral_radius(list(matrices), near=0.03)
    assert bounds is not None
    assert bounds.lower <= bounds.upper * (1 + 1e-9)
    products = matrices
    for length in range(1, 6):
        radii = np.abs(np.linalg.eigvals(products)).max(axis=1) ** (1 / length)
        assert radii.max() <= bounds.upper * (1 + 1e-6)
        products = np.concatenate([products @ matrix for matrix in matrices])
    worst = np.eye(p)
    for number in bounds.order:
        worst = matrices[number] @ worst
    radius = np.abs(np.linalg.eigvals(worst)).max() ** (1 / len(bounds.order))
    assert radius == pytest.approx(bounds.lower, rel=1e-6)


def test_scaling_the_matrices_scales_the_joint_radius():
    pair = [np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0], [1.0, 1.0]])]
    golden = (1 + 5**0.5) / 2
    for factor in (1e12, 1e150, 1e300):
        found = joint_spectral_radius([factor * one for one in pair])
        assert found.lower == pytest.approx(golden * factor, rel=1e-9)
        assert golden * factor * (1 - 1e-9) <= found.upper <= golden * factor * (1 + 2e-3)
    beyond = joint_spectral_radius([np.array([[np.inf]]), np.array([[1.0]])])
    assert beyond.lower == beyond.upper == np.inf
